// What the contact controllers do with a tool above a displaced wall, in the interaction loop with its limits.
#include <gtest/gtest.h>

#include "contact_wall.hpp"

namespace phri_control
{
using wall::Outcome;
using wall::reproduce;

namespace
{
constexpr double kDeep = 0.10;    // [m] the wall is lower than taught
constexpr double kMiddle = 0.05;  // [m]

double taughtForce(const ContactSettings& settings)
{
  return wall::demonstrate(settings.mass.size(), 1)
      .environment_wrench[std::lround(4.0 / wall::kNode)]
      .mean(settings.mass.size() - 1);
}

/// Of every controller, where nothing moved.
const std::vector<Outcome>& undisplaced()
{
  static const std::vector<Outcome> outcomes = [] {
    std::vector<Outcome> list;
    for (const std::string& name : contactControllerNames())
      list.push_back(reproduce(name, {}, 0.0));
    return list;
  }();
  return outcomes;
}
}  // namespace

TEST(ContactWall, WhereNothingMovedAllPressAsTaughtAndNoLimitActs)
{
  constexpr double kSettled = 0.1;  // [N] what is left of the impact after four seconds
  for (std::size_t i = 0; i < undisplaced().size(); ++i)
  {
    const Outcome& outcome = undisplaced()[i];
    const std::string& name = contactControllerNames()[i];
    EXPECT_NEAR(outcome.late_force, taughtForce({}), kSettled) << name;
    EXPECT_LT(outcome.end_error, 0.002) << name;
    EXPECT_TRUE(outcome.active) << name;
    EXPECT_EQ(outcome.limited, 0.0) << name;
    EXPECT_EQ(outcome.fallback, 0.0) << name;
  }
}

// In the air u_f is minus the taught force, and the spring of the motion control holds it: K e = u_f. The soft one is
// still on its way there, with a time constant of D_r / K.
TEST(ContactWall, WithoutAdaptationTheToolStopsWhereTheStiffnessBalancesTheForceInput)
{
  constexpr double kStatic = 0.005;  // relative: 3.5 s are 21 time constants, but the references still move by 0.1 mm/s
  const ContactSettings settings;
  const Outcome neutral = reproduce("neutral_learned", settings, kDeep);
  const Outcome seeking = reproduce("seeking_learned", settings, kDeep);
  for (const Outcome& outcome : { neutral, seeking })
  {
    EXPECT_LT(outcome.first_contact, 0.0);
    EXPECT_NEAR(outcome.press_input, -taughtForce(settings), 1e-9);
    EXPECT_LT(outcome.end_error, 0.002) << "nothing was adapted: it points where it was taught to";
  }
  const double balance = neutral.press_input / neutral.press_stiffness;
  EXPECT_NEAR(neutral.press_height, balance, kStatic * std::abs(balance));
  EXPECT_GT(seeking.press_height, seeking.press_input / seeking.press_stiffness);
  EXPECT_LT(seeking.deepest, 5.0 * neutral.deepest);
  EXPECT_GT(reproduce("seeking_learned", settings, kMiddle).first_contact, 0.0);
  EXPECT_LT(reproduce("neutral_learned", settings, kMiddle).first_contact, 0.0);
  ContactSettings thesis;
  thesis.seeking = 1e-5;
  EXPECT_NEAR(reproduce("seeking_learned", thesis, kDeep).deepest, neutral.deepest, 1e-3 * std::abs(neutral.deepest));
}

// A free tool under u_f goes down with u_f / D_r; what it was adapted by stays for good, or is forgotten.
TEST(ContactWall, AdaptationFindsTheWallAndDrifts)
{
  constexpr double kTouch = 0.1;  // [s] start-up of M_r / D_r and the onset of the taught force
  const ContactSettings settings;
  for (const double displacement : { kMiddle, kDeep })
    for (const char* name : { "neutral_adapted", "seeking_adapted" })
    {
      const Outcome outcome = reproduce(name, settings, displacement);
      EXPECT_NEAR(outcome.first_contact,
                  wall::kPressStart + displacement / (taughtForce(settings) / settings.damping(2)), kTouch + 0.1)
          << name;
      EXPECT_NEAR(outcome.end_error, displacement, 0.1 * displacement) << name;
    }
  const Outcome forgetting = reproduce("seeking_forgetting", settings, kMiddle);
  EXPECT_GT(forgetting.first_contact, 0.0);
  EXPECT_LT(forgetting.end_error, 0.002);
}

TEST(ContactWall, AxesAreDecoupled)
{
  constexpr double kLimited = 1e-6;  // [m] the loop bounds the norm of the acceleration, which acts for one tick
  ContactSettings one;
  one.mass = one.mass.head(1).eval();
  one.damping = one.damping.head(1).eval();
  one.force_gain = one.force_gain.head(1).eval();
  const ContactSettings three;
  for (const char* name : { "seeking_learned", "seeking_adapted" })
  {
    const Outcome line = reproduce(name, one, kMiddle), space = reproduce(name, three, kMiddle);
    ASSERT_EQ(line.positions.size(), space.positions.size());
    for (std::size_t k = 0; k < line.positions.size(); ++k)
      ASSERT_NEAR(line.positions[k](0), space.positions[k](2), kLimited) << name << ' ' << k;
  }
}

// The loop blends plans, and references go on from plan to plan: a new plan makes no step of the force.
TEST(ContactWall, PlansFollowEachOtherWithoutABump)
{
  for (const Outcome& outcome : undisplaced())
  {
    EXPECT_LT(outcome.plan_step, 2.0 * outcome.largest_step);
    EXPECT_LT(outcome.plan_step, 0.02);  // [N]: at 0.14 m/s a millisecond is 0.06 N for 400 N/m
  }
}
}  // namespace phri_control
