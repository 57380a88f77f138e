#pragma once
#include <Eigen/Core>

/// Wrenches are exerted BY the named agent (human, environment, robot) ON the object, expressed in and taken about the
/// origin of a named frame.
namespace phri_core
{
/// Largest number of Cartesian degrees of freedom of a rendered object: a rigid body.
constexpr int kMaxDof = 6;

/// Coordinates, velocities or forces of a rendered object with 1..6 degrees of freedom. Lives on the stack whatever its
/// size: resizing never allocates. Order x, y, z, rx, ry, rz (a planar object: x, y); [m, rad] or [N, Nm].
using VectorDof = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxDof, 1>;

/// Motion state xi = [x; xdot] (2 dof), [m, rad; m/s, rad/s]. Lives on the stack.
using VectorState = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * kMaxDof, 1>;
}  // namespace phri_core
