#pragma once
#include <deque>

#include "marker_shapes.hpp"
#include "stage_view.hpp"

namespace phri_sim
{
/// The room, in frame world: its edge, obstacles (a car and a trolley are drawn inside the boxes that they are in the
/// simulation), start, goal, all routes of the lab.
visualization_msgs::MarkerArray labMarkers(const Lab& lab, const ros::Time& stamp);

/// What carryingMarkers needs besides the moment.
struct CarryingPicture
{
  const Lab* lab = nullptr;
  const LabRoute* route = nullptr;             ///< that the person takes; null before the first trial
  std::deque<Eigen::Vector2d> real, believed;  ///< [m] where the robot's grasp has been: world, odom
  std::string title;
};

/// What moves but the robot and the object, which rviz draws from their descriptions: the person, the route, paths of
/// the robot's grasp, predicted poses of the object with 95 % ellipses, forces (4 cm per N), contacts, drift.
/// The believed path is drawn as if odom had not drifted, so that both paths begin together.
visualization_msgs::MarkerArray carryingMarkers(const CarryingPicture& picture, const Moment& moment,
                                                const phri_core::Prediction* prediction, const std::string& controller);
}  // namespace phri_sim
