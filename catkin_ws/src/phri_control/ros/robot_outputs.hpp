#pragma once
#include <geometry_msgs/Twist.h>
#include <geometry_msgs/TwistStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <phri_msgs/ControllerState.h>
#include <phri_msgs/Observation.h>
#include <ros/ros.h>
#include <std_msgs/Float64MultiArray.h>
#include <tf2_msgs/TFMessage.h>

#include <string>

#include "interaction_settings.hpp"

namespace phri_control
{
/// What the state message says beside the output.
struct InteractionMonitor
{
  std::string message, controller, odometry_frame;
  double prediction_t0 = -1.0;  ///< [s] of the prediction planned on last; negative: none yet
  unsigned failed_plans = 0;
};

/// What models and controllers see of a tick.
phri_core::Observation observationOf(const TickRecord& record);

/// Everything the node publishes. Not for the real-time thread.
///   joint_velocity_command    std_msgs/Float64MultiArray [rad/s], joints from base to tip: what ros_control's
///                             JointGroupVelocityController listens to. Every cycle.
///   tool_velocity_command     geometry_msgs/Twist of the tip, in axes of base_link; instead, with output = "twist".
///   cmd_vel                   geometry_msgs/Twist of the base, in its axes; 100 Hz, with base = "omni"
///   ~command, ~measured       geometry_msgs/TwistStamped of the tip in inertial axes, wanted and measured. Every
///   cycle. human_wrench, assistance_wrench  geometry_msgs/WrenchStamped in frame `object`: on the object. Every cycle.
///   ~state                    phri_msgs/ControllerState, 100 Hz
///   observation               phri_msgs/Observation in frame `interaction`, 50 Hz while PASSIVE or ACTIVE
///   /tf                       inertial frame -> `interaction` (origin of the coordinates) -> `object` (at the tip;
///   axes
///                             of the inertial frame), 100 Hz while the robot can be located
class RobotOutputs
{
public:
  RobotOutputs(const ros::NodeHandle& node, const ros::NodeHandle& private_node, const InteractionSetup& setup);

  /// One cycle's output. `monitor` fills in what the state message needs, when it is due.
  template <typename Monitor>
  void publish(const RobotOutput& output, const Monitor& monitor)
  {
    limits_ |= output.record.limits;
    const ros::Time stamp = ros::Time::now();
    cycle(output, stamp);
    if (output.record.time_ns >= next_state_ns_)
    {
      next_state_ns_ = output.record.time_ns + kStatePeriodNs;
      slow(output, monitor(), stamp);
    }
  }

private:
  static constexpr std::int64_t kStatePeriodNs = 10000000, kObservationPeriodNs = 20000000;
  void cycle(const RobotOutput& output, const ros::Time& stamp);
  void slow(const RobotOutput& output, const InteractionMonitor& monitor, const ros::Time& stamp);
  void observe(const RobotOutput& output, const ros::Time& stamp);

  const InteractionSetup& setup_;
  ros::Publisher motion_, base_, command_, measured_, human_, assistance_, state_, observation_, transforms_;
  std_msgs::Float64MultiArray rates_;
  geometry_msgs::TwistStamped twist_;
  geometry_msgs::WrenchStamped wrench_;
  std::int64_t next_state_ns_ = 0, next_observation_ns_ = 0;
  std::uint32_t limits_ = 0;
};
}  // namespace phri_control
