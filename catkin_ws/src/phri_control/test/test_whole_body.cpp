#include "phri_control/whole_body.hpp"

#include <gtest/gtest.h>

#include <deque>
#include <limits>

#include "lwr_arm.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;
using phri_core::Random;
using phri_core::VectorDof;

namespace
{
constexpr double kDt = 0.001, kMillimetre = 1e-3;
constexpr double kHeight = 1.0;  // [m] of the end-effector

/// The tool points ahead, its x axis down.
Eigen::Matrix3d level()
{
  Eigen::Matrix3d result;
  result << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  return result;
}

Eigen::Isometry3d preferred()
{
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.translation() << 1.05, 0.3, kHeight;
  result.linear() = level();
  return result;
}

VectorJoints startPosture(const ArmKinematics& arm)
{
  InverseSettings settings;
  settings.posture = lwr::posture();
  Random random(1);
  const PostureResult result = findPosture(DifferentialInverse(arm, settings), preferred(), lwr::posture(), random);
  EXPECT_TRUE(result.converged);
  return result.posture;
}

WholeBodySettings settings(const ArmKinematics& arm)
{
  WholeBodySettings result;
  result.inverse.posture = startPosture(arm);
  result.coordination.preferred = preferred();
  return result;
}

/// An omnidirectional base: perfect, or a velocity loop of `bandwidth` [Hz] within acceleration limits, whose twist is
/// measured `delay` ticks late.
struct Base
{
  double bandwidth = 0.0, acceleration = 0.8, turn_acceleration = 1.5;
  int delay = 0;
  Eigen::Vector3d pose = Eigen::Vector3d::Zero();
  BaseTwist twist = BaseTwist::Zero();
  std::deque<BaseTwist> past = {};

  void step(const BaseTwist& command)
  {
    past.push_back(twist);
    if (static_cast<int>(past.size()) > delay + 1)
      past.pop_front();
    BaseTwist change = command - twist;
    if (bandwidth > 0.0)
    {
      change *= 1.0 - std::exp(-2.0 * M_PI * bandwidth * kDt);
      if (change.head<2>().norm() > acceleration * kDt)
        change.head<2>() *= acceleration * kDt / change.head<2>().norm();
      change.z() = std::max(-turn_acceleration * kDt, std::min(turn_acceleration * kDt, change.z()));
    }
    twist += change;
    const double half = 0.5 * twist.z() * kDt, chord = std::abs(half) > 1e-9 ? std::sin(half) / half : 1.0;
    pose.head<2>() += kDt * chord * (Eigen::Rotation2Dd(pose.z() + half) * Eigen::Vector2d(twist.head<2>()));
    pose.z() += twist.z() * kDt;
  }
  /// Odometry: exact pose, twist of the tick before or earlier.
  BaseState state() const { return { pose, delay == 0 || past.empty() ? twist : past.front() }; }
};

/// Planar velocity [x', y', yaw'] that wanders: new random targets every two seconds, smoothed.
class Wander
{
public:
  explicit Wander(std::uint64_t seed) : random_(seed) {}
  const Eigen::Vector3d& step()
  {
    if (ticks_++ % 2000 == 0)
    {
      const double speed = random_.uniform(0.1, 0.25), direction = random_.uniform(-M_PI, M_PI);
      target_ << speed * std::cos(direction), speed * std::sin(direction), random_.uniform(-0.2, 0.2);
    }
    middle_ += kDt / 0.2 * (target_ - middle_);
    velocity_ += kDt / 0.2 * (middle_ - velocity_);
    return velocity_;
  }

private:
  Random random_;
  long ticks_ = 0;
  Eigen::Vector3d target_ = Eigen::Vector3d::Zero(), middle_ = target_, velocity_ = target_;
};

struct Outcome
{
  double error = 0.0, angle = 0.0;  // [m, rad] largest, of the end-effector
  double path = 0.0, base_path = 0.0;
  double manipulability = 1.0, singular_value = 1.0, scale = 1.0, margin = 10.0;  // smallest
  double lag = 0.0;                                                               // [m] largest base error
};

/// The end-effector wanders in the inertial frame for `seconds`, the base follows, the joints' servos are perfect.
Outcome walk(std::uint64_t seed, double seconds, Base base, double feedforward = 0.0)
{
  const ArmKinematics arm = lwr::arm();
  WholeBodySettings whole = settings(arm);
  whole.coordination.feedforward = feedforward;
  WholeBody control(arm, whole);
  Wander wander(seed);
  VectorJoints q = control.inverse().settings().posture;
  VectorDof position = (Eigen::Vector3d() << preferred().translation().head<2>(), 0.0).finished();
  Outcome outcome;
  for (long k = 0; k < std::lround(seconds / kDt); ++k)
  {
    const Eigen::Vector3d velocity = wander.step();
    const EndEffectorCommand command = planarCommand(position, velocity, kHeight, level());
    const Twist error = poseError(command.pose, BaseState{ base.pose, base.twist }.transform() * lwr::forward(q));
    outcome.error = std::max(outcome.error, error.head<3>().norm());
    outcome.angle = std::max(outcome.angle, error.tail<3>().norm());
    const WholeBodyCommand result = control.update(q, base.state(), command);
    EXPECT_TRUE(result.arm.valid);
    outcome.manipulability = std::min(outcome.manipulability, result.arm.manipulability);
    outcome.singular_value = std::min(outcome.singular_value, result.arm.singular_value);
    outcome.scale = std::min(outcome.scale, result.arm.scale);
    const BaseErrors& errors = control.coordination().errors();
    outcome.lag = std::max(outcome.lag, std::hypot(errors.distance, errors.tangential));
    outcome.path += kDt * velocity.head<2>().norm();
    q += kDt * result.arm.velocity;
    base.step(result.base);
    outcome.base_path += kDt * base.twist.head<2>().norm();
    position += kDt * velocity;
    outcome.margin = std::min(outcome.margin, (arm.upper() - q).cwiseMin(q - arm.lower()).minCoeff());
  }
  return outcome;
}

/// [m] Acceleration that the odometry has not yet seen `delay` seconds after it began, against the pose feedback: the
/// base's own and that of its turning on the lever to the end-effector.
double lateError(const WholeBodySettings& s, double delay)
{
  const double lever = s.coordination.preferred.translation().head<2>().norm() + 0.2;  // and the largest lag
  return (s.coordination.acceleration + s.coordination.turn_acceleration * lever) * delay / s.inverse.pose_gain;
}
}  // namespace

// Several metres with the base behind: the end-effector does not notice. With perfect servos all that is left is the
// tick by which the odometry is late.
TEST(WholeBody, EndEffectorIsWhereTheAdmittanceSays)
{
  const WholeBodySettings s = settings(lwr::arm());
  const double bound = lateError(s, kDt);
  ASSERT_LT(bound, kMillimetre);
  for (std::uint64_t seed = 1; seed <= 4; ++seed)
  {
    for (const double bandwidth : { 0.0, 4.0 })  // perfect; 4 Hz within 0.8 m/s^2
    {
      Base base;
      base.bandwidth = bandwidth;
      const Outcome outcome = walk(seed, 60.0, base);
      EXPECT_LT(outcome.error, bound);
      EXPECT_LT(outcome.angle, kMillimetre);
      EXPECT_EQ(outcome.scale, 1.0);
      EXPECT_GT(outcome.path, 5.0);
      EXPECT_GT(outcome.base_path, 5.0);
      EXPECT_GT(outcome.margin, 0.2);  // [rad]
      EXPECT_GT(outcome.manipulability, 0.05);
      EXPECT_GT(outcome.singular_value, s.inverse.singular_value);  // never damped
    }
  }
}

// Odometry 20 ms late: the error grows in proportion, to a stated bound and not beyond.
TEST(WholeBody, LateOdometryCostsItsDelayTimesTheAcceleration)
{
  const WholeBodySettings s = settings(lwr::arm());
  Base base;
  base.bandwidth = 4.0;
  const double prompt = walk(1, 60.0, base).error;
  base.delay = 20;
  const double late = walk(1, 60.0, base).error;
  EXPECT_LT(late, lateError(s, (base.delay + 1) * kDt));
  EXPECT_GT(late, 5.0 * prompt);
}

TEST(WholeBody, FeedforwardKeepsTheArmNearItsPreferredPosture)
{
  Base base;
  base.bandwidth = 4.0;
  const Outcome thesis = walk(2, 60.0, base), own = walk(2, 60.0, base, 1.0);
  EXPECT_LT(own.lag, 0.6 * thesis.lag);
  EXPECT_GT(own.manipulability, thesis.manipulability);
  EXPECT_LT(own.error, lateError(settings(lwr::arm()), kDt));
}

// The base is turned and shifted by somebody else, the end-effector is to stand still: it does, because of the measured
// base twist and not of the feedback alone.
TEST(WholeBody, MotionOfTheBaseAloneDoesNotMoveTheEndEffector)
{
  for (const bool measured : { true, false })
  {
    const ArmKinematics arm = lwr::arm();
    WholeBodySettings s = settings(arm);
    s.base_moves = false;
    WholeBody control(arm, s);
    VectorJoints q = s.inverse.posture;
    Base base;
    base.bandwidth = 4.0;
    const Eigen::Isometry3d start = preferred();
    EndEffectorCommand command;
    command.pose = start;
    double error = 0.0, turned = 0.0;
    for (int k = 0; k < 20000; ++k)
    {
      const WholeBodyCommand result =
          control.update(q, { base.pose, measured ? base.twist : BaseTwist::Zero() }, command);
      EXPECT_EQ(result.base, BaseTwist::Zero());
      EXPECT_EQ(result.arm.scale, 1.0);
      q += kDt * result.arm.velocity;
      base.step({ 0.05 * std::sin(1.3 * k * kDt), 0.0, 0.15 * std::cos(0.9 * k * kDt) });
      const Eigen::Isometry3d actual = BaseState{ base.pose, base.twist }.transform() * lwr::forward(q);
      error = std::max(error, poseError(start, actual).head<3>().norm());
      turned = std::max(turned, std::abs(base.pose.z()));
    }
    EXPECT_GT(turned, 0.1);
    EXPECT_EQ(error < kMillimetre, measured) << error;
  }
}

// Whatever the base does, base and arm together give the commanded twist: checked by finite differences.
TEST(WholeBody, TwistsOfBaseAndArmAddUpToTheCommand)
{
  const ArmKinematics arm = lwr::arm(100.0);
  WholeBodySettings s = settings(arm);
  s.inverse.joint_acceleration = 1e4;
  s.inverse.pose_gain = 0.0;
  s.inverse.posture_gain = 0.0;
  WholeBody control(arm, s);
  Random random(5);
  for (int k = 0; k < 200; ++k)
  {
    VectorJoints q = s.inverse.posture;
    for (int i = 0; i < 7; ++i)
      q(i) += random.uniform(-0.2, 0.2);
    Base before;
    before.pose << random.normal(), random.normal(), random.uniform(-M_PI, M_PI);
    before.twist << random.normal(0.0, 0.3), random.normal(0.0, 0.3), random.normal(0.0, 0.5);
    EndEffectorCommand command;
    command.twist = lwr::randomTwist(random, 0.2, 0.3);
    const WholeBodyCommand result = control.update(q, before.state(), command);
    ASSERT_GT(result.arm.singular_value, s.inverse.singular_value);
    constexpr double kStep = 1e-5;
    Eigen::Isometry3d at[2];
    for (const int side : { 0, 1 })
    {
      const double h = side == 0 ? -kStep : kStep;
      BaseState state = before.state();
      state.pose.head<2>() +=
          h * (Eigen::Rotation2Dd(state.pose.z() + 0.5 * h * state.twist.z()) * Eigen::Vector2d(state.twist.head<2>()));
      state.pose.z() += h * state.twist.z();
      at[side] = state.transform() * lwr::forward(q + h * result.arm.velocity);
    }
    EXPECT_LT((poseError(at[1], at[0]) / (2.0 * kStep) - command.twist).norm(), 1e-7);
  }
}

TEST(WholeBody, FollowsAPointWithTheBaseFixed)
{
  const ArmKinematics arm = lwr::arm();
  WholeBodySettings s = settings(arm);
  s.base_moves = false;
  WholeBody control(arm, s);
  VectorJoints q = s.inverse.posture;
  BaseState base;
  base.pose << 1.0, -2.0, 2.0;
  const Eigen::Isometry3d start = base.transform() * preferred();
  VectorDof position = start.translation(), velocity = VectorDof::Zero(3);
  for (int k = 0; k < 4000; ++k)
  {
    velocity = (0.05 * Eigen::Vector3d(std::sin(k * kDt), std::cos(1.7 * k * kDt), std::sin(2.0 * k * kDt)));
    const WholeBodyCommand result = control.update(q, base, pointCommand(position, velocity, start.linear()));
    EXPECT_EQ(result.base, BaseTwist::Zero());
    q += kDt * result.arm.velocity;
    position += kDt * velocity;
    const Eigen::Isometry3d actual = base.transform() * lwr::forward(q);
    ASSERT_LT((actual.translation() - position).norm(), 1e-5);  // dt |v| |q'| / 2, over gain and tick
    ASSERT_LT((actual.linear() - start.linear()).norm(), 1e-4);
  }
  EXPECT_GT((position - VectorDof(start.translation())).norm(), 0.05);
}

TEST(WholeBody, StandsStillForWhatIsNotFinite)
{
  const ArmKinematics arm = lwr::arm();
  const WholeBodySettings s = settings(arm);
  EndEffectorCommand command;
  command.pose = preferred();
  command.pose.translation().x() += 0.05;
  const VectorJoints q = s.inverse.posture;
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  VectorJoints bad_q = q;
  bad_q(3) = kNaN;
  BaseState bad_base;
  bad_base.twist(1) = kNaN;
  EndEffectorCommand bad_command = command;
  bad_command.twist(0) = kNaN;
  for (int what = 0; what < 4; ++what)
  {
    WholeBody control(arm, s);
    const WholeBodyCommand result =
        control.update(what == 1 ? bad_q : q, what == 2 ? bad_base : BaseState{}, what == 3 ? bad_command : command);
    EXPECT_EQ(result.arm.valid, what == 0);
    EXPECT_EQ(result.arm.velocity.norm() > 0.0, what == 0);
    EXPECT_TRUE(result.base.allFinite());
  }
  WholeBodySettings other = s;
  other.coordination.dt = 0.002;
  EXPECT_THROW(WholeBody(arm, other), std::invalid_argument);
}

TEST(WholeBody, AllocatesNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "the address sanitizer needs malloc for itself";
  const ArmKinematics arm = lwr::arm();
  WholeBody control(arm, settings(arm));
  const VectorJoints q = control.inverse().settings().posture;
  const VectorDof position = Eigen::Vector3d(1.2, 0.3, 0.4), velocity = Eigen::Vector3d(0.2, 0.0, 0.1);
  WholeBodyCommand result;
  EXPECT_EQ(phri_core::testing::countAllocations(
                [&] { result = control.update(q, BaseState{}, planarCommand(position, velocity, kHeight, level())); }),
            0);
  EXPECT_GT(result.arm.velocity.norm(), 0.0);
  EXPECT_GT(result.base.norm(), 0.0);
}
