#pragma once
/// What rviz shows of a trial: pure functions from the world to messages, all in frame `maze`, top view.

#include <nav_msgs/OccupancyGrid.h>
#include <nav_msgs/Path.h>
#include <visualization_msgs/MarkerArray.h>

#include <deque>

#include "phri_sim/trial.hpp"

namespace phri_sim
{
/// x [m] in the plane of the maze, `z` [m] above it.
geometry_msgs::Point point(const Eigen::Vector2d& x, double z);

/// Everything that changes from picture to picture.
struct LivePicture
{
  const phri_control::TickRecord* record = nullptr;
  const std::vector<MovingObstacle>* obstacles = nullptr;
  const phri_core::Prediction* prediction = nullptr;   ///< newest; may be null
  const Eigen::Vector2d* dot = nullptr;                ///< of the exemplary run to follow [m]; may be null
  const std::deque<Eigen::Vector2d>* trail = nullptr;  ///< where the object has been [m]
  std::string title;                                   ///< of the trial
};

/// Object, path to follow and dot of an exemplary run, start, goal, moving obstacles, trail, forces of human, robot and
/// environment as arrows (2 mm per N), 95 % ellipses of the predicted positions, and a legend with the forces' sizes.
visualization_msgs::MarkerArray markers(const Scene& scene, const LivePicture& picture, const ros::Time& stamp);

nav_msgs::Path predictedPath(const phri_core::Prediction& prediction, const ros::Time& stamp);

/// The picture of the scene: 100 where wall, else 0.
nav_msgs::OccupancyGrid occupancyGrid(const Scene& scene, const ros::Time& stamp);
}  // namespace phri_sim
