#pragma once
#include <Eigen/Geometry>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace phri_sim
{
enum class JointKind
{
  Fixed,
  Revolute,  ///< also "continuous": limits are infinite then
  Prismatic
};

/// The joint that carries link i + 1 is joint i of a description.
struct JointDescription
{
  std::string name, parent, child;
  JointKind kind = JointKind::Fixed;
  Eigen::Isometry3d origin = Eigen::Isometry3d::Identity();   ///< frame of the child at position 0, in the parent's [m]
  Eigen::Vector3d axis{ 0, 0, 1 };                            ///< unit vector in the child's frame
  double lower = -std::numeric_limits<double>::infinity();    ///< [rad, m]
  double upper = std::numeric_limits<double>::infinity();     ///< [rad, m]
  double velocity = std::numeric_limits<double>::infinity();  ///< largest [rad/s, m/s]
  double effort = std::numeric_limits<double>::infinity();    ///< largest [Nm, N]
  double damping = 0.0;                                       ///< viscous [Nms/rad, Ns/m]
  double friction = 0.0;                                      ///< dry [Nm, N]
  double armature = 0.0;                                      ///< rotor inertia seen at the joint [kgm2, kg]
};

enum class ShapeKind
{
  Box,       ///< size: edges x, y, z
  Cylinder,  ///< size: radius, length along z, -
  Sphere     ///< size: radius, -, -
};

struct ShapeDescription
{
  ShapeKind kind = ShapeKind::Box;
  Eigen::Vector3d size{ 0, 0, 0 };                           ///< [m], by kind
  Eigen::Isometry3d origin = Eigen::Isometry3d::Identity();  ///< in the link's frame
};

struct LinkDescription
{
  std::string name;
  double mass = 0.0;                                  ///< [kg]
  Eigen::Vector3d centre{ 0, 0, 0 };                  ///< of mass, in the link's frame [m]
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  ///< about the centre of mass, in the link's axes [kgm2]
  std::vector<ShapeDescription> collision;
};

/// A robot or a mechanism of the scene, as its URDF says: parents before children, links[0] is the root.
struct RobotDescription
{
  std::string name;
  std::string urdf;  ///< the text that it was read from, for robot_description and KDL
  std::vector<LinkDescription> links;
  std::vector<JointDescription> joints;

  int link(const std::string& name) const;   ///< index; throws std::out_of_range naming the known ones
  int joint(const std::string& name) const;  ///< likewise
};

/// Impossible or incomplete description: one line per error, each naming link or joint, value and expected range.
class DescriptionError : public std::invalid_argument
{
public:
  DescriptionError(const std::string& where, std::vector<std::string> errors);
  const std::vector<std::string>& errors() const { return errors_; }

private:
  std::vector<std::string> errors_;
};

/// Reads a URDF file, or `urdf/<name>.urdf` of this package. Throws DescriptionError listing all errors at once: masses
/// that are not positive on moving links, inertias that no body has (not positive definite, triangle inequality of the
/// principal moments, radius of gyration larger than the body's reach), axes that are not unit vectors, limits that are
/// missing, reversed or not finite, loops, several roots, names used twice, shapes without size.
RobotDescription loadRobot(const std::string& name_or_path);
RobotDescription parseRobot(const std::string& urdf, const std::string& where);
}  // namespace phri_sim
