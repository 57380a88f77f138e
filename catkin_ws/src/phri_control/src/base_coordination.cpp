#include "phri_control/base_coordination.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
/// Shrinks towards 0 by `zone`, continuously.
double beyond(double value, double zone)
{
  return std::copysign(std::max(0.0, std::abs(value) - zone), value);
}

/// Speed for the speed `gain * error` that a proportional law asks for: what braking at `acceleration` can follow.
double brakable(double speed, double gain, double acceleration)
{
  const double linear = gain > 0.0 ? acceleration / gain : 0.0;  // largest speed of the proportional part
  return speed > linear ? std::sqrt(linear * (2.0 * speed - linear)) : speed;
}
}  // namespace

BaseErrors baseErrors(const Eigen::Isometry3d& actual, const Eigen::Isometry3d& preferred) noexcept
{
  const Eigen::Matrix3d turn = actual.linear().lazyProduct(preferred.linear().transpose());
  BaseErrors errors;
  errors.heading = std::atan2(turn(1, 0) - turn(0, 1), turn(0, 0) + turn(1, 1));
  const Eigen::Vector2d goal = actual.translation().head<2>() -
                               Eigen::Rotation2Dd(errors.heading) * Eigen::Vector2d(preferred.translation().head<2>());
  errors.distance = goal.x();
  errors.tangential = goal.y();
  return errors;
}

BaseCoordination::BaseCoordination(const CoordinationSettings& settings) : settings_(settings)
{
  phri_core::requireRange("dt", settings.dt, 1e-5, 0.1, "s");
  phri_core::requireRange("speed", settings.speed, 1e-3, 5.0, "m/s");
  phri_core::requireRange("turn_rate", settings.turn_rate, 1e-3, 10.0, "rad/s");
  phri_core::requireRange("acceleration", settings.acceleration, 1e-3, 100.0, "m/s^2");
  phri_core::requireRange("turn_acceleration", settings.turn_acceleration, 1e-3, 100.0, "rad/s^2");
  phri_core::requireRange("distance_gain", settings.distance_gain, 0.0, 20.0, "1/s");
  phri_core::requireRange("tangential_gain", settings.tangential_gain, 0.0, 20.0, "1/s");
  phri_core::requireRange("heading_gain", settings.heading_gain, 0.0, 20.0, "1/s");
  phri_core::requireRange("feedforward", settings.feedforward, 0.0, 1.0, "");
  phri_core::requireRange("dead_zone", settings.dead_zone, 0.0, 1.0, "m");
  phri_core::requireRange("heading_dead_zone", settings.heading_dead_zone, 0.0, M_PI, "rad");
  phri_core::requireFinite("preferred", settings.preferred.matrix());
}

BaseTwist BaseCoordination::update(const Eigen::Isometry3d& end_effector, const Eigen::Vector3d& motion) noexcept
{
  if (!end_effector.matrix().allFinite() || !motion.allFinite())
    return brake();
  const CoordinationSettings& s = settings_;
  errors_ = baseErrors(end_effector, s.preferred);
  const double error = std::hypot(errors_.distance, errors_.tangential);
  const double share = error > 0.0 ? beyond(error, s.dead_zone) / error : 0.0;
  BaseTwist wanted(s.distance_gain * share * errors_.distance, s.tangential_gain * share * errors_.tangential,
                   s.heading_gain * beyond(errors_.heading, s.heading_dead_zone));
  const double asked = wanted.head<2>().norm();
  if (asked > 0.0)
    wanted.head<2>() *= brakable(asked, std::max(s.distance_gain, s.tangential_gain), s.acceleration) / asked;
  wanted.z() = std::copysign(brakable(std::abs(wanted.z()), s.heading_gain, s.turn_acceleration), wanted.z());
  // the goal turns with the end-effector, on the other end of the lever from it
  const Eigen::Vector2d lever =
      Eigen::Vector2d(errors_.distance, errors_.tangential) - Eigen::Vector2d(end_effector.translation().head<2>());
  wanted +=
      s.feedforward * BaseTwist(motion.x() - motion.z() * lever.y(), motion.y() + motion.z() * lever.x(), motion.z());
  const double speed = wanted.head<2>().norm();
  if (speed > s.speed)
    wanted.head<2>() *= s.speed / speed;
  wanted.z() = std::clamp(wanted.z(), -s.turn_rate, s.turn_rate);
  return approach(wanted);
}

BaseTwist BaseCoordination::approach(const BaseTwist& wanted) noexcept
{
  BaseTwist change = wanted - command_;
  const double most = settings_.acceleration * settings_.dt, turn = settings_.turn_acceleration * settings_.dt;
  const double size = change.head<2>().norm();
  if (size > most)
    change.head<2>() *= most / size;
  change.z() = std::clamp(change.z(), -turn, turn);
  command_ += change;
  return command_;
}
}  // namespace phri_control
