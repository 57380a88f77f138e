#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "phri_sim/walking_path.hpp"

namespace phri_sim
{
/// An upright box that stands on the floor.
struct LabBox
{
  std::string name;
  Eigen::Vector2d center{ 0, 0 };  ///< [m] world
  Eigen::Vector2d size{ 1, 1 };    ///< [m] full lengths along the box's own x and y
  double yaw = 0.0;                ///< [rad]
  double height = 1.0;             ///< [m]

  /// [m] from its outline in the plane, negative inside.
  double distance(const Eigen::Vector2d& x) const noexcept;
};

/// A way that a person may choose for the far grasp.
struct LabRoute
{
  std::string name;
  std::vector<Eigen::Vector2d> waypoints;  ///< [m] far grasp, first: at the start, last: at the goal
  std::vector<std::string> passes;         ///< what it passes, in words, in order
  double goal_yaw = 0.0;                   ///< [rad] of the bumper on arrival: along the last leg
};

/// A room in which something long is carried from a start to a goal past obstacles, seen from above: x to the right, y
/// up, the world frame's origin in the lower left corner.
struct Lab
{
  std::string name;
  Eigen::Vector2d size{ 10, 10 };  ///< [m] of the room
  double object_length = 1.2;      ///< [m]
  double grasp_distance = 1.1;     ///< [m] between robot's and person's grasp, middle to middle of the object
  double object_mass = 1.9;        ///< [kg]
  double start_yaw = 0.0;          ///< [rad] of the object, from the robot's grasp to the person's
  Eigen::Vector2d start{ 0, 0 };   ///< [m] far grasp
  Eigen::Vector2d goal{ 0, 0 };    ///< [m] middle of the object
  double goal_axis = 0.0;          ///< [rad] of the object at the goal, either way round
  double turning_radius = 0.6;     ///< [m] tightest of the far grasp's path
  std::vector<LabBox> boxes;
  std::vector<LabRoute> routes;

  /// [m] to the nearest box or to the room's edge, negative inside a box or outside the room.
  double clearance(const Eigen::Vector2d& x) const noexcept;
  /// Throws std::invalid_argument naming the known routes.
  const LabRoute& route(const std::string& name) const;
  WalkingPath path(const LabRoute& route) const { return WalkingPath(route.waypoints, turning_radius); }
};

/// Loads `config/scenes/<name>.yaml` or a path. Throws phri_core::ParameterError listing all that is wrong: unknown
/// keys, values out of range, routes that do not begin at the start or end at the goal, do not fit their corners, or
/// lead nearer than 0.2 m to an obstacle.
Lab loadLab(const std::string& name_or_path);
}  // namespace phri_sim
