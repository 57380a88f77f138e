#include "../ros/robot_tick.hpp"

#include <gtest/gtest.h>

#include <functional>

#include "lwr_arm.hpp"
#include "phri_control/force_sensor.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;
using phri_core::FaultCode;
using phri_core::LoopState;
using phri_core::VectorDof;

namespace
{
constexpr double kDt = 0.001, kMass = 10.0, kDamping = 80.0, kForce = 8.0;
constexpr int kSettled = 1500;            // ticks: 12 time constants M / D
constexpr double kSpeedTolerance = 1e-4;  // [m/s] what the pose feedback corrects of Euler's error in the joints
constexpr double kCalm = 1e-3;            // [rad/s]

/// An ideal robot: joints and base move as told, readings are exact and on time.
struct Rig
{
  explicit Rig(RobotTickSettings settings = {}, const std::function<void(LoopSettings&)>& change = {})
    : settings(settings), arm(lwr::arm()), tick(settings, loopSettings(settings, change), arm, body(), sensor())
  {
    q = lwr::posture();
  }

  static LoopSettings loopSettings(const RobotTickSettings& settings, const std::function<void(LoopSettings&)>& change)
  {
    LoopSettings loop;
    loop.mass = VectorDof::Constant(3, kMass);
    loop.damping = VectorDof::Constant(3, kDamping);
    loop.safety.rotations = settings.planar ? 1 : 0;
    loop.safety.workspace = 10.0;
    if (change)
      change(loop);
    return loop;
  }
  WholeBodySettings body() const
  {
    WholeBodySettings result;
    result.inverse.posture = lwr::posture();
    result.coordination.preferred = arm.forward(lwr::posture());
    result.base_moves = settings.mobile;
    return result;
  }
  static Eigen::Isometry3d sensor()
  {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, -1).normalized()).toRotationMatrix();
    pose.translation() << 0.01, -0.02, -0.15;
    return pose;
  }

  Eigen::Isometry3d tip() const { return base.transform() * arm.forward(q); }

  /// One cycle with a hand that exerts `push` (force and torque about the tip, inertial axes) on the tip.
  const RobotOutput& step(const Vector6d& push = Vector6d::Zero())
  {
    now += 1000000;
    if (joints_on)
      tick.post(JointSample{ q, rates, now });
    if (settings.mobile && odometry_on)
      tick.post(OdometrySample{ base, now });
    if (wrench_on)
    {
      WrenchSample sample;
      Eigen::Isometry3d from_tip = Eigen::Isometry3d::Identity();  // inertial axes at the tip, seen from the sensor
      const Eigen::Isometry3d at = tip() * sensor();
      from_tip.linear() = at.linear().transpose();
      from_tip.translation() = at.linear().transpose() * (tip().translation() - at.translation());
      sample.wrench = transformWrench(from_tip, push);
      sample.receive_ns = sample.stamp_ns = now;
      sample.sequence = ++sequence;
      sample.right_frame = right_frame;
      tick.post(sample);
    }
    const RobotOutput& out = tick.step(now);
    const Eigen::Vector3d before = tip().translation();
    if (follows)
    {
      rates = out.rates;
      q += kDt * out.rates;
      base.twist = out.base;
      const double c = std::cos(base.pose.z()), s = std::sin(base.pose.z());
      base.pose +=
          kDt * Eigen::Vector3d(c * out.base.x() - s * out.base.y(), s * out.base.x() + c * out.base.y(), out.base.z());
    }
    velocity = (tip().translation() - before) / kDt;
    return out;
  }
  void run(int ticks, const Vector6d& push = Vector6d::Zero())
  {
    for (int i = 0; i < ticks; ++i)
      step(push);
  }
  void start()
  {
    run(5);
    tick.loop().start();
    run(1);
  }
  LoopState state() { return tick.loop().record().state; }

  RobotTickSettings settings;
  ArmKinematics arm;
  RobotTick tick;
  VectorJoints q, rates = VectorJoints::Zero(7);
  BaseState base;
  Eigen::Vector3d velocity{ 0, 0, 0 };
  std::int64_t now = 0;
  std::uint64_t sequence = 0;
  bool joints_on = true, wrench_on = true, odometry_on = true, right_frame = true, follows = true;
};

Vector6d force(double x, double y, double z)
{
  return (Vector6d() << x, y, z, 0, 0, 0).finished();
}

RobotTickSettings point()
{
  RobotTickSettings settings;
  settings.planar = false;
  return settings;
}

RobotTickSettings planarMobile()
{
  RobotTickSettings settings;
  settings.mobile = true;
  return settings;
}
}  // namespace

// M xdd + D xd = u: in the steady state the tip itself moves at F / D along the push, in inertial axes, though the
// sensor sits elsewhere and turned.
TEST(RobotTick, YieldsAsTheAdmittanceSays)
{
  for (int axis = 0; axis < 3; ++axis)
  {
    Rig rig(point());
    rig.start();
    const Eigen::Matrix3d turned = rig.tip().linear();
    Vector6d push = Vector6d::Zero();
    push(axis) = axis == 0 ? -kForce : kForce;
    rig.run(kSettled, push);
    EXPECT_LT((rig.velocity - push.head<3>() / kDamping).norm(), kSpeedTolerance) << "axis " << axis;
    EXPECT_LT((rig.tip().linear() - turned).norm(), 1e-3);  // the orientation is kept
    rig.run(kSettled);
    EXPECT_LT(rig.velocity.norm(), kSpeedTolerance);
  }
}

// Planar with a base that is turned by 90 degrees and follows: a push along the inertial x, and a turning moment.
TEST(RobotTick, PlanarOnAnOmnidirectionalBase)
{
  Rig rig(planarMobile(), [](LoopSettings& loop) { loop.damping(2) = 7.0, loop.mass(2) = 0.3; });
  rig.base.pose << 1.0, -2.0, 0.5 * M_PI;
  rig.start();
  const double height = rig.tip().translation().z();
  rig.run(3 * kSettled, force(kForce, 0, 0));
  EXPECT_NEAR(rig.velocity.x(), kForce / kDamping, 20 * kSpeedTolerance);  // the base accelerates meanwhile
  EXPECT_NEAR(rig.velocity.y(), 0.0, 20 * kSpeedTolerance);
  EXPECT_NEAR(rig.tip().translation().z(), height, 1e-4);
  EXPECT_GT(rig.base.pose.x(), 1.1);  // the base came along
  rig.run(kSettled);
  Vector6d turn = Vector6d::Zero();
  turn(5) = 0.7;
  const double before = rig.tick.loop().record().position(2);
  rig.run(2000, turn);
  // from rest: T / D (t - M / D)
  EXPECT_NEAR(rig.tick.loop().record().position(2) - before, 0.1 * (2.0 - 0.3 / 7.0), 2e-3);
}

TEST(RobotTick, StandsStillBeforeTheStart)
{
  Rig rig(point());
  for (int i = 0; i < 500; ++i)
    ASSERT_TRUE(rig.step(force(50, 0, 0)).rates.isZero(0.0));
  EXPECT_EQ(rig.state(), LoopState::Idle);
}

// Somebody drives the robot elsewhere while it is stopped: no start may bring it back.
TEST(RobotTick, StartsWhereTheToolIs)
{
  Rig rig(point());
  rig.start();
  rig.run(500, force(0, kForce, 0));
  rig.tick.loop().stop();
  rig.run(200);
  rig.q(0) += 0.5;
  rig.q(3) -= 0.2;
  rig.start();
  ASSERT_EQ(rig.state(), LoopState::Passive);
  const Eigen::Vector3d there = rig.tip().translation();
  rig.run(500);
  EXPECT_LT((rig.tip().translation() - there).norm(), 1e-6);
  EXPECT_LT(rig.tick.loop().record().position.norm(), 1e-6);  // the origin came along
}

TEST(RobotTick, FixedOriginStays)
{
  RobotTickSettings settings = point();
  settings.origin_fixed = true;
  settings.origin << 0.5, 0.1, 0.9;
  Rig rig(settings);
  rig.start();
  EXPECT_LT((rig.tick.loop().record().position - VectorDof(rig.tip().translation() - settings.origin)).norm(), 1e-12);
}

// The watchdog acts in the very cycle in which the age passes its bound, and only what was not located stops at once.
TEST(RobotTick, StaleJointStatesStopInTheSameCycle)
{
  Rig rig(point());
  rig.start();
  rig.run(kSettled, force(0, 0, kForce));
  rig.joints_on = false;
  rig.follows = false;
  for (int age = 1; age <= 20; ++age)
    ASSERT_GT(rig.step(force(0, 0, kForce)).rates.norm(), kCalm) << age << " ms";
  const RobotOutput& out = rig.step(force(0, 0, kForce));
  EXPECT_TRUE(out.rates.isZero(0.0));
  EXPECT_TRUE(out.tool.isZero(0.0));
  EXPECT_EQ(out.record.state, LoopState::Fault);
  EXPECT_EQ(out.record.fault, FaultCode::PositionInvalid);
  EXPECT_EQ(out.cause, Hindrance::JointsStale);
  for (int i = 0; i < 1000; ++i)
    ASSERT_TRUE(rig.step().rates.isZero(0.0));
  rig.joints_on = true;  // back again: it stays in FAULT and still until somebody clears it
  for (int i = 0; i < 1500; ++i)
    ASSERT_TRUE(rig.step().rates.isZero(0.0));
  EXPECT_EQ(rig.state(), LoopState::Fault);
  rig.tick.loop().clearFault();
  rig.run(2);
  EXPECT_EQ(rig.state(), LoopState::Idle);
}

TEST(RobotTick, StaleOdometryStops)
{
  Rig rig(planarMobile());
  rig.start();
  rig.run(500, force(kForce, 0, 0));
  rig.odometry_on = false;
  rig.run(99, force(kForce, 0, 0));
  EXPECT_EQ(rig.state(), LoopState::Passive);
  rig.run(3, force(kForce, 0, 0));
  const RobotOutput& out = rig.step();
  EXPECT_EQ(out.record.fault, FaultCode::PositionInvalid);
  EXPECT_EQ(out.cause, Hindrance::OdometryStale);
  EXPECT_TRUE(out.rates.isZero(0.0) && out.base.isZero(0.0));
}

TEST(RobotTick, ReadingsThatAreNoNumbersStop)
{
  Rig rig(point());
  rig.start();
  rig.q(2) = std::numeric_limits<double>::quiet_NaN();
  const RobotOutput& out = rig.step(force(kForce, 0, 0));
  EXPECT_EQ(out.record.fault, FaultCode::PositionInvalid);
  EXPECT_EQ(out.cause, Hindrance::NoJoints);
  EXPECT_TRUE(out.rates.isZero(0.0));
}

// Wrench faults leave the robot located: it comes to rest by the loop's damped stop, not by a jerk, and then is still.
TEST(RobotTick, WrenchFaultsStopByDamping)
{
  for (const bool frame : { true, false })
  {
    Rig rig(point());
    rig.start();
    rig.run(kSettled, force(0, kForce, 0));
    (frame ? rig.right_frame : rig.wrench_on) = false;
    double before = rig.velocity.norm();
    int moving = 0;
    for (int i = 0; i < 700; ++i)
    {
      rig.step(force(0, kForce, 0));
      ASSERT_LE(rig.velocity.norm(), before + kSpeedTolerance);
      ASSERT_GT(rig.velocity.norm(), before - 0.01);  // [m/s] per ms: 10 m/s^2
      before = rig.velocity.norm();
      moving += rig.rates.isZero(0.0) ? 0 : 1;
    }
    EXPECT_EQ(rig.tick.loop().record().fault, frame ? FaultCode::WrenchFrame : FaultCode::WrenchStale);
    EXPECT_LE(moving, int((RobotTick::kFaultStop + 0.025) / kDt));
    EXPECT_TRUE(rig.rates.isZero(0.0));
  }
}

TEST(RobotTick, StopsByARamp)
{
  Rig rig(point());
  rig.start();
  rig.run(kSettled, force(0, kForce, 0));
  const double speed = rig.rates.norm();
  rig.tick.loop().stop();
  for (int i = 1; i <= 100; ++i)
  {
    rig.step();
    ASSERT_NEAR(rig.rates.norm(), speed * (1.0 - i / 100.0), 1e-9) << i << " ms after the stop";
  }
  EXPECT_EQ(rig.state(), LoopState::Idle);
}

// Brakes are on, or another controller has the robot: it must not be chased after they let go.
TEST(RobotTick, RobotThatDoesNotFollow)
{
  Rig rig(point());
  rig.start();
  rig.follows = false;
  int ticks = 0;
  while (rig.state() == LoopState::Passive && ++ticks < 5000)
    rig.step(force(kForce, 0, 0));
  EXPECT_EQ(rig.step().cause, Hindrance::NotFollowing);
  // x(t) = F / D (t - M / D (1 - exp(-t D / M))) is 50 mm after 0.62 s
  EXPECT_NEAR(ticks * kDt, 0.62, 0.01);
  rig.follows = true;
  const VectorJoints there = rig.q;
  rig.run(1200);
  rig.tick.loop().clearFault();
  rig.run(2);
  ASSERT_EQ(rig.state(), LoopState::Idle);
  rig.start();
  rig.run(500);
  EXPECT_EQ(rig.state(), LoopState::Passive);
  EXPECT_LT((rig.q - there).norm(), 1e-6);
}

TEST(RobotTick, DryRunMovesNothing)
{
  RobotTickSettings settings = point();
  settings.dry_run = true;
  Rig rig(settings);
  rig.start();
  for (int i = 0; i < 2000; ++i)
    ASSERT_TRUE(rig.step(force(kForce, 0, 0)).rates.isZero(0.0));
  EXPECT_EQ(rig.state(), LoopState::Passive);
  EXPECT_NEAR(rig.step(force(kForce, 0, 0)).commanded(0), kForce / kDamping, kSpeedTolerance);
}

// For robots that take the tool's twist instead of joint rates: it is the motion of the tip, in axes of the base link.
TEST(RobotTick, TwistIsTheMotionOfTheTip)
{
  Rig rig(point());
  rig.start();
  rig.run(300, force(-kForce, 0.5 * kForce, kForce));
  const RobotOutput& out = rig.step(force(-kForce, 0.5 * kForce, kForce));
  EXPECT_LT((out.tool.head<3>() - rig.velocity).norm(), kSpeedTolerance);
  EXPECT_LT(out.tool.tail<3>().norm(), 1e-3);
}

TEST(RobotTick, AllocatesNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP();
  Rig rig(planarMobile());
  EXPECT_EQ(phri_core::testing::countAllocations([&rig] { rig.run(10); }), 0);  // IDLE: placed anew in each
  rig.tick.loop().start();
  EXPECT_EQ(phri_core::testing::countAllocations([&rig] { rig.run(100, force(kForce, 0, 0)); }), 0);
  rig.joints_on = false;
  EXPECT_EQ(phri_core::testing::countAllocations([&rig] { rig.run(100); }), 0);
  EXPECT_EQ(rig.state(), LoopState::Fault);
}

TEST(RobotTick, BadSettings)
{
  RobotTickSettings settings = point();
  settings.joint_age = 0.0;
  EXPECT_THROW(Rig{ settings }, std::invalid_argument);
  EXPECT_THROW(Rig(point(),
                   [](LoopSettings& loop) {
                     loop.mass = VectorDof::Constant(2, kMass);
                     loop.damping = VectorDof::Constant(2, kDamping);
                   }),
               std::invalid_argument);
}
