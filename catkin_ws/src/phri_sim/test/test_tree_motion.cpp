// What no engine may violate: energy, momentum, the static weight; contact rows; and the wrench at the wrist against
// the momentum of what it carries.
#include <gtest/gtest.h>

#include <algorithm>

#include "tree_cases.hpp"

namespace
{
using Eigen::Isometry3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using phri_core::Random;
using phri_sim::JointKind;
using phri_sim::TreeDynamics;
using phri_sim::TreeModel;
using phri_sim::TreeOptions;
using phri_sim::Vector6;

constexpr double kStep = 1e-3;        // [s]
constexpr double kRounding = 1e-10;   // [N, Nm, m/s] of numbers up to 1e3
constexpr double kTruncation = 1e-8;  // of 200 steps of Runge-Kutta at some rad/s
constexpr double kDifference = 1e-6;  // [s] of central differences of the momentum
constexpr double kSlope = 1e-6;       // relative error of those: fingers answer within 1 ms

std::shared_ptr<const TreeModel> makeModel(const phri_sim::RobotDescription& robot, const TreeOptions& options = {})
{
  return std::make_shared<TreeModel>(std::vector<phri_sim::TreePart>{ { robot, "", Isometry3d::Identity() } }, options);
}

VectorXd swingStart()
{
  return (VectorXd(9) << 0.4, 1.2, -0.3, 0.9, 0.5, 0.7, -0.2, 0.01, 0.02).finished();
}

/// Largest error of the energy over 0.5 s of free swing, as a share of the largest kinetic energy.
double energyDrift(const TreeOptions& options, double step, bool runge_kutta)
{
  TreeDynamics dynamics(makeModel(tree_cases::arm(), options));
  const VectorXd rest = VectorXd::Zero(9);
  dynamics.setState(swingStart(), rest);
  const double energy = dynamics.potentialEnergy();
  double drift = 0.0, peak = 0.0;
  for (int i = 0; i < int(std::lround(0.5 / step)); ++i)
  {
    if (runge_kutta)
      dynamics.stepRungeKutta(rest, step);
    else
      dynamics.stepEuler(rest, step);
    drift = std::max(drift, std::abs(dynamics.kineticEnergy() + dynamics.potentialEnergy() - energy));
    peak = std::max(peak, dynamics.kineticEnergy());
  }
  return drift / peak;
}

// Without friction a falling arm keeps its energy: Runge-Kutta to its truncation, which falls with the fourth power of
// the step; Euler only to the first. Rotors slow the swing down, and the truncation with it.
TEST(TreeMotion, freeSwingKeepsItsEnergy)
{
  const TreeOptions rotors = tree_cases::withArmature({ "lwr" });
  const double with_rotors = energyDrift(rotors, kStep, true);
  const double without = energyDrift({}, kStep, true), half = energyDrift({}, 0.5 * kStep, true);
  const double euler = energyDrift({}, kStep, false), euler_half = energyDrift({}, 0.5 * kStep, false);
  EXPECT_LT(with_rotors, 1e-11);
  EXPECT_LT(without, 1e-7);
  EXPECT_GT(without / half, 12.0);  // 16 where the step is small against the motion
  EXPECT_GT(euler, 1e-3);
  EXPECT_NEAR(euler / euler_half, 2.0, 0.3);
}

// Motors act between bodies: a tree that hangs on nothing keeps its momentum, and falls like a stone under gravity.
TEST(TreeMotion, floatingTreeKeepsItsMomentum)
{
  Random random(71);
  phri_sim::RobotDescription robot;
  robot.links.push_back({ "space", 0.0, Vector3d::Zero(), Eigen::Matrix3d::Zero(), {} });
  std::string last = "space";
  for (int j = 0; j < 6; ++j)
  {
    const std::string name = "float_" + std::to_string(j);
    phri_sim::LinkDescription link = tree_cases::randomLink(random, name);
    if (j < 5)
      link = { name, 0.0, Vector3d::Zero(), Eigen::Matrix3d::Zero(), {} };
    tree_cases::add(robot, link, name + "_joint", last, j < 3 ? JointKind::Prismatic : JointKind::Revolute,
                    Isometry3d::Identity(), Vector3d::Unit(j % 3));
    last = name;
  }
  for (int j = 0; j < 8; ++j)
  {
    const std::string name = "limb_" + std::to_string(j);
    tree_cases::add(robot, tree_cases::randomLink(random, name), name + "_joint", j % 4 == 0 ? "float_5" : last,
                    j == 2 ? JointKind::Prismatic : JointKind::Revolute, tree_cases::randomPose(random, 0.3),
                    tree_cases::randomVector(random, 1.0).normalized());
    last = name;
  }
  double mass = 0.0;
  for (const auto& link : robot.links)
    mass += link.mass;
  for (const double gravity : { 0.0, 9.81 })
  {
    TreeOptions options;
    options.gravity = Vector3d(0.0, gravity, 0.0);
    TreeDynamics dynamics(makeModel(robot, options));
    dynamics.setState(tree_cases::randomVector(random, 14, 0.5), tree_cases::randomVector(random, 14, 0.5));
    VectorXd tau = tree_cases::randomVector(random, 14, 0.5);
    tau.head<6>().setZero();
    const Vector6 before = dynamics.momentum(Vector3d::Zero());
    Vector3d moment = Vector3d::Zero();  // mass x centre of mass at the start
    for (const auto& link : robot.links)
      moment += link.mass * (dynamics.linkPose(dynamics.model().link(link.name)) * link.centre);
    constexpr int kSteps = 200;
    constexpr double kTime = kSteps * kStep;
    for (int i = 0; i < kSteps; ++i)
      dynamics.stepRungeKutta(tau, kStep);
    // the weight's lever is the parabola of the mass centre
    Vector6 expected = before;
    expected.head<3>() += mass * kTime * options.gravity;
    expected.tail<3>() += (kTime * moment + 0.5 * kTime * kTime * before.head<3>()).cross(options.gravity);
    EXPECT_LT((dynamics.momentum(Vector3d::Zero()) - expected).norm(), kTruncation * expected.norm());
  }
}

/// Holds the arm still at random joints and returns the wrench at a fixed joint.
Vector6 staticWrench(TreeDynamics& dynamics, int joint, const VectorXd& q)
{
  VectorXd tau(dynamics.dofs());
  dynamics.setState(q, VectorXd::Zero(dynamics.dofs()));
  dynamics.inverseDynamics(VectorXd::Zero(dynamics.dofs()), tau);
  dynamics.prepare(kStep);
  dynamics.forwardDynamics(tau);
  return dynamics.jointWrench(joint);
}

// 1.4 kg weigh 13.734 N: the wrist holds them up, against gravity wherever it points, with the lever of their centre.
TEST(TreeMotion, wristCarriesTheStaticWeight)
{
  Random random(72);
  for (int t = 0; t < 20; ++t)
  {
    TreeOptions options = tree_cases::withArmature({ "lwr" });
    if (t > 0)
      options.gravity = 9.81 * tree_cases::randomVector(random, 1.0).normalized();
    TreeDynamics dynamics(makeModel(tree_cases::arm(), options));
    const int joint = dynamics.model().fixedJoint("lwr_gripper_joint");
    VectorXd q = tree_cases::randomVector(random, 9, 2.0);
    q.tail<2>().setConstant(0.01);
    const Vector6 wrench = staticWrench(dynamics, joint, q);
    const Isometry3d frame = dynamics.linkPose(dynamics.model().link("lwr_gripper_link"));
    EXPECT_NEAR(wrench.head<3>().norm(), 13.734, kRounding);
    const Vector3d up = -options.gravity.normalized();
    EXPECT_LT((frame.linear() * wrench.head<3>() - 13.734 * up).norm(), kRounding);
    // both fingers stand opposite each other: the centre is the body's, and theirs on the axis
    const Vector3d centre = (1.36 * Vector3d(0, 0.01, 0.04) + 0.04 * Vector3d(0, 0, 0.129)) / 1.4;
    EXPECT_LT((wrench.tail<3>() - centre.cross(wrench.head<3>())).norm(), kRounding);
  }
}

// A 25 N push on the tool is 25 N more or less through the wrist, and through nothing that does not carry the tool.
TEST(TreeMotion, pushArrivesAtTheWrist)
{
  TreeDynamics dynamics(tree_cases::dualArmWithBumper());
  const TreeModel& model = dynamics.model();
  const int left = model.fixedJoint("lwr_left_ft_joint"), right = model.fixedJoint("lwr_right_ft_joint");
  const int tool = model.link("lwr_left_tool0");
  VectorXd q = VectorXd::Constant(21, 0.3);
  for (auto& drive : dynamics.drives())
    drive = {};
  const Vector6 left_before = staticWrench(dynamics, left, q), right_before = dynamics.jointWrench(right);
  const Isometry3d sensor = dynamics.linkPose(model.link("lwr_left_ft_link"));
  const Vector3d point = dynamics.linkPose(tool).translation();
  const Vector3d push(15.0, 0.0, -20.0);
  dynamics.addForce(tool, point, push);
  const Vector6 change = staticWrench(dynamics, left, q) - left_before;
  EXPECT_NEAR(change.head<3>().norm(), 25.0, kRounding);
  EXPECT_LT((sensor.linear() * change.head<3>() + push).norm(), kRounding);
  EXPECT_LT((sensor.linear() * change.tail<3>() + (point - sensor.translation()).cross(push)).norm(), kRounding);
  EXPECT_LT((dynamics.jointWrench(right) - right_before).norm(), kRounding);
  // the right wrist carries gripper and bumper
  EXPECT_NEAR(right_before.head<3>().norm(), (0.17 + 1.4 + 1.9) * 9.81, kRounding);
  dynamics.integrate();
  EXPECT_TRUE(dynamics.jointWrench(left).hasNaN());  // the old acceleration does not belong to the new pose
}

/// Momentum of the named links about a point of the world, from the links' own numbers as they were described.
Vector6 momentumOfLinks(const TreeDynamics& dynamics, const std::vector<phri_sim::RobotDescription>& robots,
                        const std::vector<std::string>& names, const Vector3d& point)
{
  Vector6 sum = Vector6::Zero();
  for (const auto& robot : robots)
  {
    for (const auto& link : robot.links)
    {
      if (std::find(names.begin(), names.end(), link.name) == names.end())
        continue;
      const int index = dynamics.model().link(link.name);
      const Isometry3d pose = dynamics.linkPose(index);
      const Vector3d centre = pose * link.centre;
      const Vector3d linear = link.mass * dynamics.pointVelocity(index, centre);
      const Vector3d spin = dynamics.linkVelocity(index).tail<3>();
      sum.head<3>() += linear;
      sum.tail<3>() += (centre - point).cross(linear) + pose.linear() * link.inertia * pose.linear().transpose() * spin;
    }
  }
  return sum;
}

// In motion, under motor torques and a push: the wrench is the rate of the momentum beyond the joint, here by central
// differences along the motion, less weight and push. Links are summed one by one, so merging is tested, too.
TEST(TreeMotion, wristWrenchIsTheRateOfMomentumBeyond)
{
  Random random(73);
  TreeDynamics dynamics(tree_cases::dualArmWithBumper());
  const TreeModel& model = dynamics.model();
  const int joint = model.fixedJoint("lwr_right_ft_joint"), held = model.link("bumper");
  const std::vector<phri_sim::RobotDescription> robots{ tree_cases::dualArm(), tree_cases::bumper() };
  const std::vector<std::string> beyond{ "lwr_right_ft_link",       "lwr_right_gripper_link", "lwr_right_gripper_left",
                                         "lwr_right_gripper_right", "lwr_right_tool0",        "bumper" };
  for (int t = 0; t < 20; ++t)
  {
    dynamics.setState(tree_cases::randomVector(random, 21, 1.0), tree_cases::randomVector(random, 21, 1.0));
    const VectorXd q = dynamics.q(), qd = dynamics.qd(), tau = tree_cases::randomVector(random, 21, 30.0);
    const Isometry3d frame = dynamics.linkPose(model.link("lwr_right_ft_link"));
    const Vector3d at = frame.translation(), end = dynamics.linkPose(held) * Vector3d(1.1, 0, 0);
    const Vector3d push = tree_cases::randomVector(random, 20.0);
    dynamics.clearWrenches();
    dynamics.addForce(held, end, push);
    Vector6 expected = Vector6::Zero();
    for (const double side : { -1.0, 1.0 })
    {
      dynamics.setState(q, qd);
      dynamics.stepRungeKutta(tau, side * kDifference);
      expected += side * momentumOfLinks(dynamics, robots, beyond, at) / (2.0 * kDifference);
    }
    dynamics.setState(q, qd);
    for (const auto& robot : robots)
    {
      for (const auto& link : robot.links)
      {
        if (std::find(beyond.begin(), beyond.end(), link.name) == beyond.end())
          continue;
        const Vector3d weight = link.mass * model.options().gravity;
        expected.head<3>() -= weight;
        expected.tail<3>() -= (dynamics.linkPose(model.link(link.name)) * link.centre - at).cross(weight);
      }
    }
    expected.head<3>() -= push;
    expected.tail<3>() -= (end - at).cross(push);
    dynamics.prepare(0.0);
    dynamics.forwardDynamics(tau);
    Vector6 wrench = dynamics.jointWrench(joint);
    wrench << frame.linear() * wrench.head<3>(), frame.linear() * wrench.tail<3>();
    EXPECT_LT((wrench - expected).norm(), kSlope * expected.norm());
  }
}
}  // namespace
