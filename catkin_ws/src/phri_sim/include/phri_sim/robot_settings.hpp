#pragma once
#include <map>
#include <string>

#include "phri_core/parameters.hpp"
#include "phri_sim/ft_sensor.hpp"

namespace phri_sim
{
struct RobotSettings
{
  std::string model = "mobile_manipulator";  ///< description, urdf/<model>.urdf
  std::string arm = "arm_right";             ///< the one that acts; everything else holds its posture
  double arm_bandwidth = 15.0;               ///< [Hz] of the joints' position servos, critically damped
  double base_bandwidth = 4.0;               ///< [Hz] of the base's velocity loop
  double slip = 0.01;             ///< [-] standard deviation of the odometry's scale errors, drawn per trial and axis
  double heading_drift = 0.0005;  ///< [rad/s] standard deviation of the odometry's turning while it moves, likewise
  FtSensorSettings sensor;
};
/// Positions [rad, m] of the joints of all robots in which they stand naturally, from urdf/postures.yaml.
std::map<std::string, double> naturalPosture();

/// Keys of config/robots/<name>.yaml, under `robot/`.
void addParameters(phri_core::ParameterTable& table, RobotSettings& settings);
}  // namespace phri_sim
