#pragma once
#include <cstdint>
#include <string_view>

#include "phri_control/force_sensor.hpp"
#include "phri_core/random.hpp"

namespace phri_sim
{
/// A six-axis sensor such as the JR3 of the thesis' robots. Numbers without a source are assumptions (JR3 states ranges
/// and filters; noise, drift and bias are of the order of what users see).
struct FtSensorSettings
{
  double force_range = 200.0;         ///< [N] full scale per axis, saturates
  double torque_range = 10.0;         ///< [Nm]
  double force_noise = 0.05;          ///< [N] standard deviation per axis and sample, white
  double torque_noise = 0.003;        ///< [Nm]
  double force_bias = 2.0;            ///< [N] standard deviation of the untared offset, drawn per sensor and trial
  double torque_bias = 0.1;           ///< [Nm]
  double force_drift = 0.1;           ///< [N/min] standard deviation of the offset's constant rate, drawn likewise
  double torque_drift = 0.005;        ///< [Nm/min]
  double resolution = 1.0 / 16384.0;  ///< [-] step of the readings, of full scale
  double cutoff = 500.0;              ///< [Hz] of the anti-alias filter, before the noise; 0: none
};
/// Keys under `ft_sensor/sim/`.
void addParameters(phri_core::ParameterTable& table, FtSensorSettings& settings);

/// What the wrist sensor of a simulated arm reads: `<arm>/ft_sensor/wrench_raw`.
class FtSensor
{
public:
  /// `name` tells the sensors of one trial apart (the arm's). `dt` [s] between readings. Throws std::invalid_argument.
  FtSensor(const FtSensorSettings& settings, double dt, std::uint64_t trial_seed, std::string_view name);

  /// Reading while everything beyond the sensor exerts `wrench` on the robot, in the sensor's frame [N, Nm]. A wrench
  /// that is not finite is read as NaN and does not touch the filter.
  phri_control::Vector6d read(const phri_control::Vector6d& wrench) noexcept;

  /// Offset that the next reading has [N, Nm].
  phri_control::Vector6d bias() const noexcept;

private:
  phri_control::Vector6d noise_, range_, step_, bias_, rate_;  // rate: per reading
  phri_control::LowPass filter_;
  phri_core::Random random_;
  std::uint64_t readings_ = 0;
};
}  // namespace phri_sim
