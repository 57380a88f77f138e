#pragma once
/// What a robot stage looks like in messages: pure functions. Frames: world -> odom -> base_link -> ... of the robot's
/// description; `grasp`: at the robot's grasp, axes of odom.

#include <geometry_msgs/TransformStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/JointState.h>

#include "stage_sample.hpp"

namespace phri_sim
{
/// The planar transform at [x, y, yaw].
Eigen::Isometry3d planarPose(const Eigen::Vector3d& pose);
/// odom in the world: where the odometry has drifted to. It puts the believed base where the real one is.
Eigen::Isometry3d odomInWorld(const StageSample& sample);

geometry_msgs::Point toPoint(const Eigen::Vector3d& x);
geometry_msgs::Pose toPose(const Eigen::Isometry3d& pose);
geometry_msgs::TransformStamped toTransform(const Eigen::Isometry3d& pose, const std::string& parent,
                                            const std::string& child, const ros::Time& stamp);
geometry_msgs::WrenchStamped toWrench(const Vector6& wrench, const std::string& frame, const ros::Time& stamp);

/// All joints as the robot knows them: the three of the base (odom -> base_link) as its odometry says, the others as
/// their encoders do.
void fillJoints(const StageSample& sample, const ros::Time& stamp, sensor_msgs::JointState& message);
/// odom -> base_link; the twist is in the axes of base_link.
nav_msgs::Odometry odometry(const StageSample& sample, const ros::Time& stamp);
/// world -> odom, odom -> grasp. The robot's own links are robot_state_publisher's.
std::vector<geometry_msgs::TransformStamped> robotTransforms(const StageSample& sample, const ros::Time& stamp);
}  // namespace phri_sim
