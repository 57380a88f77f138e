#include "robot_outputs.hpp"

#include <algorithm>

#include "phri_msgs/conversions.hpp"

namespace phri_control
{
using phri_core::LoopState;

namespace
{
constexpr int kQueue = 10;

geometry_msgs::Twist toMessage(const Twist& twist)
{
  geometry_msgs::Twist message;
  message.linear.x = twist(0);
  message.linear.y = twist(1);
  message.linear.z = twist(2);
  message.angular.x = twist(3);
  message.angular.y = twist(4);
  message.angular.z = twist(5);
  return message;
}

geometry_msgs::Wrench toMessage(const phri_core::VectorDof& wrench, bool planar)
{
  geometry_msgs::Wrench message;
  message.force.x = wrench(0);
  message.force.y = wrench(1);
  (planar ? message.torque.z : message.force.z) = wrench(2);
  return message;
}

geometry_msgs::TransformStamped shift(const std::string& from, const std::string& to, const Eigen::Vector3d& by,
                                      const ros::Time& stamp)
{
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = stamp;
  transform.header.frame_id = from;
  transform.child_frame_id = to;
  transform.transform.translation.x = by.x();
  transform.transform.translation.y = by.y();
  transform.transform.translation.z = by.z();
  transform.transform.rotation.w = 1.0;
  return transform;
}
}  // namespace

phri_core::Observation observationOf(const TickRecord& record)
{
  phri_core::VectorState xi(record.position.size() + record.velocity.size());
  xi << record.position, record.velocity;
  return { record.time_ns * 1e-9, xi, record.human_wrench, record.environment_wrench, Eigen::VectorXd() };
}

RobotOutputs::RobotOutputs(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                           const InteractionSetup& setup)
  : setup_(setup)
{
  ros::NodeHandle own(node), self(private_node);
  const bool twist = setup.settings.output == "twist";
  motion_ = twist ? own.advertise<geometry_msgs::Twist>("tool_velocity_command", 1)
                  : own.advertise<std_msgs::Float64MultiArray>("joint_velocity_command", 1);
  if (setup.settings.mobile())
    base_ = own.advertise<geometry_msgs::Twist>("cmd_vel", 1);
  command_ = self.advertise<geometry_msgs::TwistStamped>("command", kQueue);
  measured_ = self.advertise<geometry_msgs::TwistStamped>("measured", kQueue);
  human_ = own.advertise<geometry_msgs::WrenchStamped>("human_wrench", kQueue);
  assistance_ = own.advertise<geometry_msgs::WrenchStamped>("assistance_wrench", kQueue);
  state_ = self.advertise<phri_msgs::ControllerState>("state", kQueue);
  observation_ = own.advertise<phri_msgs::Observation>("observation", kQueue);
  transforms_ = own.advertise<tf2_msgs::TFMessage>("/tf", kQueue);
  rates_.layout.dim.resize(1);
  rates_.layout.dim[0].label = "joints";
  rates_.layout.dim[0].size = rates_.layout.dim[0].stride = std::uint32_t(setup.arm.front().joints());
}

void RobotOutputs::cycle(const RobotOutput& output, const ros::Time& stamp)
{
  if (setup_.settings.output == "twist")
    motion_.publish(toMessage(output.tool));
  else
  {
    rates_.data.assign(output.rates.data(), output.rates.data() + output.rates.size());
    motion_.publish(rates_);
  }
  twist_.header.stamp = wrench_.header.stamp = stamp;
  twist_.header.frame_id = wrench_.header.frame_id = "object";
  twist_.twist = toMessage(output.commanded);
  command_.publish(twist_);
  twist_.twist = toMessage(output.measured);
  measured_.publish(twist_);
  wrench_.wrench = toMessage(output.record.human_wrench, setup_.tick.planar);
  human_.publish(wrench_);
  wrench_.wrench = toMessage(output.record.assistance_wrench, setup_.tick.planar);
  assistance_.publish(wrench_);
  if (output.record.time_ns >= next_observation_ns_)
    observe(output, stamp);
}

void RobotOutputs::observe(const RobotOutput& output, const ros::Time& stamp)
{
  const LoopState state = output.record.state;
  if (state != LoopState::Passive && state != LoopState::Active)
    return;
  next_observation_ns_ = output.record.time_ns + kObservationPeriodNs;
  phri_msgs::Observation message = phri_msgs::toMessage(observationOf(output.record));
  message.header.stamp = stamp;
  message.header.frame_id = "interaction";
  observation_.publish(message);
}

void RobotOutputs::slow(const RobotOutput& output, const InteractionMonitor& monitor, const ros::Time& stamp)
{
  if (setup_.settings.mobile())
  {
    Twist base = Twist::Zero();
    base(0) = output.base.x();
    base(1) = output.base.y();
    base(5) = output.base.z();
    base_.publish(toMessage(base));
  }
  const TickRecord& record = output.record;
  phri_msgs::ControllerState message;
  message.header.stamp = stamp;
  message.header.frame_id = "interaction";
  message.t = record.time_ns * 1e-9;
  message.state = phri_core::stateName(record.state);
  message.fault = static_cast<std::uint16_t>(record.fault);
  message.fault_name = phri_core::faultName(record.fault);
  message.message = monitor.message;
  message.controller = monitor.controller;
  message.source = record.source;
  message.wrench_age = record.wrench_age;
  message.prediction_age = monitor.prediction_t0 < 0.0 ? -1.0 : message.t - monitor.prediction_t0;
  message.lateness = record.lateness;
  message.tank = record.tank;
  message.passivity = record.passivity;
  message.limits = limits_;
  for (std::size_t bit = 0; bit < phri_core::limitNames().size(); ++bit)
    if (limits_ & (1u << bit))
      message.limit_names.push_back(phri_core::limitNames()[bit]);
  limits_ = 0;
  message.human_force = record.human_wrench.norm();
  message.assistance_force = record.assistance_wrench.norm();
  message.requested_force = record.requested_wrench.norm();
  if (message.human_force > 0.0)
    message.disagreement = std::max(0.0, -record.human_wrench.dot(record.assistance_wrench) / message.human_force);
  message.failed_plans = monitor.failed_plans;
  state_.publish(message);

  const std::string inertial = setup_.settings.mobile() ? monitor.odometry_frame : setup_.settings.base_link;
  if (output.hindrance != Hindrance::None || inertial.empty())
    return;
  tf2_msgs::TFMessage transforms;
  transforms.transforms.push_back(shift(inertial, "interaction", output.origin, stamp));
  transforms.transforms.push_back(shift("interaction", "object", output.tip.translation() - output.origin, stamp));
  transforms_.publish(transforms);
}
}  // namespace phri_control
