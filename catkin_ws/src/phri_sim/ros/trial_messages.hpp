#pragma once
/// What a tick looks like in messages: pure functions. Wrenches are exerted BY the named agent ON the object, in frame
/// `maze`; joint positions are along x and y of that frame.

#include <geometry_msgs/TransformStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <phri_msgs/ControllerState.h>
#include <phri_msgs/Tick.h>
#include <sensor_msgs/JointState.h>

#include "phri_sim/trial.hpp"

namespace phri_sim
{
constexpr const char* kFrame = "maze";

/// The messages of one tick, refilled in place.
struct TickMessages
{
  TickMessages();
  void fill(const phri_control::TickRecord& record, const ros::Time& stamp);

  phri_msgs::Tick tick;
  sensor_msgs::JointState joints;
  geometry_msgs::WrenchStamped human, environment, assistance, requested;
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
phri_msgs::ControllerState controllerState(const phri_control::TickRecord& record, const TrialMonitor& monitor,
                                           const ros::Time& stamp);

/// maze -> object.
geometry_msgs::TransformStamped objectTransform(const phri_control::TickRecord& record, const ros::Time& stamp);
/// world -> maze; static.
geometry_msgs::TransformStamped mazeTransform(const ros::Time& stamp);
}  // namespace phri_sim
