#include <gtest/gtest.h>

#include <cmath>

#include "phri_core/parameters.hpp"
#include "phri_core/safety.hpp"

using namespace phri_core;

namespace
{
struct Settings
{
  double mass = 90.0;
  int count = 3;
  bool on = false;
  std::string law = "preview";
  std::vector<double> start{ 0.1, 0.1 };
  ParameterTable table()
  {
    ParameterTable t;
    t.number("admittance/mass", &mass, "kg", 0.1, 500.0, "rendered mass", true)
        .integer("count", &count, "", 1, 9, "how many")
        .flag("on", &on, "switch")
        .text("law", &law, { "preview", "error_feedback" }, "law")
        .list("start", &start, 2, "m", -0.15, 0.15, "start");
    return t;
  }
};
}  // namespace

TEST(Parameters, AssignsGoodValues)
{
  Settings s;
  s.table().assign(
      "test",
      { { "admittance/mass", 40.0 }, { "count", 4.0 }, { "on", true }, { "law", std::string("error_feedback") } });
  EXPECT_EQ(s.mass, 40.0);
  EXPECT_EQ(s.count, 4);
  EXPECT_TRUE(s.on);
  EXPECT_EQ(s.law, "error_feedback");
}

// All errors at once, each naming key, value, unit and range; nothing is changed by a refused assignment.
TEST(Parameters, ListsAllErrorsAndChangesNothing)
{
  Settings s;
  try
  {
    s.table().assign("maze.yaml", { { "admittance/mass", NAN },
                                    { "admitance/mass", 5.0 },
                                    { "count", 2.5 },
                                    { "law", std::string("preveiw") },
                                    { "on", 1.0 },
                                    { "start", std::vector<double>{ 0.1, 9.0 } } });
    FAIL() << "accepted";
  }
  catch (const ParameterError& error)
  {
    EXPECT_EQ(error.errors().size(), 6u);
    const std::string text = error.what();
    for (const char* part : { "maze.yaml", "admittance/mass = nan", "kg", "0.1 to 500", "did you mean admittance/mass?",
                              "2.5", "did you mean preview?", "true or false", "9 m" })
      EXPECT_NE(text.find(part), std::string::npos) << part << " missing in\n" << text;
  }
  EXPECT_EQ(s.mass, 90.0);
  EXPECT_EQ(s.start[1], 0.1);
}

// A text, a flag or a list where a number belongs must never become the default silently.
TEST(Parameters, RefusesWrongTypes)
{
  for (const ParameterValue& value : { ParameterValue(std::string("0.5")), ParameterValue(true),
                                       ParameterValue(std::vector<double>{ 0.5 }), ParameterValue(INFINITY) })
  {
    Settings s;
    EXPECT_THROW(s.table().assign("test", { { "admittance/mass", value } }), ParameterError);
  }
}

TEST(Parameters, EveryDefaultOfTheSafetyProfileIsWithinItsRange)
{
  SafetySettings settings;
  const ParameterTable table = parameterTable(settings);
  EXPECT_GE(table.entries().size(), 20u);
  for (const auto& entry : table.entries())
  {
    if (entry.kind != "number")
      continue;
    SafetySettings copy;
    EXPECT_NO_THROW(parameterTable(copy).assign("defaults", { { entry.key, std::stod(entry.initial) } })) << entry.key;
    EXPECT_FALSE(entry.unit.empty()) << entry.key;
  }
}
