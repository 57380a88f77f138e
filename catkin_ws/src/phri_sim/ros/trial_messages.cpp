#include "trial_messages.hpp"

#include "operator_text.hpp"

#include <algorithm>

namespace phri_sim
{
namespace
{
constexpr int kForces = 3;  // elements of a 6-D wrench that are forces

void fillWrench(geometry_msgs::WrenchStamped& message, const phri_core::VectorDof& wrench, const std::vector<int>& axes,
                const ros::Time& stamp)
{
  message.header.stamp = stamp;
  geometry_msgs::Wrench& w = message.wrench;
  double* const elements[] = { &w.force.x, &w.force.y, &w.force.z, &w.torque.x, &w.torque.y, &w.torque.z };
  for (std::size_t i = 0; i < axes.size(); ++i)
    *elements[axes[i]] = wrench(Eigen::Index(i));
}

/// The coordinates that are forces stand first.
phri_core::VectorDof forceOf(const phri_core::VectorDof& wrench, const LoopFrame& frame)
{
  return wrench.head(std::count_if(frame.axes.begin(), frame.axes.end(), [](int axis) { return axis < kForces; }));
}

std::vector<std::string> namesOf(std::uint32_t limits)
{
  std::vector<std::string> names;
  const std::vector<std::string>& all = phri_core::limitNames();
  for (std::size_t bit = 0; bit < all.size(); ++bit)
    if (limits & (1u << bit))
      names.push_back(all[bit]);
  return names;
}
}  // namespace

LoopFrame loopFrame(const Experiment& experiment)
{
  if (experiment.planar())
    return {};
  return { "odom", "grasp", { "object_x", "object_y", "object_yaw" }, "object_states", { 0, 1, 5 } };
}

TickMessages::TickMessages(const LoopFrame& frame) : axes_(frame.axes)
{
  joints.name = frame.joints;
  joints.position.resize(frame.joints.size());
  joints.velocity.resize(frame.joints.size());
  tick.header.frame_id = joints.header.frame_id = frame.motion;
  for (auto* wrench : { &human, &environment, &assistance, &requested })
    wrench->header.frame_id = frame.wrench;
}

void TickMessages::fill(const phri_control::TickRecord& record, const ros::Time& stamp)
{
  tick.header.stamp = joints.header.stamp = stamp;
  tick.t = record.time_ns * 1e-9;
  tick.state = static_cast<std::uint8_t>(record.state);
  tick.fault = static_cast<std::uint16_t>(record.fault);
  tick.limits = record.limits;
  tick.tank = record.tank;
  tick.passivity = record.passivity;
  tick.lateness = record.lateness;
  for (std::size_t i = 0; i < axes_.size(); ++i)
  {
    joints.position[i] = record.position(Eigen::Index(i));
    joints.velocity[i] = record.velocity(Eigen::Index(i));
  }
  fillWrench(human, record.human_wrench, axes_, stamp);
  fillWrench(environment, record.environment_wrench, axes_, stamp);
  fillWrench(assistance, record.assistance_wrench, axes_, stamp);
  fillWrench(requested, record.requested_wrench, axes_, stamp);
}

phri_msgs::ControllerState controllerState(const phri_control::TickRecord& record, const TrialMonitor& monitor,
                                           const ros::Time& stamp, const LoopFrame& frame)
{
  const phri_core::VectorDof human = forceOf(record.human_wrench, frame),
                             assistance = forceOf(record.assistance_wrench, frame);
  phri_msgs::ControllerState message;
  message.header.stamp = stamp;
  message.header.frame_id = frame.motion;
  message.t = record.time_ns * 1e-9;
  message.state = phri_core::stateName(record.state);
  message.fault = static_cast<std::uint16_t>(record.fault);
  message.fault_name = phri_core::faultName(record.fault);
  message.message = monitor.message.empty() ? operatorText(record) : monitor.message;
  message.controller = monitor.controller;
  message.source = record.source;
  message.wrench_age = record.wrench_age;
  message.prediction_age = monitor.prediction_t0 < 0.0 ? -1.0 : message.t - monitor.prediction_t0;
  message.lateness = record.lateness;
  message.tank = record.tank;
  message.passivity = record.passivity;
  message.limits = monitor.limits;
  message.limit_names = namesOf(monitor.limits);
  message.human_force = human.norm();
  message.assistance_force = assistance.norm();
  message.requested_force = forceOf(record.requested_wrench, frame).norm();
  if (message.human_force > 0.0)
    message.disagreement = std::max(0.0, -human.dot(assistance) / message.human_force);
  message.failed_plans = monitor.failed_plans;
  return message;
}

tf2_msgs::TFMessage transforms(std::vector<geometry_msgs::TransformStamped> list)
{
  tf2_msgs::TFMessage message;
  message.transforms = std::move(list);
  return message;
}

geometry_msgs::TransformStamped objectTransform(const phri_control::TickRecord& record, const ros::Time& stamp)
{
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = stamp;
  transform.header.frame_id = kFrame;
  transform.child_frame_id = "object";
  transform.transform.translation.x = record.position(0);
  transform.transform.translation.y = record.position(1);
  transform.transform.rotation.w = 1.0;
  return transform;
}

geometry_msgs::TransformStamped mazeTransform(const ros::Time& stamp)
{
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = stamp;
  transform.header.frame_id = "world";
  transform.child_frame_id = kFrame;
  transform.transform.rotation.w = 1.0;
  return transform;
}
}  // namespace phri_sim
