#pragma once
/// Small mechanisms made in code, for tests of the world and its contacts.
#include <string>
#include <vector>

#include "phri_sim/world.hpp"

namespace phri_sim::testing
{
inline ShapeDescription box(double x, double y, double z)
{
  ShapeDescription shape;
  shape.kind = ShapeKind::Box;
  shape.size = { x, y, z };
  return shape;
}

inline ShapeDescription sphere(double radius)
{
  ShapeDescription shape;
  shape.kind = ShapeKind::Sphere;
  shape.size = { radius, 0, 0 };
  return shape;
}

inline ShapeDescription cylinder(double radius, double length)
{
  ShapeDescription shape;
  shape.kind = ShapeKind::Cylinder;
  shape.size = { radius, length, 0 };
  return shape;
}

inline LinkDescription solid(const std::string& name, double mass, const ShapeDescription& shape)
{
  LinkDescription link;
  link.name = name;
  link.mass = mass;
  link.inertia = Eigen::Vector3d(2e-3, 3e-3, 4e-3).asDiagonal();
  link.inertia *= mass;
  link.collision = { shape };
  return link;
}

inline JointDescription joint(const std::string& name, const std::string& parent, const std::string& child,
                              JointKind kind, const Eigen::Vector3d& axis)
{
  JointDescription j;
  j.name = name;
  j.parent = parent;
  j.child = child;
  j.kind = kind;
  j.axis = axis;
  return j;
}

/// A body on prismatic joints x, y, z (<name>_x, ...) and, with `turning`, revolute x, y, z joints, named <name>.
inline RobotDescription cart(const std::string& name, double mass, const ShapeDescription& shape, double damping = 0.0,
                             bool turning = false)
{
  RobotDescription d;
  d.name = name;
  d.links.emplace_back();
  d.links[0].name = name + "_root";
  const std::vector<std::string> suffixes = turning ? std::vector<std::string>{ "_x", "_y", "_z", "_rx", "_ry", "_rz" }
                                                    : std::vector<std::string>{ "_x", "_y", "_z" };
  for (std::size_t i = 0; i < suffixes.size(); ++i)
  {
    const bool last = i + 1 == suffixes.size();
    LinkDescription frame;
    frame.name = name + suffixes[i] + "_frame";
    d.links.push_back(last ? solid(name, mass, shape) : frame);
    JointDescription j = joint(name + suffixes[i], d.links[i].name, d.links[i + 1].name,
                               i < 3 ? JointKind::Prismatic : JointKind::Revolute, Eigen::Vector3d::Unit(int(i % 3)));
    j.damping = i < 3 ? damping : 0.0;
    d.joints.push_back(j);
  }
  return d;
}

/// A box 1 m x 1 m x 0.1 m whose upper face lies at z = 0.
inline StaticShape table(const Material& material)
{
  StaticShape shape{ "table", box(1.0, 1.0, 0.1), material };
  shape.shape.origin.translation().z() = -0.05;
  return shape;
}

/// Twice the stiffness asked for, so that two surfaces of it in contact have just that.
inline Material half(double stiffness, double damping_ratio, double friction)
{
  return { 2.0 * stiffness, damping_ratio, friction };
}
}  // namespace phri_sim::testing
