// What a slider does to a parameter, what is read from a description, and when requests go out.

#include <gtest/gtest.h>

#include <QApplication>
#include <QLineEdit>
#include <QSlider>
#include <algorithm>
#include <cmath>
#include <vector>

#include "request_pacer.hpp"
#include "slider_scale.hpp"
#include "tunable.hpp"
#include "tuning_widget.hpp"

namespace
{
using phri_rviz::RequestPacer;
using phri_rviz::SliderScale;
using phri_rviz::Values;

constexpr int kLast = SliderScale::kPositions;
constexpr double kHalfDigit = 0.0051;  // three digits: half a unit of the third is at most 0.5 % of the value

struct Limits
{
  double minimum, maximum, standard;
};

const std::vector<Limits> kLimits{
  { 1e-12, 1e14, 1e-3 }, { 0, 1e14, 200 }, { 0, 1e14, 0 }, { 5, 20, 8 },   { 1, 500, 90 },
  { 0, 60, 25 },         { -1, 1, 0 },     { 0, 1, 0 },    { 1, 1e5, 30 }, { -1e14, 1e14, 5 },
  { 1e-12, 1, 0.5 },     { 3, 3, 3 },      { 0, 0, 0 }
};

TEST(SliderScale, EveryPositionIsAllowedAndNoneGoesBack)
{
  for (const Limits& limits : kLimits)
  {
    const SliderScale scale(limits.minimum, limits.maximum, limits.standard);
    for (int position = 0; position <= kLast; ++position)
    {
      const double value = scale.value(position);
      ASSERT_GE(value, limits.minimum);
      ASSERT_LE(value, limits.maximum);
      ASSERT_GE(value, scale.value(std::max(position - 1, 0))) << limits.minimum << " " << position;
    }
  }
}

// A handle that is set to a value and read back must not change the parameter by more than the slider's own grain.
TEST(SliderScale, PositionOfAValueIsWhereThatValueIs)
{
  for (const Limits& limits : kLimits)
  {
    const SliderScale scale(limits.minimum, limits.maximum, limits.standard);
    if (scale.low() == scale.high())
      continue;
    for (int position = 0; position <= kLast; position += 7)
    {
      const double value = scale.value(position), back = scale.value(scale.position(value));
      const double grain = std::abs(scale.value(std::min(position + 1, kLast)) - value) + kHalfDigit * std::abs(value);
      EXPECT_NEAR(back, value, grain) << limits.minimum << " " << limits.maximum << " " << position;
    }
  }
}

TEST(SliderScale, TheDefaultIsInsideAndFarFromTheEnds)
{
  for (const Limits& limits :
       { Limits{ 1e-12, 1e14, 1e-3 }, Limits{ 0, 1e14, 200 }, Limits{ 0, 1e4, 200 }, Limits{ 1, 1e5, 30 } })
  {
    const SliderScale scale(limits.minimum, limits.maximum, limits.standard);
    EXPECT_TRUE(scale.logarithmic());
    EXPECT_GT(scale.position(limits.standard), kLast / 5);
    EXPECT_LT(scale.position(limits.standard), kLast * 4 / 5);
  }
}

// On a logarithmic scale a factor is a distance, wherever it is applied.
TEST(SliderScale, EqualFactorsAreEqualDistances)
{
  const SliderScale scale(1e-12, 1e14, 1e-3);
  const int one = scale.position(1e-3) - scale.position(1e-4), other = scale.position(1e-2) - scale.position(1e-3);
  EXPECT_NEAR(one, other, 1);  // positions are integers
  EXPECT_NEAR(one, kLast / 4, 1) << "four decades are shown";
}

TEST(SliderScale, ZeroIsTheLeftEndAlone)
{
  const SliderScale scale(0, 1e14, 200);
  EXPECT_EQ(scale.value(0), 0);
  EXPECT_GT(scale.value(1), 0);
  EXPECT_EQ(scale.position(0), 0);
  EXPECT_GE(scale.position(1e-9), 1);
  EXPECT_EQ(scale.position(NAN), 0);
}

TEST(SliderScale, NarrowLimitsAreLinearAndWhole)
{
  const SliderScale scale(5, 20, 8);
  EXPECT_FALSE(scale.logarithmic());
  EXPECT_EQ(scale.value(0), 5);
  EXPECT_EQ(scale.value(kLast), 20);
  EXPECT_NEAR(scale.value(kLast / 2), 12.5, 12.5 * kHalfDigit);
}

TEST(SliderScale, CoversWhatWasTyped)
{
  SliderScale scale(1e-12, 1e14, 1e-3);
  ASSERT_LT(scale.high(), 5e6);
  scale.cover(5e6);
  EXPECT_EQ(scale.value(kLast), 5e6);
  scale.cover(1e30);
  EXPECT_EQ(scale.value(kLast), 1e14) << "never past the limit";
  scale.cover(1e-12);
  EXPECT_EQ(scale.value(0), 1e-12);
}

dynamic_reconfigure::ConfigDescription describe(const std::string& type, const std::string& text, double minimum,
                                                double maximum, double standard)
{
  dynamic_reconfigure::ConfigDescription description;
  description.groups.resize(1);
  description.groups[0].parameters.resize(1);
  description.groups[0].parameters[0].name = "pd/stiffness";
  description.groups[0].parameters[0].type = type;
  description.groups[0].parameters[0].description = text;
  description.min = phri_rviz::config({ { "pd/stiffness", minimum } });
  description.max = phri_rviz::config({ { "pd/stiffness", maximum } });
  description.dflt = phri_rviz::config({ { "pd/stiffness", standard } });
  return description;
}

TEST(Tunables, UnitIsTheLastBracket)
{
  const auto one = phri_rviz::tunables(describe("double", "gain [of the PD] on the error [N/m]", 0, 9, 4));
  ASSERT_EQ(one.size(), 1);
  EXPECT_EQ(one[0].name, "pd/stiffness");
  EXPECT_EQ(one[0].unit, "N/m");
  EXPECT_EQ(one[0].meaning, "gain [of the PD] on the error");
  EXPECT_EQ(one[0].minimum, 0);
  EXPECT_EQ(one[0].maximum, 9);
  EXPECT_EQ(one[0].standard, 4);
  EXPECT_EQ(phri_rviz::tunables(describe("double", "no unit", 0, 9, 4))[0].unit, "");
}

TEST(Tunables, OnlyWhatASliderCanShow)
{
  EXPECT_TRUE(phri_rviz::tunables(describe("int", "a [N]", 0, 9, 4)).isEmpty());
  EXPECT_TRUE(phri_rviz::tunables(describe("double", "a [N]", 0, INFINITY, 4)).isEmpty());
  EXPECT_TRUE(phri_rviz::tunables(describe("double", "a [N]", 2, 1, 1)).isEmpty());
  auto without_limits = describe("double", "a [N]", 0, 9, 4);
  without_limits.max.doubles.clear();
  EXPECT_TRUE(phri_rviz::tunables(without_limits).isEmpty());
}

class TuningWidgetTest : public testing::Test
{
protected:
  static void SetUpTestSuite()
  {
    qputenv("QT_QPA_PLATFORM", "offscreen");
    static int count = 1;
    static char name[] = "test";
    static char* arguments[] = { name, nullptr };
    static QApplication application(count, arguments);
  }
  static QString shown(const phri_rviz::TuningWidget& widget)
  {
    return widget.findChild<QLineEdit*>("tuning/pd/stiffness")->text();
  }
};

// Descriptions and values in force are two topics: either may arrive first.
TEST_F(TuningWidgetTest, ValuesInForceMayComeBeforeTheirDescription)
{
  const auto described = phri_rviz::tunables(describe("double", "gain [N/m]", 0, 9, 4));
  phri_rviz::TuningWidget first, second;
  first.setValues({ { "pd/stiffness", 7 } });
  first.setTunables(described);
  second.setTunables(described);
  EXPECT_EQ(shown(second), "4");
  second.setValues({ { "pd/stiffness", 7 } });
  EXPECT_EQ(shown(first), "7");
  EXPECT_EQ(shown(second), "7");
}

TEST_F(TuningWidgetTest, AnotherNodeHasItsOwnValues)
{
  const auto described = phri_rviz::tunables(describe("double", "gain [N/m]", 0, 9, 4));
  phri_rviz::TuningWidget widget;
  widget.setTunables(described);
  widget.setValues({ { "pd/stiffness", 7 } });
  widget.setTunables({});
  widget.setTunables(described);
  EXPECT_EQ(shown(widget), "4");
}

// A refusal that comes late must not put back a value that the user has changed again meanwhile.
TEST_F(TuningWidgetTest, RefusalLeavesANewerValueAlone)
{
  phri_rviz::TuningWidget widget;
  widget.setTunables(phri_rviz::tunables(describe("double", "gain [N/m]", 0, 9, 4)));
  widget.setValues({ { "pd/stiffness", 4 } });
  auto* slider = widget.findChild<QSlider*>("tuning/pd/stiffness/slider");
  slider->setValue(kLast);      // sent at once
  slider->setValue(kLast / 3);  // waits for the answer
  widget.setAnswer({ { "pd/stiffness", 9 } }, false, {}, "too stiff");
  EXPECT_EQ(shown(widget), "3");
  widget.setAnswer({ { "pd/stiffness", 3 } }, true, { { "pd/stiffness", 3 } }, "");
  EXPECT_EQ(shown(widget), "3");
}

// A thousand changes in one second of simulated time: a tenth of a second apart, the last one among them.
TEST(RequestPacer, TenASecondAndAlwaysTheLast)
{
  constexpr double kPeriod = 0.1;
  RequestPacer pacer(kPeriod);
  std::vector<double> times;
  double last = -1;
  for (int ms = 0; ms < 1500; ++ms)
  {
    if (ms < 1000)
      pacer.put("a", ms);
    const Values sent = pacer.take(ms * 1e-3);
    if (sent.isEmpty())
      continue;
    EXPECT_GE(ms * 1e-3 - (times.empty() ? -kPeriod : times.back()), kPeriod - 1e-12);  // rounding of the times
    times.push_back(ms * 1e-3);
    last = sent["a"];
    pacer.answered();
  }
  EXPECT_EQ(last, 999);
  EXPECT_EQ(times.size(), 11u) << "at 0, 0.1 .. 0.9 and the last value at 1.0";
  EXPECT_TRUE(pacer.idle());
}

TEST(RequestPacer, OneAtATime)
{
  RequestPacer pacer(0.1);
  pacer.put("a", 1);
  EXPECT_EQ(pacer.take(0).value("a"), 1);
  pacer.put("a", 2);
  pacer.put("b", 3);
  EXPECT_TRUE(pacer.take(5).isEmpty()) << "the first has not been answered";
  EXPECT_TRUE(pacer.isPending("a"));
  pacer.answered();
  EXPECT_EQ(pacer.take(5), (Values{ { "a", 2 }, { "b", 3 } }));
  pacer.answered();
  EXPECT_FALSE(pacer.isPending("a"));
}
}  // namespace
