#pragma once
#include <Eigen/Geometry>
#include <map>
#include <string>
#include <vector>

#include "phri_sim/robot_description.hpp"

namespace phri_sim
{
/// One description in the tree: standing in the world, or held by a link of a part before it.
struct TreePart
{
  RobotDescription description;
  std::string parent;                                      ///< link that carries its root; empty: the world
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< of its root link, in the parent's frame [m]
};

struct TreeOptions
{
  Eigen::Vector3d gravity{ 0, 0, -9.81 };  ///< in the world [m/s2]
  std::map<std::string, double> armature;  ///< by joint: instead of its description's [kgm2, kg]
  double friction_speed = 0.01;            ///< dry friction is -f qd / sqrt(qd^2 + speed^2) [rad/s, m/s]
};

/// Mass, first moment and inertia of a rigid lump about the origin and in the axes of its body's frame.
struct LumpInertia
{
  double mass = 0.0;                                  ///< [kg]
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();   ///< mass x centre of mass [kgm]
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  ///< about the origin of the frame [kgm2]

  LumpInertia& operator+=(const LumpInertia& other);
};

/// What moves with one joint: the joint's child and all links fixed to it. Body i moves with degree of freedom i.
/// Its frame has the joint's origin, and the joint's axis as z; it coincides with no link's frame in general.
struct TreeBody
{
  int parent = -1;           ///< body, always smaller than its own index; -1: the world
  bool revolute = true;      ///< else prismatic
  Eigen::Matrix3d rotation;  ///< of the frame at position 0, in the parent body's frame
  Eigen::Vector3d origin;    ///< likewise [m]
  LumpInertia inertia;       ///< of all its links
};

/// A link of a description; its pose in its body never changes.
struct TreeLink
{
  std::string name;
  int body = -1;                                           ///< -1: fixed to the world
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< in its body's frame; in the world's if body is -1
  std::vector<ShapeDescription> collision;                 ///< origins in the link's own frame
};

/// A moving joint: degree of freedom, body and joint share one index.
struct TreeJoint
{
  JointDescription description;  ///< as given: limits, effort, damping, friction
  double armature = 0.0;         ///< [kgm2, kg]
};

/// A fixed joint, through which a wrench can be read: everything beyond it is known.
struct TreeFixedJoint
{
  std::string name;                ///< for a part: "<root link>_mount"
  int link = -1;                   ///< child: its frame is the one of the wrench
  LumpInertia beyond;              ///< share of the link's own body that lies beyond, in that body's frame
  std::vector<int> bodies_beyond;  ///< further bodies, all of each
  std::vector<char> links_beyond;  ///< per link: 1 if a force on it is a force beyond the joint
};

/// All mechanisms of one world as one kinematic tree rooted at the world, fixed links merged into bodies. Immutable.
/// Indices of degrees of freedom follow the order of parts and their joints. Throws DescriptionError listing all
/// errors at once: link or joint names used twice, unknown parents, armature of unknown joints or negative, numbers
/// that are not finite. A last body without mass and armature makes the mass matrix singular: refused, too.
class TreeModel
{
public:
  explicit TreeModel(const std::vector<TreePart>& parts, const TreeOptions& options = {});

  int dofs() const { return int(bodies_.size()); }
  const std::vector<TreeBody>& bodies() const { return bodies_; }
  const std::vector<TreeJoint>& joints() const { return joints_; }
  const std::vector<TreeLink>& links() const { return links_; }
  const std::vector<TreeFixedJoint>& fixedJoints() const { return fixed_joints_; }
  const TreeOptions& options() const { return options_; }

  /// Indices by name; std::out_of_range naming the known ones.
  int link(const std::string& name) const;
  int joint(const std::string& name) const;
  int fixedJoint(const std::string& name) const;

private:
  TreeOptions options_;
  std::vector<TreeBody> bodies_;
  std::vector<TreeJoint> joints_;
  std::vector<TreeLink> links_;
  std::vector<TreeFixedJoint> fixed_joints_;
};
}  // namespace phri_sim
