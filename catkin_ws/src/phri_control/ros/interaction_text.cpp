#include "interaction_text.hpp"

#include <cmath>
#include <cstdio>

namespace phri_control
{
using phri_core::FaultCode;
using phri_core::LoopState;

namespace
{
constexpr double kPlausibleAge = 0.5;  // [s] a larger age of a stamp is another clock rather than a delay

template <typename... Values>
std::string text(const char* format, Values... values)
{
  char out[400];
  std::snprintf(out, sizeof(out), format, values...);
  return out;
}

std::string hindranceText(Hindrance hindrance, const RobotOutput& output, const TopicHealth& health,
                          const InteractionSetup& setup)
{
  switch (hindrance)
  {
    case Hindrance::None:
      return "";
    case Hindrance::NoJoints:
      return health.missing_joint.empty() ? "no joint_states of arm " + setup.settings.arm + ": is its driver running?"
                                          : "joint_states lack " + health.missing_joint;
    case Hindrance::JointsStale:
      if (output.joint_age <= setup.tick.joint_age)
        return text("joint_states were more than %g s apart: is the driver late?", setup.tick.joint_age);
      return text("joint_states are %.4f s old, expected at most %g s: is the driver alive?", output.joint_age,
                  setup.tick.joint_age);
    case Hindrance::NoOdometry:
      return "no odom: is the base's driver running?";
    case Hindrance::OdometryStale:
      if (output.odometry_age <= setup.tick.odometry_age)
        return text("odom was more than %g s apart: is the base's driver late?", setup.tick.odometry_age);
      return text("odom is %.4f s old, expected at most %g s: is the base's driver alive?", output.odometry_age,
                  setup.tick.odometry_age);
    case Hindrance::NotFollowing:
      return text("the tool was more than %g m from where it was told to be: does the robot follow its commands?",
                  setup.tick.following_error);
  }
  return "";
}

std::string frameText(const TopicHealth& health, const InteractionSetup& setup)
{
  return "the wrench comes in frame \"" + health.wrench_frame + "\", expected \"" + setup.settings.ft_frame +
         "\": correct the driver's frame_id or ft_sensor/frame";
}
}  // namespace

std::string obstacleText(const RobotOutput& output, const TopicHealth& health, const InteractionSetup& setup)
{
  if (output.hindrance != Hindrance::None)
    return hindranceText(output.hindrance, output, health, setup);
  if (health.wrench_publishers > 1)
    return text("%u nodes publish the wrench, expected one", health.wrench_publishers);
  if (!output.wrench_seen)
    return "no wrench yet: is the force/torque sensor's driver running?";
  if (!output.right_frame)
    return frameText(health, setup);
  if (std::abs(output.stamp_age) > kPlausibleAge)
    return text("the wrench's stamp is %.3f s old on arrival: synchronise the clocks, or set ft_sensor/stamps: arrival",
                output.stamp_age);
  if (output.record.wrench_age > setup.loop.safety.fault_age)
    return text("the newest good wrench is %.3f s old, expected at most %g s", output.record.wrench_age,
                setup.loop.safety.fault_age);
  if (output.record.limits & phri_core::kLimitBias)
    return text("the sensor reads %.1f N at rest, expected at most %g N: let go of the tool, or tare",
                output.record.human_wrench.norm(), setup.loop.safety.bias_force);
  return "";
}

std::string operatorText(const RobotOutput& output, const TopicHealth& health, const InteractionSetup& setup)
{
  if (output.record.state == LoopState::Idle)
  {
    const std::string obstacle = obstacleText(output, health, setup);
    return obstacle.empty() ? "stopped: call start" : obstacle;
  }
  if (output.record.state != LoopState::Fault)
    return health.saturated ? "the force/torque sensor is at the end of its range" : "";
  std::string cause;
  switch (output.record.fault)
  {
    case FaultCode::None:
      break;
    case FaultCode::WrenchStale:
      cause = "no good wrench for too long: check the force/torque sensor and its driver";
      break;
    case FaultCode::WrenchFrame:
      cause = frameText(health, setup);
      break;
    case FaultCode::PositionInvalid:
      cause = hindranceText(output.cause, output, health, setup);
      break;
    case FaultCode::LateCycle:
      cause = "the loop came too late: the machine is too busy for 1 kHz";
      break;
    case FaultCode::NotFinite:
      cause = "the command was not a number";
      break;
  }
  return cause + "; then let go for 1 s, clear the fault and start";
}
}  // namespace phri_control
