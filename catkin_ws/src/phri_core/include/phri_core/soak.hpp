#pragma once
/// For tests only: many random problems per test case, and how many. The tests run `base` of them, scripts/soak.sh a
/// multiple. Problem i of a case depends on (case, i) alone, so that one which fails can be run by itself. Environment:
///   PHRI_SOAK=100        times the base, 0.001 to 10000
///   PHRI_SOAK_PART=2/8   only every eighth problem, from the second on: one of eight programs at once
///   PHRI_SOAK_SEED=4711  only this problem
/// A case ends with a line "[soak] case: N problems, F failed, S s: kind count, ..." on standard output.
/// Include it after gtest/gtest.h, which phri_core itself does not depend on.
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <stdexcept>
#include <string>

#include "phri_core/random.hpp"

#ifndef GTEST_API_
#error "include gtest/gtest.h before phri_core/soak.hpp"
#endif

namespace soak
{
struct Settings
{
  double factor = 1.0;
  std::uint64_t part = 1, parts = 1;
  bool single = false;
  std::uint64_t seed = 0;
};

/// Throws std::invalid_argument naming the variable, its value and what was expected.
inline Settings settings()
{
  const auto fail = [](const char* name, const char* value, const char* expected) {
    throw std::invalid_argument(std::string(name) + "=" + value + ", expected " + expected);
  };
  Settings result;
  if (const char* value = std::getenv("PHRI_SOAK"))
  {
    char* end = nullptr;
    result.factor = std::strtod(value, &end);
    if (end == value || *end != '\0' || !(result.factor >= 1e-3 && result.factor <= 1e4))
      fail("PHRI_SOAK", value, "a number from 0.001 to 10000");
  }
  if (const char* value = std::getenv("PHRI_SOAK_PART"))
  {
    unsigned part = 0, parts = 0;
    int read = 0;
    if (std::sscanf(value, "%4u/%4u%n", &part, &parts, &read) != 2 || value[read] != '\0' || part < 1 || part > parts)
      fail("PHRI_SOAK_PART", value, "i/n with 1 <= i <= n, such as 2/8");
    result.part = part;
    result.parts = parts;
  }
  if (const char* value = std::getenv("PHRI_SOAK_SEED"))
  {
    char* end = nullptr;
    errno = 0;
    result.seed = std::strtoull(value, &end, 10);
    if (value[0] < '0' || value[0] > '9' || *end != '\0' || errno != 0)
      fail("PHRI_SOAK_SEED", value, "the number of a problem");
    result.single = true;
  }
  return result;
}

/// What a case's problems ended in.
class Tally
{
public:
  void count(const std::string& kind) { ++kinds_[kind]; }
  long of(const std::string& kind) const { return kinds_.count(kind) ? kinds_.at(kind) : 0; }
  /// Fails unless more than `share` of the problems ended so; where too few were run to tell, it does not.
  void expectMoreThan(double share, const std::string& kind) const
  {
    constexpr double kEnough = 10.0;  // of them expected
    if (double(problems) * share >= kEnough)
    {
      EXPECT_GT(double(of(kind)), double(problems) * share) << kind;
    }
  }
  const std::map<std::string, long>& kinds() const { return kinds_; }
  long problems = 0, failed = 0;

private:
  std::map<std::string, long> kinds_;
};

inline long failures()
{
  const testing::TestResult* result = testing::UnitTest::GetInstance()->current_test_info()->result();
  long count = 0;
  for (int i = 0; i < result->total_part_count(); ++i)
    count += result->GetTestPartResult(i).failed();
  return count;
}

/// Runs check(number, random, tally) for `base` problems times the factor. An assertion that fails in it names the
/// problem's number; after kMostFailures failed problems the case ends.
template <typename Check>
Tally run(std::uint64_t base, const Check& check)
{
  constexpr long kMostFailures = 10;
  const Settings use = settings();
  const testing::TestInfo& test = *testing::UnitTest::GetInstance()->current_test_info();
  const std::string name = std::string(test.test_suite_name()) + "." + test.name();
  const auto total = static_cast<std::uint64_t>(std::ceil(double(base) * use.factor));
  const auto began = std::chrono::steady_clock::now();
  Tally tally;
  std::uint64_t number = use.single ? use.seed : use.part - 1;
  int tenths = 1;
  for (; use.single ? tally.problems == 0 : number < total; number += use.parts)
  {
    const long before = failures();
    {
      const testing::ScopedTrace trace(__FILE__, __LINE__,
                                       "problem " + std::to_string(number) + "; alone: PHRI_SOAK_SEED=" +
                                           std::to_string(number) + " with --gtest_filter=" + name);
      phri_core::Random random = phri_core::Random::stream(7, name, number);
      check(number, random, tally);
    }
    ++tally.problems;
    if (failures() > before && ++tally.failed >= kMostFailures)
      break;
    for (; use.factor > 1.0 && tenths < 10 && 10 * number >= tenths * total; ++tenths)
      std::fprintf(stderr, "%s %llu/%llu: %d %%, %ld failed\n", name.c_str(), (unsigned long long)use.part,
                   (unsigned long long)use.parts, 10 * tenths, tally.failed);
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
  std::string line;
  for (const auto& [kind, count] : tally.kinds())
  {
    line += (line.empty() ? ": " : ", ") + kind + " " + std::to_string(count);
    testing::Test::RecordProperty(kind, std::to_string(count));
  }
  testing::Test::RecordProperty("problems", std::to_string(tally.problems));
  std::printf("[soak] %s: %ld problems, %ld failed, %.1f s%s\n", name.c_str(), tally.problems, tally.failed,
              took.count(), line.c_str());
  return tally;
}

/// 10^uniform(low, high).
inline double scale(phri_core::Random& random, double low, double high)
{
  return std::pow(10.0, random.uniform(low, high));
}

/// A whole number from low to high, both included.
inline int number(phri_core::Random& random, int low, int high)
{
  return low + static_cast<int>(random.uniform() * (high - low + 1));
}
}  // namespace soak
