#pragma once
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/JointState.h>

#include <mutex>
#include <string>

#include "interaction_settings.hpp"

namespace phri_control
{
/// What the robot's topics brought, for people.
struct TopicHealth
{
  std::string missing_joint;  ///< that messages with other joints of the arm lack
  std::string wrench_frame;   ///< of the newest wrench
  std::string odometry_frame;
  unsigned wrench_publishers = 0;
  bool saturated = false;  ///< the newest raw reading is at the sensor's end
  TareReport tare;
};

/// The robot's readings, from topics into the RobotTick's mailboxes, in one thread of its own:
///   joint_states                  sensor_msgs/JointState, names in any order, other joints ignored. Without velocities
///                                 they are differences of positions.
///   <arm>/ft_sensor/wrench_raw    geometry_msgs/WrenchStamped; bias, payload and noise are removed here and what is
///                                 left is published as <arm>/ft_sensor/wrench. Or, with ft_sensor/input =
///                                 "compensated", <arm>/ft_sensor/wrench itself is read.
///                                 <arm>/ft_link, geometry_msgs/PoseStamped, is the sensor's frame in base_link, for
///                                 the calibration.
///   odom                          nav_msgs/Odometry, twist in axes of child_frame_id; only with base = "omni"
/// A wrench from two publishers at a time is dropped.
class RobotTopics
{
public:
  /// Times are counted from `start_ns` of the monotonic clock. `tick` and `setup` must outlive this.
  RobotTopics(const ros::NodeHandle& node, const InteractionSetup& setup, RobotTick& tick, std::int64_t start_ns);

  /// Begins a tare with the next reading. Raw input only.
  void tare();
  TopicHealth health() const;
  std::string wrenchTopic() const { return wrench_.getTopic(); }

private:
  void joints(const sensor_msgs::JointStateConstPtr& message);
  void wrench(const geometry_msgs::WrenchStampedConstPtr& message);
  void odometry(const nav_msgs::OdometryConstPtr& message);
  Vector6d compensate(const Vector6d& raw);
  std::int64_t now() const;

  const InteractionSetup& setup_;
  RobotTick& tick_;
  std::int64_t start_ns_;
  ArmKinematics chain_;  // to the sensor
  ForceSensor sensor_;
  JointSample joints_;
  WrenchSample sample_;
  geometry_msgs::WrenchStamped clean_;
  ros::CallbackQueue queue_;
  geometry_msgs::PoseStamped pose_;
  ros::Publisher clean_publisher_, pose_publisher_;
  ros::Subscriber joint_subscriber_, wrench_, odometry_;
  mutable std::mutex mutex_;  // guards what follows
  TopicHealth health_;
  bool tare_asked_ = false;
  ros::AsyncSpinner spinner_;  // last: its thread uses all the rest
};
}  // namespace phri_control
