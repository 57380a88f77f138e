#include "phri_control/base_coordination.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "phri_core/random.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;
using phri_core::Random;

namespace
{
constexpr double kRounding = 1e-12;  // sums of a few products of numbers around 1

/// A tool held sideways: the vertical is none of its axes.
Eigen::Isometry3d pose(double x, double y, double yaw)
{
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.translation() << x, y, 1.0;
  result.linear() =
      (Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY()) *
       Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitZ()))
          .toRotationMatrix();
  return result;
}

Eigen::Isometry3d planar(const Eigen::Vector3d& base)
{
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.translation().head<2>() = base.head<2>();
  result.linear() = Eigen::AngleAxisd(base.z(), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return result;
}

/// [x, y, yaw] after `dt` under a constant twist: a circular arc, exactly.
Eigen::Vector3d moved(const Eigen::Vector3d& base, const BaseTwist& twist, double dt)
{
  const double middle = base.z() + 0.5 * twist.z() * dt, half = 0.5 * twist.z() * dt;
  const double chord = std::abs(half) > 1e-9 ? std::sin(half) / half : 1.0;
  Eigen::Vector3d result = base;
  result.head<2>() += dt * chord * (Eigen::Rotation2Dd(middle) * Eigen::Vector2d(twist.head<2>()));
  result.z() += twist.z() * dt;
  return result;
}

double wrapped(double angle)
{
  return std::remainder(angle, 2.0 * M_PI);
}

CoordinationSettings settings()
{
  CoordinationSettings result;
  result.preferred = pose(0.9, 0.3, 0.2);
  return result;
}

/// No limit acts.
CoordinationSettings unlimited()
{
  CoordinationSettings result = settings();
  result.speed = 5.0;
  result.turn_rate = 10.0;
  result.acceleration = result.turn_acceleration = 100.0;
  return result;
}
}  // namespace

// The errors are the base pose x_m x_d^-1 that would see the end-effector where it is preferred.
TEST(BaseErrors, AreTheGoalOfTheBaseInItsOwnAxes)
{
  Random random(1);
  for (int k = 0; k < 1000; ++k)
  {
    const Eigen::Isometry3d preferred = pose(random.normal(), random.normal(), random.uniform(-3.0, 3.0));
    const Eigen::Isometry3d goal = planar({ random.normal(), random.normal(), random.uniform(-M_PI, M_PI) });
    const BaseErrors errors = baseErrors(goal * preferred, preferred);
    EXPECT_NEAR(errors.distance, goal.translation().x(), kRounding);
    EXPECT_NEAR(errors.tangential, goal.translation().y(), kRounding);
    EXPECT_NEAR(wrapped(errors.heading - std::atan2(goal(1, 0), goal(0, 0))), 0.0, kRounding);
  }
}

// The signs of the thesis' law: [yaw'; x'; y'] = diag(K_hdg, K_dst, K_tng) [e_hdg; e_dst; e_tng].
TEST(BaseCoordination, IsThreeProportionalLaws)
{
  CoordinationSettings s = unlimited();
  s.distance_gain = 1.0, s.tangential_gain = 2.0, s.heading_gain = 3.0;
  s.preferred = pose(0.0, 0.0, 0.0);
  s.dt = 0.1;  // the largest change in a tick is beyond these commands
  const auto command = [&](const Eigen::Isometry3d& actual) { return BaseCoordination(s).update(actual); };
  EXPECT_LT((command(pose(0.0, 0.0, 0.0))).norm(), kRounding);
  EXPECT_LT((command(pose(0.1, 0.0, 0.0)) - BaseTwist(0.1, 0.0, 0.0)).norm(), kRounding);
  EXPECT_LT((command(pose(0.0, 0.1, 0.0)) - BaseTwist(0.0, 0.2, 0.0)).norm(), kRounding);
  EXPECT_LT((command(pose(0.0, 0.0, 0.1)) - BaseTwist(0.0, 0.0, 0.3)).norm(), kRounding);
}

// With the end-effector at rest in the world the heading error decays with K_hdg and the distance of the base from its
// goal with K_dst = K_tng, each as if the other were not there.
TEST(BaseCoordination, ErrorsDecayIndependentlyOfEachOther)
{
  CoordinationSettings s = unlimited();
  s.distance_gain = s.tangential_gain = 1.2;
  s.heading_gain = 2.5;
  s.dt = 1e-4;
  Random random(2);
  for (int k = 0; k < 10; ++k)
  {
    const Eigen::Vector3d goal(random.normal(), random.normal(), random.uniform(-M_PI, M_PI));
    const Eigen::Isometry3d end_effector = planar(goal) * s.preferred;
    Eigen::Vector3d base = goal + Eigen::Vector3d(0.3 * random.normal(), 0.3 * random.normal(), random.uniform(-2, 2));
    const Eigen::Vector3d start = base - goal;
    BaseCoordination coordination(s);
    constexpr double kTime = 1.0;
    for (int i = 0; i < std::lround(kTime / s.dt); ++i)
      base = moved(base, coordination.update(planar(base).inverse() * end_effector), s.dt);
    // Euler steps: gain^2 dt t / 2 of the error, and the ramp to the first command, v^2 / (2 a)
    EXPECT_NEAR((base - goal).head<2>().norm(), std::exp(-1.2 * kTime) * start.head<2>().norm(), 3e-3);
    EXPECT_NEAR(base.z() - goal.z(), std::exp(-2.5 * kTime) * start.z(), 3e-2 * std::abs(start.z()));
  }
}

TEST(BaseCoordination, ObeysItsLimitsForAnyEndEffector)
{
  const CoordinationSettings s = settings();
  BaseCoordination coordination(s);
  Random random(3);
  BaseTwist last = BaseTwist::Zero();
  double fastest = 0.0;
  for (int k = 0; k < 20000; ++k)
  {
    Eigen::Isometry3d target = pose(3.0 * random.normal(), 3.0 * random.normal(), random.uniform(-M_PI, M_PI));
    for (int i = 0; i < (k % 20 == 0 ? 1000 : 1); ++i)
    {
      const BaseTwist command = coordination.update(target);
      ASSERT_LE(command.head<2>().norm(), s.speed + kRounding);
      ASSERT_LE(std::abs(command.z()), s.turn_rate + kRounding);
      ASSERT_LE((command - last).head<2>().norm(), s.acceleration * s.dt + kRounding);
      ASSERT_LE(std::abs(command.z() - last.z()), s.turn_acceleration * s.dt + kRounding);
      last = command;
      fastest = std::max(fastest, command.head<2>().norm());
    }
  }
  EXPECT_GT(fastest, 0.99 * s.speed);
}

// From several metres away: the limits act, and still the base arrives without passing its goal.
TEST(BaseCoordination, ArrivesWithoutOvershoot)
{
  const CoordinationSettings s = settings();
  BaseCoordination coordination(s);
  const Eigen::Vector3d goal(2.0, 0.0, 0.0);
  Eigen::Vector3d base = Eigen::Vector3d::Zero();
  for (int i = 0; i < 15000; ++i)
  {
    base = moved(base, coordination.update(planar(base).inverse() * planar(goal) * s.preferred), s.dt);
    ASSERT_LE(base.x(), goal.x() + 1e-9);
  }
  EXPECT_LT((base - goal).norm(), 1e-4);
}

TEST(BaseCoordination, RestsInTheDeadZoneAndEntersItContinuously)
{
  CoordinationSettings s = unlimited();
  s.dead_zone = 0.05;
  s.heading_dead_zone = 0.1;
  s.preferred = pose(0.0, 0.0, 0.0);
  s.dt = 0.1;
  const auto command = [&](const Eigen::Isometry3d& actual) { return BaseCoordination(s).update(actual); };
  EXPECT_EQ(command(pose(0.03, -0.03, 0.09)), BaseTwist::Zero());
  EXPECT_LT((command(pose(0.06, 0.0, -0.12)) - BaseTwist(0.01 * s.distance_gain, 0.0, -0.02 * s.heading_gain)).norm(),
            kRounding);
}

TEST(BaseCoordination, BrakesForAPoseThatIsNotFinite)
{
  const CoordinationSettings s = settings();
  BaseCoordination coordination(s);
  BaseTwist last;
  for (int i = 0; i < 2000; ++i)
    last = coordination.update(pose(3.0, 0.0, 1.0));
  ASSERT_GT(last.norm(), 0.4);
  Eigen::Isometry3d bad = pose(3.0, 0.0, 1.0);
  bad(0, 3) = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 1000; ++i)
  {
    const BaseTwist command = coordination.update(bad);
    ASSERT_LE((command - last).head<2>().norm(), s.acceleration * s.dt + kRounding);
    last = command;
  }
  EXPECT_EQ(last, BaseTwist::Zero());
}

TEST(BaseCoordination, RefusesSettingsOutOfRange)
{
  CoordinationSettings s = settings();
  s.distance_gain = -1.0;
  EXPECT_THROW(BaseCoordination{ s }, std::invalid_argument);
  s = settings();
  s.acceleration = 0.0;
  EXPECT_THROW(BaseCoordination{ s }, std::invalid_argument);
  s = settings();
  s.preferred(0, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(BaseCoordination{ s }, std::invalid_argument);
}

// The end-effector moves and turns steadily: the thesis' law lags v / K behind, v the speed of the goal, and the
// feed-forward takes the lag away.
TEST(BaseCoordination, LagsByTheSpeedOverTheGainUnlessFedForward)
{
  for (const double feedforward : { 0.0, 1.0 })
  {
    CoordinationSettings s = settings();
    s.feedforward = feedforward;
    BaseCoordination coordination(s);
    const Eigen::Vector3d motion(0.05, 0.02, 0.1);  // of the goal of the base, in its own axes
    Eigen::Vector3d goal = Eigen::Vector3d::Zero(), base = goal;
    for (int i = 0; i < 10000; ++i)
    {
      const Eigen::Isometry3d end_effector = planar(base).inverse() * planar(goal) * s.preferred;
      const Eigen::Vector2d lever = s.preferred.translation().head<2>();
      const double turned = goal.z() - base.z();
      Eigen::Vector3d tip = motion;  // of the end-effector over the ground, in the base's axes
      tip.head<2>() = Eigen::Rotation2Dd(turned) *
                      Eigen::Vector2d(motion.x() - motion.z() * lever.y(), motion.y() + motion.z() * lever.x());
      base = moved(base, coordination.update(end_effector, tip), s.dt);
      goal = moved(goal, motion, s.dt);
    }
    const BaseErrors& errors = coordination.errors();
    const double lag = (1.0 - feedforward) / s.distance_gain;
    EXPECT_NEAR(errors.heading, lag * motion.z(), 1e-4);  // what the goal moves in a tick
    EXPECT_NEAR(std::hypot(errors.distance, errors.tangential), lag * motion.head<2>().norm(), 1e-3);
  }
}

TEST(BaseCoordination, AllocatesNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "the address sanitizer needs malloc for itself";
  BaseCoordination coordination(settings());
  const Eigen::Isometry3d target = pose(2.0, 1.0, 0.5);
  BaseTwist command;
  EXPECT_EQ(phri_core::testing::countAllocations([&] { command = coordination.update(target); }), 0);
  EXPECT_GT(command.norm(), 0.0);
}
