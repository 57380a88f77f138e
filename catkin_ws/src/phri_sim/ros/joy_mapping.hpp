#pragma once
/// What sensor_msgs/Joy means for the hand; without ROS.
///
/// Joy's convention (REP-103 seen from the person): axis 0 is +1 to the LEFT, axis 1 is +1 FORWARD (away from the
/// person). Frame `maze`: x to the right, y away from the person. So stick right is +x and stick forward is +y:
///   v = speed (-axes[0], axes[1]),
/// with a dead zone around the middle that is cut out without a step, and a length of at most `speed`.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

namespace phri_sim
{
constexpr double kStickDeadZone = 0.08;  ///< of the full deflection
constexpr std::size_t kStartButton = 0, kStopButton = 1;

/// Velocity [m/s] for a stick's axes; zero within the dead zone, and for axes that are missing or not finite.
inline Eigen::Vector2d stickVelocity(const std::vector<float>& axes, double speed)
{
  if (axes.size() < 2 || !std::isfinite(axes[0]) || !std::isfinite(axes[1]))
    return { 0.0, 0.0 };
  const Eigen::Vector2d stick(-axes[0], axes[1]);
  const double deflection = stick.norm();
  if (deflection <= kStickDeadZone)
    return { 0.0, 0.0 };
  const double live = (std::min(deflection, 1.0) - kStickDeadZone) / (1.0 - kStickDeadZone);
  return speed * live / deflection * stick;
}

/// True when button `index` went down between two messages.
inline bool pressed(const std::vector<int>& before, const std::vector<int>& now, std::size_t index)
{
  return index < now.size() && now[index] && !(index < before.size() && before[index]);
}
}  // namespace phri_sim
