// The button: a spring, a click at 0.75 N, an end stop; judged by the travel of its cap alone.
#include "phri_sim/button.hpp"

#include <gtest/gtest.h>

#include "mechanisms.hpp"

namespace
{
using namespace phri_sim;
using namespace phri_sim::testing;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kStep = 1e-3;
constexpr double kSettled = 1e-6;  // [m] a spring of 300 N/m after 1 s

/// A cap on a table, pressed downwards by a ball on a cart; 2e4 N/m between them.
struct Bench
{
  World world;
  Button button;
  int ball;
  VectorXd tau;

  static RobotDescription mechanism(double travel)
  {
    RobotDescription d;
    d.name = "button";
    d.links = { solid("button_base", 0.1, box(0.05, 0.05, 0.01)), solid("button_cap", 0.02, box(0.02, 0.02, 0.01)) };
    JointDescription slider = joint("button_joint", "button_base", "button_cap", JointKind::Prismatic, { 0, 0, -1 });
    slider.origin.translation().z() = 0.02;
    slider.lower = 0.0;
    slider.upper = travel;
    d.joints = { slider };
    return d;
  }

  explicit Bench(const ButtonParameters& parameters = {}, double travel = 4e-3)
    : world({ { mechanism(travel), "", Eigen::Isometry3d::Identity() },
              { cart("ball", 1.0, sphere(0.01), 40.0), "", Eigen::Isometry3d(Eigen::Translation3d(0, 0, 0.0351)) } }),
      button(world, "button_joint", parameters),
      ball(world.model().link("ball")),
      tau(VectorXd::Zero(4))
  {
  }

  /// Press with a force downwards, the ball's weight carried.
  void press(double force, int steps)
  {
    for (int i = 0; i < steps; ++i)
    {
      tau(3) = 9.81 - force;
      world.step(kStep, tau);
      button.update();
    }
  }
};

TEST(Button, RestsOutUnderItsOwnWeight)
{
  Bench bench;
  bench.press(0.0, 1000);
  EXPECT_NEAR(bench.button.travel(), 0.0, kSettled);
  EXPECT_EQ(bench.button.touches(), 0);
}

TEST(Button, TravelIsForceOverStiffnessUpToTheStop)
{
  for (const double force : { 0.3, 0.6, 0.9 })
  {
    Bench bench;
    bench.press(force, 4000);
    EXPECT_NEAR(bench.button.travel(), force / 300.0, kSettled);
    EXPECT_NEAR(bench.button.force(), force, 1e-4);
  }
  Bench hard;
  hard.press(20.0, 4000);
  // beyond 4 mm the spring's 1.2 N and the stop share the force
  EXPECT_NEAR(hard.button.travel(), 4e-3 + (20.0 - 1.2) / WorldOptions().stop_stiffness, 2e-5);
  EXPECT_LT(hard.button.travel(), 5e-3);
}

TEST(Button, ClicksAt075NewtonAndNotBelow)
{
  Bench below;
  below.press(0.74, 4000);
  EXPECT_TRUE(below.button.touching());
  EXPECT_EQ(below.button.touches(), 1);
  EXPECT_EQ(below.button.clicks(), 0) << "contact without click: partial success";
  EXPECT_LT(below.button.deepest(), 2.5e-3);

  Bench above;
  above.press(0.76, 4000);
  EXPECT_EQ(above.button.clicks(), 1);
  EXPECT_TRUE(above.button.pressed());
  above.press(0.65, 4000);  // 2.17 mm: above the release, hence no second click when it is pressed on
  EXPECT_TRUE(above.button.pressed());
  above.press(0.9, 4000);
  EXPECT_EQ(above.button.clicks(), 1);
  above.press(0.4, 4000);
  EXPECT_FALSE(above.button.pressed());
  above.press(0.9, 4000);
  EXPECT_EQ(above.button.clicks(), 2);
  above.button.reset();
  EXPECT_EQ(above.button.clicks(), 0);
}

TEST(Button, ComesOutAgainWhenLetGo)
{
  Bench bench;
  bench.press(2.0, 1500);
  EXPECT_TRUE(bench.button.pressed());
  bench.press(-2.0, 1000);
  EXPECT_FALSE(bench.button.touching());
  EXPECT_NEAR(bench.button.travel(), 0.0, kSettled);
}

TEST(Button, RefusesWhatIsNoButton)
{
  EXPECT_THROW(Bench({}, 2e-3), std::invalid_argument) << "the stop comes before the click";
  ButtonParameters bad;
  bad.release = 3e-3;
  EXPECT_THROW(Bench{ bad }, std::invalid_argument);
  Bench bench;
  EXPECT_THROW(Button(bench.world, "ball_x"), std::invalid_argument) << "no limits";
  EXPECT_THROW(Button(bench.world, "nothing"), std::out_of_range);
}
}  // namespace
