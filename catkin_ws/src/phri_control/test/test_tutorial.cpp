// The tutorial prints what its Python twin prints: both are compared with tutorials/risk_averse.txt (four decimals; the
// twins solve the same problem with the same differences, so that only rounding could tell them apart).
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#define main riskAverse
#include "../tutorials/risk_averse.cpp"
#undef main

TEST(Tutorial, PrintsWhatIsDocumented)
{
  const std::string here = __FILE__;
  std::ifstream file(here.substr(0, here.rfind('/')) + "/../tutorials/risk_averse.txt");
  ASSERT_TRUE(file.good());
  std::stringstream expected;
  expected << file.rdbuf();
  testing::internal::CaptureStdout();
  riskAverse();
  std::fflush(stdout);
  EXPECT_EQ(testing::internal::GetCapturedStdout(), expected.str());
}
