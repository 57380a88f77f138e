#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <limits>

#include "lwr_arm.hpp"
#include "phri_control/kinematics.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;
using phri_core::Random;

namespace
{
constexpr double kRounding = 1e-12;  // sums of a few products of numbers around 1
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

VectorJoints plus(const VectorJoints& q, int joint, double by)
{
  VectorJoints result = q;
  result(joint) += by;
  return result;
}

Eigen::VectorXd singularValues(const ArmJacobian& jacobian, double length)
{
  Eigen::MatrixXd weighted = jacobian;
  weighted.bottomRows<3>() *= length;
  return weighted.jacobiSvd().singularValues();
}

InverseSettings towards(const VectorJoints& posture)
{
  InverseSettings settings;
  settings.posture = posture;
  return settings;
}
}  // namespace

// Where nothing limits, the joint velocities move the tip exactly as asked, and the posture's motion not at all.
TEST(DifferentialInverse, IsExactAwayFromSingularitiesAndLimits)
{
  const ArmKinematics arm = lwr::arm(100.0);
  InverseSettings settings = towards(lwr::posture());
  settings.joint_acceleration = 1e4;
  const DifferentialInverse inverse(arm, settings);
  Random random(4);
  int tried = 0;
  for (int k = 0; k < 2000; ++k)
  {
    const VectorJoints q = lwr::randomPosture(arm, random, 0.3);
    ArmJacobian jacobian;
    const Eigen::Isometry3d pose = arm.forward(q, jacobian);
    const double smallest = singularValues(jacobian, settings.length)(5);
    const Twist twist = lwr::randomTwist(random, 0.1, 0.3);
    const ArmRates rates = inverse.solve(q, pose, twist);
    ASSERT_TRUE(rates.valid);
    EXPECT_NEAR(rates.singular_value, smallest, 1e-7);  // root of an eigenvalue
    EXPECT_NEAR(rates.manipulability, manipulability(jacobian), 1e-8);
    if (smallest < settings.singular_value)
      continue;
    ++tried;
    EXPECT_EQ(rates.scale, 1.0);
    // the floor (1e-3 eps)^2 under the squares lets through floor / sigma of the posture's motion
    const double leak = 1e-6 * settings.singular_value * std::sqrt(7.0) * settings.posture_velocity;
    EXPECT_LT((jacobian * rates.velocity - twist).norm(), leak / settings.length);
    const ArmRates resting = inverse.solve(q, pose, Twist::Zero());
    EXPECT_GT(resting.velocity.dot(settings.posture - q), 0.0);  // the posture attracts
  }
  EXPECT_GT(tried, 1000);
}

// |q'| <= 2 / (sqrt(3) eps) |W v| in every posture; without damping the straight arm would need an infinite speed.
TEST(DifferentialInverse, StaysBoundedAndContinuousInSingularPostures)
{
  const ArmKinematics arm = lwr::arm(1e6);
  InverseSettings settings = towards(lwr::posture());
  settings.posture_gain = 0.0;
  settings.joint_acceleration = 1e4;
  const DifferentialInverse inverse(arm, settings);
  const double bound = 2.0 / (std::sqrt(3.0) * settings.singular_value);
  Random random(5);
  double largest = 0.0;
  for (int k = 0; k < 5000; ++k)
  {
    const double size = std::pow(10.0, random.uniform(-7.0, 0.0));
    VectorJoints q(7);
    for (int i = 0; i < 7; ++i)
      q(i) = size * random.normal();
    Twist twist = lwr::randomTwist(random, 0.1, 0.1);
    const double weighted = std::hypot(twist.head<3>().norm(), settings.length * twist.tail<3>().norm());
    const ArmRates rates = inverse.solve(q, Eigen::Isometry3d::Identity(), twist, false);
    ASSERT_TRUE(rates.valid);
    EXPECT_LE(rates.velocity.norm(), bound * weighted * (1.0 + 1e-9));
    largest = std::max(largest, rates.velocity.norm() / weighted);
    const ArmRates beside = inverse.solve(plus(q, 3, 1e-9), Eigen::Isometry3d::Identity(), twist, false);
    EXPECT_LT((beside.velocity - rates.velocity).norm(), 1e-9 * 10.0 * weighted * bound / settings.singular_value);
  }
  EXPECT_GT(largest, 0.5 * bound);  // the worst directions were among them
  // pulling a straight arm further out: nothing moves, and nothing breaks
  Twist out = Twist::Zero();
  out.head<3>() = lwr::mount().linear().col(2);
  EXPECT_LT(inverse.solve(VectorJoints::Zero(7), lwr::mount(), out, false).velocity.norm(), 1e-6);
}

// 10^4 random twists, far beyond what the arm can do, each held for 20 ms.
TEST(DifferentialInverse, NeverViolatesTheFunnelAndKeepsTheDirection)
{
  const ArmKinematics arm = lwr::arm();
  const InverseSettings settings = towards(lwr::posture());
  const DifferentialInverse inverse(arm, settings);
  Random random(6);
  VectorJoints q = lwr::posture();
  int limited = 0, compared = 0;
  double nearest = 1.0;
  for (int k = 0; k < 10000; ++k)
  {
    const Twist twist = lwr::randomTwist(random, 0.5, 1.5);
    for (int tick = 0; tick < 20; ++tick)
    {
      ArmJacobian jacobian;
      const Eigen::Isometry3d pose = arm.forward(q, jacobian);
      const ArmRates rates = inverse.solve(q, pose, jacobian, pose, twist);
      ASSERT_TRUE(rates.valid);
      ASSERT_LE((rates.velocity.cwiseAbs() - arm.velocity()).maxCoeff(), kRounding);
      for (int i = 0; i < 7; ++i)  // braking from here, tick by tick, stays within the limits
      {
        double x = q(i), v = rates.velocity(i);
        for (x += settings.dt * v; std::abs(v) > 0.0; x += settings.dt * v)
          v = std::copysign(std::max(0.0, std::abs(v) - settings.joint_acceleration * settings.dt), v);
        ASSERT_LT(x, arm.upper()(i) - settings.limit_margin + 1e-9);
        ASSERT_GT(x, arm.lower()(i) + settings.limit_margin - 1e-9);
      }
      if (tick == 0 && rates.singular_value > settings.singular_value)
      {
        ++compared;
        limited += rates.scale < 1.0;
        // through the floor under the singular values, times the fastest null motion
        ASSERT_LT((jacobian * rates.velocity - rates.scale * twist).norm(), 2e-3);
      }
      q += settings.dt * rates.velocity;
      nearest = std::min(nearest, (arm.upper() - q).cwiseMin(q - arm.lower()).minCoeff());
    }
    if (k % 100 == 99)
      q = lwr::randomPosture(arm, random, 0.1);
  }
  EXPECT_GT(limited, compared / 4);
  EXPECT_LT(nearest, settings.limit_margin + 1e-3);  // the limits were reached
}

// With seven joints the null space is a line: a search along it must not find a larger share of the twist.
TEST(DifferentialInverse, TakesTheLargestShareOfTheTwist)
{
  const ArmKinematics arm = lwr::arm();
  const InverseSettings settings = towards(lwr::posture());
  const DifferentialInverse inverse(arm, settings);
  Random random(7);
  int compared = 0;
  for (int k = 0; k < 1000; ++k)
  {
    const VectorJoints q = lwr::randomPosture(arm, random, 0.03);
    const Twist twist = lwr::randomTwist(random, 0.3, 1.0);
    ArmJacobian jacobian;
    const Eigen::Isometry3d pose = arm.forward(q, jacobian);
    const ArmRates rates = inverse.solve(q, pose, jacobian, pose, twist);
    if (rates.scale == 1.0 || rates.singular_value < settings.singular_value)
      continue;
    ++compared;
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(Eigen::MatrixXd(jacobian), Eigen::ComputeFullU | Eigen::ComputeFullV);
    const VectorJoints task = svd.solve(twist), null = svd.matrixV().col(6);
    const VelocityBounds bounds = jointFunnel(arm, q, settings.joint_acceleration, settings.limit_margin, settings.dt);
    double best = 0.0;
    constexpr int kGrid = 4000;
    for (int i = -kGrid; i <= kGrid; ++i)
    {
      const VectorJoints offset = 6.0 * i / kGrid * null;
      double share = 1.0;
      for (int j = 0; j < 7; ++j)
      {
        if (offset(j) > bounds.upper(j) || offset(j) < bounds.lower(j))  // the interval of s may not begin at 0
        {
          const double bound = offset(j) > bounds.upper(j) ? bounds.upper(j) : bounds.lower(j);
          const double from = (bound - offset(j)) / task(j);
          if (!(from >= 0.0 && from <= 1.0))
            share = -1.0;
        }
      }
      if (share < 0.0)
        continue;
      for (int j = 0; j < 7; ++j)
        share = std::min(share, ((task(j) > 0.0 ? bounds.upper(j) : bounds.lower(j)) - offset(j)) / task(j));
      const VectorJoints sum = share * task + offset;
      if (((sum - bounds.upper).array() < 1e-9).all() && ((bounds.lower - sum).array() < 1e-9).all())
        best = std::max(best, share);
    }
    EXPECT_LE(best, rates.scale + 1e-6);
    EXPECT_GT(best, rates.scale - 0.02);  // the grid's resolution
  }
  EXPECT_GT(compared, 200);
}

// Integrated for a minute on a circle, the pose stays; without feedback the integration's error accumulates.
TEST(DifferentialInverse, FeedbackKeepsTheSolutionFromDrifting)
{
  const ArmKinematics arm = lwr::arm();
  double error[2], start_error = 0.0;
  for (const bool correct : { true, false })
  {
    InverseSettings settings = towards(lwr::posture());
    const DifferentialInverse inverse(arm, settings);
    VectorJoints q = lwr::posture();
    const Eigen::Isometry3d start = arm.forward(q);
    Eigen::Isometry3d goal = start;
    constexpr double kRadius = 0.08, kRate = 1.0;
    for (int k = 0; k < 60000; ++k)
    {
      const double angle = kRate * k * settings.dt;
      goal.translation() = start.translation() + kRadius * Eigen::Vector3d(0.0, std::sin(angle), std::cos(angle) - 1.0);
      Twist twist = Twist::Zero();
      twist.segment<2>(1) << kRadius * kRate * std::cos(angle), -kRadius * kRate * std::sin(angle);
      const ArmRates rates = inverse.solve(q, goal, twist, correct);
      ASSERT_EQ(rates.scale, 1.0);
      error[correct] = poseError(goal, arm.forward(q)).norm();
      q += settings.dt * rates.velocity;
    }
    // 10 mm off: the feedback takes it back at its gain, exp(-20 t), up to the Euler steps
    goal = arm.forward(q);
    goal.translation().x() += 0.004;
    for (int k = 0; k <= 100; ++k)
    {
      start_error = poseError(goal, arm.forward(q)).norm();
      q += settings.dt * inverse.solve(q, goal, Twist::Zero(), correct).velocity;
    }
    EXPECT_NEAR(start_error, correct ? 0.004 * std::pow(1.0 - settings.pose_gain * settings.dt, 100) : 0.004, 2e-5);
  }
  EXPECT_LT(error[1], 1e-5);  // dt |v| |q'| / (2 gain)
  EXPECT_GT(error[0], 10.0 * error[1]);
}

// A pose a metre and a turn away, a posture far away: feedback, posture's motion and joints keep to their largest
// speeds.
TEST(DifferentialInverse, FeedbackPostureAndShareAreLimited)
{
  const ArmKinematics arm = lwr::arm();
  InverseSettings settings = towards(VectorJoints::Constant(7, 1.5));
  settings.posture_gain = 0.0;
  const VectorJoints q = lwr::posture();
  ArmJacobian jacobian;
  Eigen::Isometry3d goal = arm.forward(q, jacobian);
  goal.translation() += Eigen::Vector3d(0.6, 0.0, 0.8);
  goal.linear() = Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitX()) * goal.linear();
  const ArmRates rates = DifferentialInverse(arm, settings).solve(q, goal, Twist::Zero());
  Twist expected;
  expected << settings.feedback_linear * Eigen::Vector3d(0.6, 0.0, 0.8), settings.feedback_angular, 0.0, 0.0;
  ASSERT_EQ(rates.scale, 1.0);
  EXPECT_LT((jacobian * rates.velocity - expected).norm(), 1e-9);
  settings.posture_gain = 100.0;
  const VectorJoints still = DifferentialInverse(arm, settings).solve(q, goal, Twist::Zero(), false).velocity;
  EXPECT_LE(still.norm(), std::sqrt(7.0) * settings.posture_velocity);  // a projection makes nothing longer
  EXPECT_GT(still.norm(), 0.01);
  settings.velocity_share = 0.01;
  const VectorJoints slow = DifferentialInverse(arm, settings).solve(q, goal, Twist::Constant(0.3)).velocity;
  EXPECT_LE((slow - 0.01 * arm.velocity()).maxCoeff(), kRounding);
}

// The manipulability's gradient moves the arm within the null space only, and upward.
TEST(DifferentialInverse, ClimbsTheManipulabilityWithTheTipAtRest)
{
  const ArmKinematics arm = lwr::arm();
  InverseSettings settings = towards(lwr::posture());
  settings.posture_gain = 0.0;
  settings.manipulability_gain = 20.0;
  const DifferentialInverse inverse(arm, settings);
  VectorJoints q = lwr::posture();
  q << 0.5, -0.9, 1.2, 1.4, -0.8, 0.9, 0.3;
  const Eigen::Isometry3d pose = arm.forward(q);
  double last = inverse.solve(q, pose, Twist::Zero()).manipulability;
  const double first = last;
  for (int k = 0; k < 3000; ++k)
  {
    q += settings.dt * inverse.solve(q, pose, Twist::Zero()).velocity;
    const double now = inverse.solve(q, pose, Twist::Zero()).manipulability;
    ASSERT_GT(now, last - 1e-8);
    last = now;
    ASSERT_LT(poseError(pose, arm.forward(q)).norm(), 1e-5);
  }
  EXPECT_GT(last, 1.05 * first);
}

TEST(FindPosture, InvertsTheForwardKinematics)
{
  const ArmKinematics arm = lwr::arm();
  const DifferentialInverse inverse(arm, towards(lwr::posture()));
  Random random(8);
  for (int k = 0; k < 200; ++k)
  {
    const Eigen::Isometry3d pose = arm.forward(lwr::randomPosture(arm, random, 0.1));
    const PostureResult result = findPosture(inverse, pose, lwr::posture(), random, 100);
    ASSERT_TRUE(result.converged) << "pose " << k << ", error " << result.error;
    EXPECT_LT((lwr::forward(result.posture).matrix() - pose.matrix()).norm(), 1e-8);
    EXPECT_LE((result.posture - arm.upper()).maxCoeff(), -0.02 + kRounding);
    EXPECT_LE((arm.lower() - result.posture).maxCoeff(), -0.02 + kRounding);
  }
  Eigen::Isometry3d far = lwr::mount();
  far.translation().x() += 2.0;  // the arm is 1.38 m long
  const PostureResult result = findPosture(inverse, far, lwr::posture(), random, 3);
  EXPECT_FALSE(result.converged);
  EXPECT_GT(result.error, 0.5);
  EXPECT_THROW(findPosture(inverse, far, VectorJoints::Zero(6), random), std::invalid_argument);
}

TEST(DifferentialInverse, StandsStillForWhatIsNotFinite)
{
  const ArmKinematics arm = lwr::arm();
  const DifferentialInverse inverse(arm, InverseSettings{});
  const VectorJoints q = lwr::posture();
  const Eigen::Isometry3d pose = arm.forward(q);
  const Twist twist = Twist::Constant(0.1);
  ASSERT_TRUE(inverse.solve(q, pose, twist).valid);
  ASSERT_GT(inverse.solve(q, pose, twist).velocity.norm(), 0.0);
  Eigen::Isometry3d bad_pose = pose;
  bad_pose(1, 2) = kNaN;
  Twist bad_twist = twist;
  bad_twist(4) = std::numeric_limits<double>::infinity();
  for (const ArmRates& rates : { inverse.solve(plus(q, 2, kNaN), pose, twist), inverse.solve(q, bad_pose, twist),
                                 inverse.solve(q, pose, bad_twist), inverse.solve(VectorJoints::Zero(6), pose, twist) })
  {
    EXPECT_FALSE(rates.valid);
    EXPECT_EQ(rates.velocity, VectorJoints::Zero(7));
  }
  EXPECT_TRUE(inverse.solve(q, bad_pose, twist, false).valid);
  const ArmRates huge = inverse.solve(q, pose, Twist::Constant(1e300));
  EXPECT_TRUE(huge.velocity.allFinite());
  EXPECT_LE((huge.velocity.cwiseAbs() - arm.velocity()).maxCoeff(), kRounding);
}

TEST(DifferentialInverse, RefusesSettingsOutOfRange)
{
  const ArmKinematics arm = lwr::arm();
  InverseSettings settings;
  settings.singular_value = 0.0;
  EXPECT_THROW(DifferentialInverse(arm, settings), std::invalid_argument);
  settings = InverseSettings{};
  settings.pose_gain = 600.0;  // above 1 / (2 dt)
  EXPECT_THROW(DifferentialInverse(arm, settings), std::invalid_argument);
  settings = InverseSettings{};
  settings.posture = VectorJoints::Zero(6);
  EXPECT_THROW(DifferentialInverse(arm, settings), std::invalid_argument);
}

TEST(DifferentialInverse, AllocatesNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "the address sanitizer needs malloc for itself";
  const ArmKinematics arm = lwr::arm();
  InverseSettings settings = towards(lwr::posture());
  settings.manipulability_gain = 1.0;
  const DifferentialInverse inverse(arm, settings);
  Random random(9);
  double scale = 1.0;
  for (int k = 0; k < 100; ++k)
  {
    const VectorJoints q = lwr::randomPosture(arm, random);
    const Eigen::Isometry3d pose = arm.forward(lwr::posture());
    const Twist twist = lwr::randomTwist(random, 0.3, 1.0);
    EXPECT_EQ(
        phri_core::testing::countAllocations([&] { scale = std::min(scale, inverse.solve(q, pose, twist).scale); }), 0);
  }
  EXPECT_LT(scale, 1.0);  // the limits acted
}
