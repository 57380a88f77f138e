#pragma once
// Descriptions made in code for the tests and benches of the kinematic tree.
#include <Eigen/Geometry>
#include <cmath>
#include <memory>
#include <phri_core/random.hpp>
#include <string>
#include <vector>

#include "phri_sim/tree_dynamics.hpp"

namespace tree_cases
{
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using phri_core::Random;
using phri_sim::JointDescription;
using phri_sim::JointKind;
using phri_sim::LinkDescription;
using phri_sim::RobotDescription;

inline Vector3d randomVector(Random& random, double size)
{
  return { random.uniform(-size, size), random.uniform(-size, size), random.uniform(-size, size) };
}

inline Eigen::VectorXd randomVector(Random& random, int entries, double size)
{
  Eigen::VectorXd vector(entries);
  for (double& entry : vector)
    entry = random.uniform(-size, size);
  return vector;
}

inline Isometry3d randomPose(Random& random, double reach)
{
  Eigen::Quaterniond turn(random.normal(), random.normal(), random.normal(), random.normal());
  Isometry3d pose = Isometry3d::Identity();
  pose.linear() = turn.normalized().toRotationMatrix();
  pose.translation() = randomVector(random, reach);
  return pose;
}

inline Isometry3d at(double x, double y, double z)
{
  Isometry3d pose = Isometry3d::Identity();
  pose.translation() = Vector3d(x, y, z);
  return pose;
}

/// A box of uniform density: every inertia of it is one that a body can have.
inline LinkDescription box(const std::string& name, double mass, const Vector3d& centre, const Vector3d& size)
{
  LinkDescription link;
  link.name = name;
  link.mass = mass;
  link.centre = centre;
  const Vector3d squares = size.cwiseProduct(size);
  link.inertia = (mass / 12.0 * (Vector3d::Constant(squares.sum()) - squares)).asDiagonal();
  return link;
}

inline LinkDescription randomLink(Random& random, const std::string& name)
{
  const Vector3d size = randomVector(random, 0.1) + Vector3d::Constant(0.2);
  LinkDescription link = box(name, random.uniform(0.1, 5.0), randomVector(random, 0.2), size);
  const Matrix3d turn = randomPose(random, 0.0).linear();
  link.inertia = turn * link.inertia * turn.transpose();
  return link;
}

inline void add(RobotDescription& robot, const LinkDescription& link, const std::string& joint,
                const std::string& parent, JointKind kind, const Isometry3d& origin,
                const Vector3d& axis = Vector3d::UnitZ(), double damping = 0.0, double friction = 0.0)
{
  JointDescription description;
  description.name = joint;
  description.parent = parent;
  description.child = link.name;
  description.kind = kind;
  description.origin = origin;
  description.axis = axis;
  description.damping = damping;
  description.friction = friction;
  robot.links.push_back(link);
  robot.joints.push_back(description);
}

/// Joints of all kinds in random places, hung on random links before them.
inline RobotDescription randomTree(Random& random, int joints)
{
  RobotDescription robot;
  robot.name = "random";
  robot.links.push_back(randomLink(random, "link_0"));
  for (int j = 1; j <= joints; ++j)
  {
    const int parent = std::max(0, j - 1 - int(random.uniform(0.0, 3.0)));
    const double draw = random.uniform();
    const JointKind kind = draw < 0.25 && j > 1 ? JointKind::Fixed
                           : draw < 0.45        ? JointKind::Prismatic
                                                : JointKind::Revolute;
    Vector3d axis = randomVector(random, 1.0).normalized();
    if (random.uniform() < 0.3)
      axis = Vector3d::Unit(int(random.uniform(0.0, 3.0))) * (random.uniform() < 0.5 ? -1.0 : 1.0);
    add(robot, randomLink(random, "link_" + std::to_string(j)), "joint_" + std::to_string(j),
        "link_" + std::to_string(parent), kind, randomPose(random, 0.3), axis);
  }
  return robot;
}

constexpr double kArmature[] = { 3.2, 3.1, 2.0, 2.0, 0.8, 0.4, 0.4 };  // of an LWR 4+, on the link's side [kgm2]

/// Seven links like those of an LWR 4+, F/T sensor and a gripper of 1.4 kg with two fingers, below `parent`.
inline void addArm(RobotDescription& robot, const std::string& arm, const std::string& parent, const Isometry3d& mount,
                   bool dissipative)
{
  constexpr double kReach[] = { 0.11, 0.2005, 0.2, 0.2, 0.2, 0.19, 0.078 };
  constexpr double kMass[] = { 2.3, 2.3, 2.3, 2.3, 1.6, 1.5, 0.11 };
  constexpr double kDamping[] = { 0.2, 0.18, 0.1, 0.15, 0.12, 0.1, 0.1 };
  constexpr double kFriction[] = { 1.0, 1.0, 1.0, 1.0, 0.4, 0.1, 0.1 };
  const Vector3d axes[] = { Vector3d::UnitZ(), -Vector3d::UnitY(), Vector3d::UnitZ(), Vector3d::UnitY(),
                            Vector3d::UnitZ(), -Vector3d::UnitY(), Vector3d::UnitZ() };
  add(robot, box(arm + "_base_link", 1.2, { 0, 0, 0.05 }, { 0.1, 0.1, 0.1 }), arm + "_base_joint", parent,
      JointKind::Fixed, mount);
  std::string last = arm + "_base_link";
  for (int j = 0; j < 7; ++j)
  {
    const std::string link = arm + "_" + std::to_string(j + 1) + "_link";
    const double length = j < 6 ? kReach[j + 1] : 0.04;
    add(robot, box(link, kMass[j], { 0.0, j % 2 ? 0.03 : -0.02, 0.5 * length }, { 0.1, 0.12, length }),
        arm + "_" + std::to_string(j) + "_joint", last, JointKind::Revolute, at(0, 0, kReach[j]), axes[j],
        dissipative ? kDamping[j] : 0.0, dissipative ? kFriction[j] : 0.0);
    last = link;
  }
  const std::string gripper = arm + "_gripper_link";
  add(robot, box(arm + "_ft_link", 0.17, { 0, 0, 0.017 }, { 0.08, 0.08, 0.035 }), arm + "_ft_joint", last,
      JointKind::Fixed, at(0, 0, 0.04));
  add(robot, box(gripper, 1.36, { 0, 0.01, 0.04 }, { 0.08, 0.1, 0.08 }), arm + "_gripper_joint", arm + "_ft_link",
      JointKind::Fixed, at(0, 0, 0.035));
  for (const int side : { -1, 1 })
  {
    const std::string finger = arm + (side < 0 ? "_gripper_left" : "_gripper_right");
    add(robot, box(finger, 0.02, { 0, 0, 0.05 }, { 0.02, 0.01, 0.1 }), finger + "_joint", gripper, JointKind::Prismatic,
        at(0, 0.03 * side, 0.079), Vector3d::UnitY() * side, dissipative ? 20.0 : 0.0);
  }
  LinkDescription tool;
  tool.name = arm + "_tool0";
  add(robot, tool, arm + "_tool_joint", gripper, JointKind::Fixed, at(0, 0, 0.15));
}

inline RobotDescription arm(bool dissipative = false)
{
  RobotDescription robot;
  robot.name = "arm";
  robot.links.push_back(LinkDescription{ "stand", 0.0, Vector3d::Zero(), Matrix3d::Zero(), {} });
  addArm(robot, "lwr", "stand", Isometry3d::Identity(), dissipative);
  return robot;
}

/// Omni base (three joints), two arms of seven, four fingers: 21 degrees of freedom.
inline RobotDescription dualArm(bool dissipative = true)
{
  RobotDescription robot;
  robot.name = "dual_arm";
  const Matrix3d none = Matrix3d::Zero();
  robot.links.push_back({ "odom", 0.0, Vector3d::Zero(), none, {} });
  add(robot, { "base_x_link", 0.0, Vector3d::Zero(), none, {} }, "base_x_joint", "odom", JointKind::Prismatic,
      at(0, 0, 0), Vector3d::UnitX());
  add(robot, { "base_y_link", 0.0, Vector3d::Zero(), none, {} }, "base_y_joint", "base_x_link", JointKind::Prismatic,
      at(0, 0, 0), Vector3d::UnitY());
  add(robot, box("base_link", 120.0, { 0, 0, 0.2 }, { 0.7, 0.6, 0.4 }), "base_yaw_joint", "base_y_link",
      JointKind::Revolute, at(0, 0, 0));
  for (const int side : { 1, -1 })
  {
    Isometry3d mount = at(0.1, 0.25 * side, 1.1);
    mount.rotate(Eigen::AngleAxisd(-0.94 * side, Vector3d::UnitX()));
    addArm(robot, side > 0 ? "lwr_left" : "lwr_right", "base_link", mount, dissipative);
  }
  return robot;
}

inline RobotDescription bumper()
{
  RobotDescription held;
  held.name = "bumper";
  held.links.push_back(box("bumper", 1.9, { 0.55, 0, 0 }, { 1.2, 0.05, 0.05 }));
  return held;
}

inline phri_sim::TreeOptions withArmature(std::initializer_list<std::string> arms)
{
  phri_sim::TreeOptions options;
  for (const std::string& name : arms)
  {
    for (int j = 0; j < 7; ++j)
      options.armature[name + "_" + std::to_string(j) + "_joint"] = kArmature[j];
  }
  return options;
}

inline std::shared_ptr<const phri_sim::TreeModel> dualArmWithBumper()
{
  return std::make_shared<phri_sim::TreeModel>(
      std::vector<phri_sim::TreePart>{ { dualArm(), "", Isometry3d::Identity() },
                                       { bumper(), "lwr_right_tool0", Isometry3d::Identity() } },
      withArmature({ "lwr_left", "lwr_right" }));
}
}  // namespace tree_cases
