// The settings' schema: what a configuration file may say, and what the factory refuses.
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "phri_control/assistance.hpp"

using namespace phri_control;

TEST(AssistanceSettings, areCheckedByTheTableAndByTheFactory)
{
  AssistanceSettings settings;
  phri_core::ParameterTable table = parameterTable(settings);
  table.assign("test", { { "law", std::string("preview") }, { "lqr/position_weight", 1e9 } });
  EXPECT_EQ(settings.law, "preview");
  EXPECT_EQ(settings.lqr.position, 1e9);
  try
  {
    table.assign("test", { { "horizn", 0.1 }, { "pd/stiffness", -1.0 } });
    FAIL() << "no error";
  }
  catch (const phri_core::ParameterError& error)
  {
    ASSERT_EQ(error.errors().size(), 2u);
    EXPECT_NE(error.errors()[0].find("did you mean horizon"), std::string::npos) << error.what();
    EXPECT_NE(error.errors()[1].find("N/m"), std::string::npos) << error.what();
  }
  const auto refused = [](const std::function<void(AssistanceSettings&)>& spoil) {
    AssistanceSettings bad;
    spoil(bad);
    EXPECT_THROW(makeAssistance("lqr", bad), std::invalid_argument);
  };
  refused([](auto& s) { s.horizon = 0.0; });
  refused([](auto& s) { s.control_weight = std::numeric_limits<double>::quiet_NaN(); });
  refused([](auto& s) { s.mass(1) = -90.0; });
  refused([](auto& s) { s.damping.resize(3); });
  refused([](auto& s) { s.law = "feedforward"; });
}
