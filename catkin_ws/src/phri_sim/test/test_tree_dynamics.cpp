// The engine against KDL and against dense algebra: every formula of it has an oracle that shares none of its code.
#include <gtest/gtest.h>

#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainidsolver_recursive_newton_euler.hpp>
#include <kdl/tree.hpp>
#include <kdl/treeidsolver_recursive_newton_euler.hpp>

#include "tree_cases.hpp"

namespace
{
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using phri_core::Random;
using phri_sim::JointKind;
using phri_sim::TreeDynamics;
using phri_sim::TreeModel;
using phri_sim::Vector6;

constexpr double kRelative = 1e-9;  // of the largest torque: what conditioning of light links at long arms costs
constexpr double kRounding = 1e-11;
constexpr double kDifference = 1e-6;  // step of central differences [s, rad, m]
constexpr double kSlope = 1e-7;       // what central differences with that step get right of numbers around 10

KDL::Vector toKdl(const Vector3d& v)
{
  return { v[0], v[1], v[2] };
}

KDL::Frame toKdl(const Eigen::Isometry3d& pose)
{
  const Eigen::Matrix3d r = pose.linear();
  return { KDL::Rotation(r(0, 0), r(0, 1), r(0, 2), r(1, 0), r(1, 1), r(1, 2), r(2, 0), r(2, 1), r(2, 2)),
           toKdl(Vector3d(pose.translation())) };
}

KDL::Tree toKdl(const phri_sim::RobotDescription& robot)
{
  KDL::Tree tree(robot.links[0].name);
  for (std::size_t j = 0; j < robot.joints.size(); ++j)
  {
    const phri_sim::JointDescription& joint = robot.joints[j];
    const phri_sim::LinkDescription& link = robot.links[j + 1];
    const KDL::Frame origin = toKdl(joint.origin);
    const KDL::Vector axis = origin.M * toKdl(joint.axis);
    const KDL::Joint moving =
        joint.kind == JointKind::Fixed
            ? KDL::Joint(joint.name, KDL::Joint::None)
            : KDL::Joint(joint.name, origin.p, axis,
                         joint.kind == JointKind::Revolute ? KDL::Joint::RotAxis : KDL::Joint::TransAxis);
    const Eigen::Matrix3d& i = link.inertia;
    const KDL::RigidBodyInertia inertia(link.mass, toKdl(link.centre),
                                        KDL::RotationalInertia(i(0, 0), i(1, 1), i(2, 2), i(0, 1), i(0, 2), i(1, 2)));
    EXPECT_TRUE(tree.addSegment(KDL::Segment(link.name, moving, origin, inertia), joint.parent));
  }
  return tree;
}

KDL::JntArray toKdl(const VectorXd& vector)
{
  KDL::JntArray array(unsigned(vector.size()));
  array.data = vector;
  return array;
}

/// A wrench in world axes about the link's origin, in the link's own axes.
KDL::Wrench inLink(const Vector6& wrench, const Eigen::Isometry3d& pose)
{
  return { toKdl(Vector3d(pose.linear().transpose() * wrench.head<3>())),
           toKdl(Vector3d(pose.linear().transpose() * wrench.tail<3>())) };
}

std::shared_ptr<const TreeModel> makeModel(const phri_sim::RobotDescription& robot,
                                           const phri_sim::TreeOptions& options = {})
{
  return std::make_shared<TreeModel>(std::vector<phri_sim::TreePart>{ { robot, "", Eigen::Isometry3d::Identity() } },
                                     options);
}

/// Random armature on every joint.
phri_sim::TreeOptions randomOptions(Random& random, const phri_sim::RobotDescription& robot)
{
  phri_sim::TreeOptions options;
  options.gravity = tree_cases::randomVector(random, 10.0);
  for (const auto& joint : robot.joints)
  {
    if (joint.kind != JointKind::Fixed)
      options.armature[joint.name] = random.uniform(0.0, 1.0);
  }
  return options;
}

VectorXd armatureOf(const TreeModel& model)
{
  VectorXd armature(model.dofs());
  for (int i = 0; i < model.dofs(); ++i)
    armature[i] = model.joints()[std::size_t(i)].armature;
  return armature;
}

/// M from the engine's own inverse dynamics, which the KDL tests cover: column i answers a unit acceleration.
MatrixXd denseMass(const TreeDynamics& state)
{
  TreeDynamics dynamics = state;
  dynamics.clearWrenches();
  dynamics.setState(state.q(), VectorXd::Zero(state.dofs()));
  MatrixXd mass(state.dofs(), state.dofs());
  VectorXd rest(state.dofs()), tau(state.dofs());
  dynamics.inverseDynamics(VectorXd::Zero(state.dofs()), rest);
  for (int i = 0; i < state.dofs(); ++i)
  {
    dynamics.inverseDynamics(VectorXd::Unit(state.dofs(), i), tau);
    mass.col(i) = tau - rest;
  }
  return mass;
}

// tau = ID(q, qd, FD(q, qd, tau, wrenches), wrenches), with ID by KDL, which knows neither merged links nor composite
// inertias nor a factor; the armature adds armature x qdd. 200 trees x 50 states = 10^4.
TEST(TreeDynamics, agreesWithKdlOnRandomTrees)
{
  Random random(61);
  double worst = 0.0, worst_inverse = 0.0;
  for (int t = 0; t < 200; ++t)
  {
    const auto robot = tree_cases::randomTree(random, 1 + int(random.uniform(0.0, 22.0)));
    const auto model = makeModel(robot, randomOptions(random, robot));
    TreeDynamics dynamics(model);
    const int dofs = model->dofs();
    const KDL::Tree tree = toKdl(robot);
    ASSERT_EQ(int(tree.getNrOfJoints()), dofs);  // both number moving joints in the order of the description
    KDL::TreeIdSolver_RNE oracle(tree, toKdl(model->options().gravity));
    for (int s = 0; s < 50; ++s)
    {
      const VectorXd tau = tree_cases::randomVector(random, dofs, 50.0);
      dynamics.setState(tree_cases::randomVector(random, dofs, 3.0), tree_cases::randomVector(random, dofs, 3.0));
      dynamics.clearWrenches();
      KDL::WrenchMap wrenches;
      for (int w = 0; w < 3; ++w)
      {
        const int link = int(random.uniform(1.0, double(model->links().size())));
        Vector6 wrench;
        wrench << tree_cases::randomVector(random, 30.0), tree_cases::randomVector(random, 5.0);
        const Eigen::Isometry3d pose = dynamics.linkPose(link);
        dynamics.addWrench(link, pose.translation(), wrench);
        KDL::Wrench& sum = wrenches.insert({ robot.links[std::size_t(link)].name, KDL::Wrench::Zero() }).first->second;
        sum += inLink(wrench, pose);
      }
      dynamics.prepare(0.0);
      dynamics.forwardDynamics(tau);
      KDL::JntArray answer(static_cast<unsigned>(dofs));
      ASSERT_EQ(
          oracle.CartToJnt(toKdl(dynamics.q()), toKdl(dynamics.qd()), toKdl(dynamics.acceleration()), wrenches, answer),
          0);
      const VectorXd expected = answer.data + armatureOf(*model).cwiseProduct(dynamics.acceleration());
      const double scale = std::max(50.0, denseMass(dynamics).diagonal().maxCoeff() * dynamics.acceleration().norm());
      worst = std::max(worst, (expected - tau).lpNorm<Eigen::Infinity>() / scale);
      VectorXd inverse(dofs);
      dynamics.inverseDynamics(dynamics.acceleration(), inverse);
      worst_inverse = std::max(worst_inverse, (expected - inverse).lpNorm<Eigen::Infinity>() / scale);
    }
  }
  RecordProperty("worst_relative_error", testing::PrintToString(worst));
  EXPECT_LT(worst, kRelative);
  EXPECT_LT(worst_inverse, kRelative);
}

TEST(TreeDynamics, agreesWithKdlOnAnArm)
{
  Random random(62);
  auto robot = tree_cases::arm();
  robot.links.erase(robot.links.begin() + 11, robot.links.end());  // a chain: without fingers and tool
  robot.joints.erase(robot.joints.begin() + 10, robot.joints.end());
  const auto model = makeModel(robot, tree_cases::withArmature({ "lwr" }));
  ASSERT_EQ(model->dofs(), 7);
  TreeDynamics dynamics(model);
  KDL::Chain chain;
  ASSERT_TRUE(toKdl(robot).getChain("stand", robot.links.back().name, chain));
  KDL::ChainIdSolver_RNE oracle(chain, KDL::Vector(0, 0, -9.81));
  const KDL::Wrenches none(chain.getNrOfSegments(), KDL::Wrench::Zero());
  for (int s = 0; s < 10000; ++s)
  {
    const VectorXd tau = tree_cases::randomVector(random, 7, 50.0);
    dynamics.setState(tree_cases::randomVector(random, 7, 3.0), tree_cases::randomVector(random, 7, 2.0));
    dynamics.prepare(0.0);
    dynamics.forwardDynamics(tau);
    KDL::JntArray answer(7);
    ASSERT_EQ(oracle.CartToJnt(toKdl(dynamics.q()), toKdl(dynamics.qd()), toKdl(dynamics.acceleration()), none, answer),
              0);
    const VectorXd expected = answer.data + armatureOf(*model).cwiseProduct(dynamics.acceleration());
    ASSERT_LT((expected - tau).norm(), kRelative * tau.norm());
  }
}

TEST(TreeDynamics, placesLinksWhereKdlDoes)
{
  Random random(63);
  for (int t = 0; t < 50; ++t)
  {
    const auto robot = tree_cases::randomTree(random, 15);
    const auto model = makeModel(robot);
    TreeDynamics dynamics(model);
    dynamics.setState(tree_cases::randomVector(random, model->dofs(), 3.0), VectorXd::Zero(model->dofs()));
    const KDL::Tree tree = toKdl(robot);
    for (std::size_t l = 1; l < robot.links.size(); ++l)
    {
      // by chains, as KDL's solver of trees copies the tree, which numbers its joints anew
      KDL::Chain chain;
      ASSERT_TRUE(tree.getChain(robot.links[0].name, robot.links[l].name, chain));
      KDL::JntArray q(chain.getNrOfJoints());
      unsigned next = 0;
      for (const KDL::Segment& segment : chain.segments)
      {
        if (segment.getJoint().getType() != KDL::Joint::None)
          q(next++) = dynamics.q()[model->joint(segment.getJoint().getName())];
      }
      KDL::ChainFkSolverPos_recursive oracle(chain);
      KDL::Frame frame;
      ASSERT_EQ(oracle.JntToCart(q, frame), 0);
      EXPECT_TRUE(KDL::Equal(frame, toKdl(dynamics.linkPose(int(l))), kRounding)) << robot.links[l].name;
    }
  }
}

// Velocities are what poses do in time, accelerations what velocities do; J qd is the velocity of the point.
TEST(TreeDynamics, velocitiesAndAccelerationsAreDerivatives)
{
  Random random(64);
  for (int t = 0; t < 30; ++t)
  {
    const auto robot = tree_cases::randomTree(random, 12);
    const auto model = makeModel(robot, randomOptions(random, robot));
    const int dofs = model->dofs(), link = int(model->links().size()) - 1;
    TreeDynamics dynamics(model), before(model), after(model);
    dynamics.setState(tree_cases::randomVector(random, dofs, 2.0), tree_cases::randomVector(random, dofs, 2.0));
    const VectorXd qdd = tree_cases::randomVector(random, dofs, 3.0);
    VectorXd tau(dofs);
    dynamics.inverseDynamics(qdd, tau);
    dynamics.prepare(0.0);
    dynamics.forwardDynamics(tau);
    for (const double side : { -1.0, 1.0 })
    {
      const double dt = side * kDifference;
      (side < 0.0 ? before : after)
          .setState(dynamics.q() + dt * dynamics.qd() + 0.5 * dt * dt * qdd, dynamics.qd() + dt * qdd);
    }
    const Vector6 velocity = dynamics.linkVelocity(link);
    const Vector3d origin = dynamics.linkPose(link).translation();
    const Vector3d moved = after.linkPose(link).translation() - before.linkPose(link).translation();
    EXPECT_LT((moved / (2.0 * kDifference) - velocity.head<3>()).norm(), kSlope);
    const Eigen::AngleAxisd turn(after.linkPose(link).linear() * before.linkPose(link).linear().transpose());
    EXPECT_LT((turn.angle() * turn.axis() / (2.0 * kDifference) - velocity.tail<3>()).norm(), kSlope);
    const Vector6 change = after.linkVelocity(link) - before.linkVelocity(link);
    EXPECT_LT((change / (2.0 * kDifference) - dynamics.linkAcceleration(link)).norm(),
              kSlope * (1.0 + change.norm() / kDifference));

    phri_sim::Jacobian jacobian(6, dofs);
    dynamics.jacobian(link, origin, jacobian);
    EXPECT_LT((jacobian * dynamics.qd() - velocity).norm(), kRounding);
    const Vector3d point = origin + tree_cases::randomVector(random, 1.0);
    dynamics.jacobian(link, point, jacobian);
    EXPECT_LT((jacobian.topRows<3>() * dynamics.qd() - dynamics.pointVelocity(link, point)).norm(), kRounding);
    Vector6 wrench;
    wrench << tree_cases::randomVector(random, 1.0), tree_cases::randomVector(random, 1.0);
    dynamics.jointForces(link, point, wrench, tau);
    EXPECT_LT((tau - jacobian.transpose() * wrench).norm(), kRounding);
  }
}

// M by composite bodies is M by columns of inverse dynamics, and the sparse factor solves what a dense one does, with
// the implicit terms on the diagonal.
TEST(TreeDynamics, solvesTheDenseSystem)
{
  Random random(65);
  constexpr double kStep = 1e-3;
  for (int t = 0; t < 100; ++t)
  {
    auto robot = tree_cases::randomTree(random, 17);
    for (auto& joint : robot.joints)
      joint.damping = random.uniform(0.0, 50.0);
    const auto model = makeModel(robot, randomOptions(random, robot));
    const int dofs = model->dofs();
    TreeDynamics dynamics(model);
    dynamics.setState(tree_cases::randomVector(random, dofs, 2.0), tree_cases::randomVector(random, dofs, 2.0));
    VectorXd implicit(dofs);
    for (int i = 0; i < dofs; ++i)
    {
      dynamics.drives()[std::size_t(i)] = { random.uniform(0.0, 1e4), random.uniform(0.0, 100.0), 0.1, -0.2 };
      const auto& drive = dynamics.drives()[std::size_t(i)];
      implicit[i] = kStep * (model->joints()[std::size_t(i)].description.damping + drive.damping) +
                    kStep * kStep * drive.stiffness;
    }
    dynamics.prepare(kStep);
    MatrixXd mass(dofs, dofs), expected = denseMass(dynamics);
    dynamics.massMatrix(mass);
    EXPECT_LT((mass - expected).norm(), kRounding * expected.norm());
    expected += implicit.asDiagonal();
    const VectorXd b = tree_cases::randomVector(random, dofs, 1.0);
    VectorXd x = b;
    dynamics.solve(x);
    EXPECT_LT((expected * x - b).norm(), kRelative);

    // the step itself: what drives and damping do at its end is what the momentum gained
    const VectorXd q = dynamics.q(), qd = dynamics.qd();
    VectorXd bias(dofs), tau = tree_cases::randomVector(random, dofs, 20.0);
    dynamics.inverseDynamics(VectorXd::Zero(dofs), bias);
    dynamics.stepEuler(tau, kStep);
    VectorXd joint_forces(dofs);
    for (int i = 0; i < dofs; ++i)
    {
      const auto& drive = dynamics.drives()[std::size_t(i)];
      joint_forces[i] = -model->joints()[std::size_t(i)].description.damping * dynamics.qd()[i] +
                        drive.damping * (drive.velocity - dynamics.qd()[i]) +
                        drive.stiffness * (drive.position - dynamics.q()[i]);
    }
    const VectorXd gained = mass * (dynamics.qd() - qd) / kStep;
    EXPECT_LT((gained - (tau + joint_forces - bias)).norm(), kRelative * (gained.norm() + joint_forces.norm()));
    EXPECT_LT((dynamics.q() - q - kStep * dynamics.qd()).norm(), kRounding);
  }
}
}  // namespace
