#pragma once
/// What a tick looks like in messages: pure functions. Wrenches are exerted BY the named agent ON the object, in and
/// about the origin of the frame that LoopFrame names.

#include <geometry_msgs/TransformStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <phri_msgs/ControllerState.h>
#include <phri_msgs/Tick.h>
#include <sensor_msgs/JointState.h>
#include <tf2_msgs/TFMessage.h>

#include <string>
#include <vector>

#include "phri_sim/trial.hpp"

namespace phri_sim
{
constexpr const char* kFrame = "maze";

/// What the loop's coordinates are called in messages. By itself: the planar device.
struct LoopFrame
{
  std::string motion = kFrame;                                   ///< frame of positions and predictions
  std::string wrench = kFrame;                                   ///< frame of wrenches: its origin moves with the grasp
  std::vector<std::string> joints = { "handle_x", "handle_y" };  ///< of the object, one per coordinate
  std::string topic = "joint_states";                            ///< of these joints
  std::vector<int> axes = { 0, 1 };                              ///< per coordinate: element of a 6-D wrench
};
LoopFrame loopFrame(const Experiment& experiment);

/// The messages of one tick, refilled in place.
struct TickMessages
{
  explicit TickMessages(const LoopFrame& frame = {});
  void fill(const phri_control::TickRecord& record, const ros::Time& stamp);

  phri_msgs::Tick tick;
  sensor_msgs::JointState joints;
  geometry_msgs::WrenchStamped human, environment, assistance, requested;

private:
  std::vector<int> axes_;
};

/// What ControllerState needs to know besides the record.
struct TrialMonitor
{
  std::string controller;
  double prediction_t0 = -1.0;  ///< [s] of the prediction planned on last; negative: none yet
  std::uint32_t limits = 0;     ///< since the previous message
  std::uint32_t failed_plans = 0;
  std::string message;  ///< for the operator; empty: what the record itself says
};
/// Sizes of forces leave torques out.
phri_msgs::ControllerState controllerState(const phri_control::TickRecord& record, const TrialMonitor& monitor,
                                           const ros::Time& stamp, const LoopFrame& frame);

tf2_msgs::TFMessage transforms(std::vector<geometry_msgs::TransformStamped> list);
/// maze -> object.
geometry_msgs::TransformStamped objectTransform(const phri_control::TickRecord& record, const ros::Time& stamp);
/// world -> maze; static.
geometry_msgs::TransformStamped mazeTransform(const ros::Time& stamp);
}  // namespace phri_sim
