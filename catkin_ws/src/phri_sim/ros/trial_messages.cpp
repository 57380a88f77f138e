#include "trial_messages.hpp"

#include "operator_text.hpp"

#include <algorithm>

namespace phri_sim
{
namespace
{
void fillWrench(geometry_msgs::WrenchStamped& message, const phri_core::VectorDof& wrench, const ros::Time& stamp)
{
  message.header.stamp = stamp;
  message.wrench.force.x = wrench(0);
  message.wrench.force.y = wrench(1);
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

TickMessages::TickMessages()
{
  joints.name = { "handle_x", "handle_y" };
  joints.position.resize(2);
  joints.velocity.resize(2);
  tick.header.frame_id = joints.header.frame_id = kFrame;
  for (auto* wrench : { &human, &environment, &assistance, &requested })
    wrench->header.frame_id = kFrame;
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
  for (int i = 0; i < 2; ++i)
  {
    joints.position[i] = record.position(i);
    joints.velocity[i] = record.velocity(i);
  }
  fillWrench(human, record.human_wrench, stamp);
  fillWrench(environment, record.environment_wrench, stamp);
  fillWrench(assistance, record.assistance_wrench, stamp);
  fillWrench(requested, record.requested_wrench, stamp);
}

phri_msgs::ControllerState controllerState(const phri_control::TickRecord& record, const TrialMonitor& monitor,
                                           const ros::Time& stamp)
{
  phri_msgs::ControllerState message;
  message.header.stamp = stamp;
  message.header.frame_id = kFrame;
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
  message.human_force = record.human_wrench.norm();
  message.assistance_force = record.assistance_wrench.norm();
  message.requested_force = record.requested_wrench.norm();
  if (message.human_force > 0.0)
    message.disagreement = std::max(0.0, -record.human_wrench.dot(record.assistance_wrench) / message.human_force);
  message.failed_plans = monitor.failed_plans;
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
