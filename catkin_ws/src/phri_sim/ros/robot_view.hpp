#pragma once
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>

#include <vector>

#include "lab_markers.hpp"
#include "robot_messages.hpp"
#include "stage_view.hpp"

namespace phri_sim
{
/// A robot that carries an object through the lab. In the namespace of the node:
///
/// `joint_states` (the base's joints as odometry says), `odom`, `<arm>/ft_sensor/wrench_raw` (sensor's frame),
/// `<arm>/ft_sensor/wrench` (tared, without payload, in frame `grasp`), `person_wrench` (what the simulated person
/// exerts at the far grasp, in frame `object_human`; no robot could know it), `lab` (markers, latched); transforms
/// world -> odom, odom -> grasp and, static, gripper -> object. Everything else of TF is robot_state_publisher's: one
/// for the robot's description, one for the object's.
class RobotView : public StageView
{
public:
  RobotView(ros::NodeHandle& node, std::shared_ptr<const Experiment> experiment, const ros::Time& now);

  void begin(const TrialSpec& spec, const Stage* stage) override;
  void follow(const Moment& moment) override;
  void publish(const Moment& moment) override;
  visualization_msgs::MarkerArray markers(const Moment& moment, const phri_core::Prediction* prediction,
                                          const std::string& controller) const override;
  nav_msgs::Path predictedPath(const phri_core::Prediction& prediction, const ros::Time& stamp) const override;
  void recordFirst(Recorder& recorder, const ros::Time& start) const override;
  /// Wrenches at every tick; joints and odometry at 100 Hz, transforms at 50 Hz of session time.
  void record(Recorder& recorder, const Moment& moment) override;

private:
  geometry_msgs::TransformStamped objectInHand(const ros::Time& stamp) const;
  void fill(const Moment& moment);

  std::shared_ptr<const Experiment> experiment_;
  std::string tip_frame_, sensor_frame_;
  ros::Publisher joints_, odom_, raw_, wrench_, person_, lab_;
  tf2_ros::TransformBroadcaster transforms_;
  tf2_ros::StaticTransformBroadcaster static_transforms_;

  Eigen::Isometry3d object_ = Eigen::Isometry3d::Identity();  // in the gripper
  sensor_msgs::JointState joint_message_;
  geometry_msgs::WrenchStamped raw_message_, wrench_message_, person_message_;
  CarryingPicture picture_;
};
}  // namespace phri_sim
