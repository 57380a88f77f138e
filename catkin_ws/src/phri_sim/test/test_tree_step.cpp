// One step of the tree: contact rows, implicit damping, friction and drives, and what real time asks of it.
#include <gtest/gtest.h>

#include <phri_core/testing.hpp>

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

constexpr double kStep = 1e-3;      // [s]
constexpr double kRounding = 1e-9;  // relative: M has entries from 0.02 kg (a finger) to 150 kg

/// Dual arm with damping, friction and drives, moving, its wrenches and rows those of a busy step.
struct Busy
{
  TreeDynamics dynamics{ tree_cases::dualArmWithBumper() };
  VectorXd tau, impulses;
  int tool = dynamics.model().link("lwr_left_tool0"), held = dynamics.model().link("bumper");
  int sensor = dynamics.model().fixedJoint("lwr_right_ft_joint");

  explicit Busy(std::uint64_t seed)
  {
    Random random(seed);
    dynamics.setState(tree_cases::randomVector(random, 21, 1.0), tree_cases::randomVector(random, 21, 0.5));
    tau = tree_cases::randomVector(random, 21, 20.0);
    impulses = tree_cases::randomVector(random, 8, 0.05);
    for (int i = 0; i < 3; ++i)
      dynamics.drives()[std::size_t(i)] = { 0.0, 500.0, 0.0, 0.1 };
  }

  void prepare()
  {
    dynamics.clearWrenches();
    dynamics.addForce(held, end(), { 5.0, -3.0, 2.0 });
    dynamics.prepare(kStep);
    dynamics.forwardDynamics(tau);
    const Vector3d at = dynamics.linkPose(tool).translation();
    for (int i = 0; i < 3; ++i)
    {
      dynamics.addRow(tool, -1, at, Vector3d::Unit(i));                              // a hand against the world
      dynamics.addRow(held, tool, 0.5 * (at + end()), Vector3d::Unit((i + 1) % 3));  // one arm against the other
    }
    dynamics.addJointRow(5, -1.0);
    dynamics.addRow(dynamics.model().link("base_link"), -1, Vector3d(0.3, 0.1, 0.2), Vector3d::UnitX());
  }

  void step()
  {
    prepare();
    dynamics.delassus();
    dynamics.applyImpulses(impulses);
    dynamics.integrate();
  }

  Vector3d end() const { return dynamics.linkPose(held) * Vector3d(1.1, 0, 0); }
};

// J by Jacobians, M_h densely from the linear map that solve() inverts: all that a contact solver sees is consistent.
TEST(TreeStep, rowsAreTheDenseContactProblem)
{
  for (std::uint64_t seed = 1; seed <= 20; ++seed)
  {
    Busy busy(seed);
    TreeDynamics& dynamics = busy.dynamics;
    busy.prepare();
    ASSERT_EQ(dynamics.rows(), 8);
    MatrixXd mass(21, 21), rows(8, 21);
    dynamics.massMatrix(mass);
    for (int i = 0; i < 21; ++i)
    {
      const auto& joint = dynamics.model().joints()[std::size_t(i)].description;
      const double chord = joint.friction / std::hypot(dynamics.qd()[i], dynamics.model().options().friction_speed);
      mass(i, i) += kStep * (joint.damping + chord + dynamics.drives()[std::size_t(i)].damping);
    }
    phri_sim::Jacobian of_tool(6, 21), of_held(6, 21), of_base(6, 21);
    const Vector3d at = dynamics.linkPose(busy.tool).translation(), between = 0.5 * (at + busy.end());
    dynamics.jacobian(busy.tool, at, of_tool);
    rows.row(0) = of_tool.row(0), rows.row(2) = of_tool.row(1), rows.row(4) = of_tool.row(2);
    dynamics.jacobian(busy.tool, between, of_tool);
    dynamics.jacobian(busy.held, between, of_held);
    rows.row(1) = (of_held - of_tool).row(1), rows.row(3) = (of_held - of_tool).row(2);
    rows.row(5) = (of_held - of_tool).row(0);
    rows.row(6) = -VectorXd::Unit(21, 5).transpose();
    dynamics.jacobian(dynamics.model().link("base_link"), Vector3d(0.3, 0.1, 0.2), of_base);
    rows.row(7) = of_base.row(0);
    EXPECT_LT((dynamics.rowJacobianTransposed() - rows.transpose()).norm(), kRounding);
    const MatrixXd inverse = mass.llt().solve(rows.transpose());
    const MatrixXd expected = rows * inverse;
    EXPECT_LT((dynamics.delassus() - expected).norm(), kRounding * expected.norm());

    VectorXd now(8), after(8);
    dynamics.rowVelocities(now, after);
    EXPECT_LT((now - rows * dynamics.qd()).norm(), kRounding);
    const VectorXd predicted = after + expected * busy.impulses;
    dynamics.applyImpulses(busy.impulses);
    dynamics.rowVelocities(now, after);
    EXPECT_LT((after - predicted).norm(), kRounding * predicted.norm());
    dynamics.integrate();
    EXPECT_LT((rows * dynamics.qd() - predicted).norm(), kRounding * predicted.norm());
  }
}

// An impulse over the step is its mean force over the step, for the motion and for the wrist's F/T sensor alike.
TEST(TreeStep, impulsesAreForces)
{
  Busy by_rows(3), by_forces(3);
  by_rows.prepare();
  VectorXd impulses = by_rows.impulses;
  impulses[6] = 0.0;  // the joint's stop is not a force on a link
  by_rows.dynamics.applyImpulses(impulses);

  by_forces.prepare();
  TreeDynamics& dynamics = by_forces.dynamics;
  const Vector3d at = dynamics.linkPose(by_forces.tool).translation(), between = 0.5 * (at + by_forces.end());
  for (int i = 0; i < 3; ++i)
  {
    const Vector3d on_held = impulses[2 * i + 1] / kStep * Vector3d::Unit((i + 1) % 3);
    dynamics.addForce(by_forces.tool, at, impulses[2 * i] / kStep * Vector3d::Unit(i));
    dynamics.addForce(by_forces.held, between, on_held);
    dynamics.addForce(by_forces.tool, between, -on_held);
  }
  dynamics.addForce(dynamics.model().link("base_link"), { 0.3, 0.1, 0.2 }, impulses[7] / kStep * Vector3d::UnitX());
  dynamics.forwardDynamics(by_forces.tau);
  EXPECT_LT((dynamics.acceleration() - by_rows.dynamics.acceleration()).norm(),
            kRounding * dynamics.acceleration().norm());
  for (const char* name : { "lwr_left_ft_joint", "lwr_right_ft_joint" })
  {
    const int sensor = dynamics.model().fixedJoint(name);
    const Vector6 wrench = dynamics.jointWrench(sensor);
    EXPECT_LT((wrench - by_rows.dynamics.jointWrench(sensor)).norm(), kRounding * wrench.norm()) << name;
  }
}

TEST(TreeStep, refusesRowsBeyondItsRoom)
{
  TreeDynamics dynamics(tree_cases::dualArmWithBumper(), 2);
  dynamics.prepare(kStep);
  EXPECT_EQ(dynamics.addJointRow(3, 1.0), 0);
  EXPECT_EQ(dynamics.addRow(5, -1, Vector3d::Zero(), Vector3d::UnitX()), 1);
  EXPECT_EQ(dynamics.addRow(5, -1, Vector3d::Zero(), Vector3d::UnitX()), -1);
  EXPECT_EQ(dynamics.addJointRow(3, 1.0), -1);
  EXPECT_EQ(dynamics.rows(), 2);
}

/// A wheel of 1e-3 kgm2 about z.
TreeDynamics wheel(double damping, double friction, double friction_speed)
{
  phri_sim::RobotDescription robot;
  robot.links.push_back({ "axle", 0.0, Vector3d::Zero(), Eigen::Matrix3d::Zero(), {} });
  phri_sim::LinkDescription rim;
  rim.name = "rim";
  rim.mass = 1.0;
  rim.inertia = 1e-3 * Eigen::Matrix3d::Identity();
  tree_cases::add(robot, rim, "joint", "axle", JointKind::Revolute, Isometry3d::Identity(), Vector3d::UnitZ(), damping,
                  friction);
  TreeOptions options;
  options.friction_speed = friction_speed;
  return TreeDynamics(
      std::make_shared<TreeModel>(std::vector<phri_sim::TreePart>{ { robot, "", Isometry3d::Identity() } }, options));
}

VectorXd one(double value)
{
  return VectorXd::Constant(1, value);
}

// Explicit, h d / I = 100 would explode; implicit, it is qd / 101 to the last digit, and stays for a spring as stiff.
TEST(TreeStep, dampingIsImplicit)
{
  TreeDynamics dynamics = wheel(100.0, 0.0, 0.01);
  dynamics.setState(one(0.0), one(1.0));
  dynamics.stepEuler(one(0.0), kStep);
  EXPECT_NEAR(dynamics.qd()[0], 1.0 / 101.0, 1e-15);

  TreeDynamics sprung = wheel(0.0, 0.0, 0.01);
  sprung.drives()[0] = { 1e6, 1e3, 0.5, 0.0 };
  sprung.setState(one(0.0), one(0.0));
  for (int i = 0; i < 200; ++i)
    sprung.stepEuler(one(10.0), kStep);
  EXPECT_NEAR(sprung.q()[0], 0.5 + 10.0 / 1e6, 1e-9);  // 10 Nm against 1e6 Nm/rad
}

// Dry friction stops the wheel and never turns it back; a torque beyond it leaves what is above to accelerate; a torque
// below creeps at the speed where the smoothed law balances it: tau = f v / sqrt(v^2 + s^2).
TEST(TreeStep, dryFrictionIsDry)
{
  TreeDynamics sliding = wheel(0.0, 0.5, 0.001);
  sliding.setState(one(0.0), one(3.0));
  double last = 3.0;
  for (int i = 0; i < 200; ++i)
  {
    sliding.stepEuler(one(0.0), kStep);
    ASSERT_GE(sliding.qd()[0], 0.0);
    ASSERT_LE(sliding.qd()[0], last);
    last = sliding.qd()[0];
  }
  EXPECT_LT(last, 1e-12);

  TreeDynamics driven = wheel(0.0, 0.5, 0.001);
  driven.setState(one(0.0), one(20.0));
  for (int i = 0; i < 100; ++i)
    driven.stepEuler(one(0.6), kStep);
  // 0.1 Nm for 0.1 s, less what the chord takes of the rise within each step: sum f h (qd+ - qd) / qd = f h ln(30 / 20)
  EXPECT_NEAR(driven.qd()[0], 30.0 - 0.5 * kStep * std::log(1.5) / 1e-3, 0.005);

  TreeDynamics creeping = wheel(0.0, 0.5, 0.001);
  creeping.setState(one(0.0), one(0.0));
  for (int i = 0; i < 1000; ++i)
    creeping.stepEuler(one(0.3), kStep);
  EXPECT_NEAR(creeping.qd()[0], 0.001 * 0.75, 1e-9);  // 0.6 of the friction at 3/4 of the speed
}

TEST(TreeStep, repeatsBitForBit)
{
  Busy first(5), second(5);
  for (int i = 0; i < 500; ++i)
  {
    first.step();
    second.step();
  }
  ASSERT_TRUE(first.dynamics.q().allFinite());
  EXPECT_TRUE(first.dynamics.q() == second.dynamics.q());
  EXPECT_TRUE(first.dynamics.qd() == second.dynamics.qd());
}

TEST(TreeStep, allocatesNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "AddressSanitizer owns malloc";
  Busy busy(7);
  TreeDynamics& dynamics = busy.dynamics;
  VectorXd tau(21), now(8), after(8), x = busy.tau;
  MatrixXd mass(21, 21);
  phri_sim::Jacobian jacobian(6, 21);
  const VectorXd q = dynamics.q(), qd = dynamics.qd();
  double sum = 0.0;
  const long count = phri_core::testing::countAllocations([&] {
    for (int i = 0; i < 10; ++i)
    {
      dynamics.setState(q, qd);
      dynamics.inverseDynamics(busy.tau, tau);
      busy.prepare();
      sum += dynamics.delassus()(1, 2) + dynamics.rowJacobianTransposed()(1, 2);
      dynamics.rowVelocities(now, after);
      dynamics.applyImpulses(busy.impulses);
      dynamics.massMatrix(mass);
      dynamics.solve(x);
      dynamics.jacobian(busy.tool, Vector3d::Zero(), jacobian);
      dynamics.jointForces(busy.tool, Vector3d::Zero(), dynamics.jointWrench(busy.sensor), tau);
      sum += dynamics.linkAcceleration(busy.held).norm() + dynamics.linkVelocity(busy.held).norm();
      sum += dynamics.kineticEnergy() + dynamics.potentialEnergy() + dynamics.momentum(Vector3d::Zero()).norm();
      dynamics.integrate();
      dynamics.stepEuler(busy.tau, kStep);
      dynamics.stepRungeKutta(busy.tau, 1e-5);
    }
  });
  EXPECT_EQ(count, 0);
  EXPECT_TRUE(std::isfinite(sum));
}
}  // namespace
