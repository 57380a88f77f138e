#include "phri_control/kinematics.hpp"

#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <kdl_parser/kdl_parser.hpp>

#include "lwr_arm.hpp"

using namespace phri_control;
using phri_core::Random;

namespace
{
constexpr double kRounding = 1e-12;   // sums of a few products of numbers around 1
constexpr double kDifference = 1e-8;  // central differences with a step of 1e-5
constexpr double kStep = 1e-5;

Eigen::Isometry3d moved(const Twist& by, const Eigen::Isometry3d& pose)
{
  Eigen::Isometry3d result = pose;
  result.translation() += by.head<3>();
  const double angle = by.tail<3>().norm();
  if (angle > 0.0)
    result.linear() = Eigen::AngleAxisd(angle, by.tail<3>() / angle) * pose.linear();
  return result;
}

VectorJoints plus(const VectorJoints& q, int joint, double by)
{
  VectorJoints result = q;
  result(joint) += by;
  return result;
}

std::string refusal(const std::string& urdf, const std::string& base = "base_link",
                    const std::string& tip = "arm_tool0")
{
  try
  {
    const ArmKinematics arm(urdf, base, tip);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

std::string replaced(std::string text, const std::string& from, const std::string& to)
{
  return text.replace(text.find(from), from.size(), to);
}
}  // namespace

// Two oracles: the DH table written down again, and KDL's own parser and solvers.
TEST(ArmKinematics, PoseAndJacobianAreThoseOfTheDhTableAndOfKdl)
{
  const ArmKinematics arm = lwr::arm();
  KDL::Tree tree;
  KDL::Chain chain;
  ASSERT_TRUE(kdl_parser::treeFromString(lwr::urdf(), tree));
  ASSERT_TRUE(tree.getChain("base_link", "arm_tool0", chain));
  KDL::ChainFkSolverPos_recursive position(chain);
  KDL::ChainJntToJacSolver velocity(chain);
  Random random(1);
  for (int k = 0; k < 1000; ++k)
  {
    const VectorJoints q = lwr::randomPosture(arm, random);
    ArmJacobian jacobian;
    const Eigen::Isometry3d pose = arm.forward(q, jacobian);
    EXPECT_LT((pose.matrix() - lwr::forward(q).matrix()).norm(), kRounding);
    KDL::JntArray joints(7);
    joints.data = q;
    KDL::Frame frame;
    KDL::Jacobian expected(7);
    ASSERT_EQ(position.JntToCart(joints, frame), 0);
    ASSERT_EQ(velocity.JntToJac(joints, expected), 0);
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 4; ++column)
        EXPECT_NEAR(pose(row, column), frame(row, column), kRounding);
    EXPECT_LT((jacobian - expected.data).norm(), kRounding);
    for (int i = 0; i < 7; ++i)
    {
      const Twist difference = poseError(arm.forward(plus(q, i, kStep)), arm.forward(plus(q, i, -kStep)));
      EXPECT_LT((difference / (2.0 * kStep) - jacobian.col(i)).norm(), kDifference);
    }
  }
}

// Oblique axes and origins, fixed links in between, an endless joint.
TEST(ArmKinematics, ObliqueChainsAgreeWithKdl)
{
  std::string urdf =
      "<robot name=\"bent\"><link name=\"a\"/><link name=\"b\"/><link name=\"c\"/><link name=\"d\"/>"
      "<link name=\"e\"/>";
  urdf +=
      "<joint name=\"ab\" type=\"continuous\"><parent link=\"a\"/><child link=\"b\"/><origin xyz=\".1 .2 .3\" "
      "rpy=\".4 .5 .6\"/><axis xyz=\".48 .6 .64\"/><limit velocity=\"1\" effort=\"1\"/></joint>";
  urdf +=
      "<joint name=\"bc\" type=\"fixed\"><parent link=\"b\"/><child link=\"c\"/><origin xyz=\"-.2 0 .1\" "
      "rpy=\"1 -1 .3\"/></joint>";
  urdf +=
      "<joint name=\"cd\" type=\"revolute\"><parent link=\"c\"/><child link=\"d\"/><origin xyz=\"0 .3 0\" "
      "rpy=\"-.7 0 2\"/><axis xyz=\"0 .8 -.6\"/><limit lower=\"-1\" upper=\"1\" velocity=\"1\" "
      "effort=\"1\"/></joint>";
  urdf +=
      "<joint name=\"de\" type=\"fixed\"><parent link=\"d\"/><child link=\"e\"/><origin xyz=\".1 .1 .1\" "
      "rpy=\".1 .2 .3\"/></joint></robot>";
  const ArmKinematics arm(urdf, "a", "e");
  EXPECT_EQ(arm.jointNames(), (std::vector<std::string>{ "ab", "cd" }));
  EXPECT_TRUE(std::isinf(arm.upper()(0)));
  KDL::Tree tree;
  KDL::Chain chain;
  ASSERT_TRUE(kdl_parser::treeFromString(urdf, tree));
  ASSERT_TRUE(tree.getChain("a", "e", chain));
  KDL::ChainJntToJacSolver velocity(chain);
  KDL::ChainFkSolverPos_recursive position(chain);
  KDL::JntArray joints(2);
  joints.data << 0.7, -0.4;
  KDL::Jacobian expected(2);
  KDL::Frame frame;
  ASSERT_EQ(velocity.JntToJac(joints, expected), 0);
  ASSERT_EQ(position.JntToCart(joints, frame), 0);
  ArmJacobian jacobian;
  const Eigen::Isometry3d pose = arm.forward(joints.data, jacobian);
  EXPECT_LT((jacobian - expected.data).norm(), kRounding);
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column)
      EXPECT_NEAR(pose(row, column), frame(row, column), kRounding);
}

TEST(ArmKinematics, RefusesWhatIsNoArm)
{
  EXPECT_NE(refusal("<robot").find("no valid URDF"), std::string::npos);
  EXPECT_NE(refusal(lwr::urdf(), "base_link", "arm_tool").find("did you mean 'arm_tool0'"), std::string::npos);
  EXPECT_NE(refusal(lwr::urdf(), "arm_tool0", "base_link").find("is not below 'arm_tool0'"), std::string::npos);
  EXPECT_NE(refusal(lwr::urdf(), "base_link", "arm_base_link").find("0 joints"), std::string::npos);
  const std::string sliding = replaced(lwr::urdf(), "arm_3_joint\" type=\"revolute", "arm_3_joint\" type=\"prismatic");
  EXPECT_NE(refusal(sliding).find("joint 'arm_3_joint' neither turns"), std::string::npos);
  const std::string reversed = replaced(lwr::urdf(), "lower=\"-", "lower=\"9");
  EXPECT_NE(refusal(reversed).find("limits of joint 'arm_0_joint'"), std::string::npos);
  const std::string still = replaced(lwr::urdf(), "velocity=\"", "velocity=\"-");
  EXPECT_NE(refusal(still).find("joint 'arm_0_joint' has no largest velocity"), std::string::npos);
}

TEST(Manipulability, IsTheProductOfSingularValuesAndItsGradientTheirDerivative)
{
  const ArmKinematics arm = lwr::arm();
  Random random(2);
  const auto measure = [&](const VectorJoints& q) {
    ArmJacobian jacobian;
    arm.forward(q, jacobian);
    return manipulability(jacobian);
  };
  for (int k = 0; k < 200; ++k)
  {
    const VectorJoints q = lwr::randomPosture(arm, random);
    ArmJacobian jacobian;
    arm.forward(q, jacobian);
    EXPECT_NEAR(manipulability(jacobian), Eigen::MatrixXd(jacobian).jacobiSvd().singularValues().prod(),
                1e-10);  // determinant of a square
    const VectorJoints gradient = manipulabilityGradient(jacobian);
    if (manipulability(jacobian) < 1e-3)
      continue;
    for (int i = 0; i < 7; ++i)
      EXPECT_NEAR(gradient(i), (measure(plus(q, i, kStep)) - measure(plus(q, i, -kStep))) / (2.0 * kStep), 1e-6);
  }
  ArmJacobian straight;
  arm.forward(VectorJoints::Zero(7), straight);
  EXPECT_LT(manipulability(straight), 1e-8);
  EXPECT_TRUE(manipulabilityGradient(straight).allFinite());
}

// poseError is the inverse of moving by a twist for one second, up to half a turn.
TEST(PoseError, LeadsFromActualToDesired)
{
  Random random(3);
  for (int k = 0; k < 1000; ++k)
  {
    Twist by = lwr::randomTwist(random, 1.0, 1.0);
    by.tail<3>() *=
        (k % 2 ? random.uniform(0.0, M_PI - 1e-6) : std::pow(10.0, -random.uniform(1.0, 16.0))) / by.tail<3>().norm();
    const Eigen::Isometry3d actual = lwr::forward(lwr::randomPosture(lwr::arm(), random));
    EXPECT_LT((poseError(moved(by, actual), actual) - by).norm(), 1e-9);  // atan2 near pi: rounding / 1e-6
  }
}

TEST(JointFunnel, FollowingItNeverNeedsMoreDecelerationAndNeverPassesTheLimit)
{
  const ArmKinematics arm = lwr::arm();
  constexpr double kAcceleration = 5.0, kMargin = 0.02, kDt = 0.001;
  VectorJoints q = VectorJoints::Zero(7), last = VectorJoints::Zero(7);
  for (int k = 0; k < 10000; ++k)
  {
    const VelocityBounds bounds = jointFunnel(arm, q, kAcceleration, kMargin, kDt);
    ASSERT_LE(k == 0 ? 0.0 : (last - bounds.upper).maxCoeff(), kAcceleration * kDt + kRounding);
    q += kDt * bounds.upper;
    last = bounds.upper;
    ASSERT_LE((q - arm.upper()).maxCoeff(), -kMargin + kRounding);
  }
  EXPECT_GT((q - arm.upper()).minCoeff(), -kMargin - 1e-3);  // all of them get there
  const VelocityBounds outside = jointFunnel(arm, arm.upper().array() + 0.1, kAcceleration, kMargin, kDt);
  EXPECT_EQ(outside.upper, VectorJoints::Zero(7));
  EXPECT_LT(outside.lower.maxCoeff(), -1.0);
}
