#pragma once
#include <cstdint>

#include "phri_core/interaction.hpp"
#include "phri_core/parameters.hpp"
#include "phri_core/random.hpp"

namespace phri_sim
{
/// Encoder and force/torque sensor of a simulated device.
struct SensorSettings
{
  double encoder = 1e-6;                      ///< [m] resolution
  double force_noise = 0.05;                  ///< [N] standard deviation per axis
  double force_bias = 0.05;                   ///< [N] standard deviation of the bias left after taring, drawn per trial
  double force_range = 200.0;                 ///< [N] per axis, saturates
  double force_resolution = 200.0 / 16384.0;  ///< [N]
};
void addParameters(phri_core::ParameterTable& table, SensorSettings& settings);

/// Two linear actuators with position encoders and a force/torque sensor at the handle (thesis A.1). The position servo
/// is taken as ideal: the handle is where the last command put it. Frame C: x to the right, y away from the person.
class HapticDevice
{
public:
  HapticDevice(const SensorSettings& settings, const phri_core::VectorDof& start, std::uint64_t trial_seed);

  /// Reading at `now_ns` while the person exerts `human` [N] on the handle and the scene `environment` [N].
  phri_core::Measurement read(const Eigen::Vector2d& human, const Eigen::Vector2d& environment, std::int64_t now_ns);
  void write(const phri_core::Command& command);

  Eigen::Vector2d position() const { return position_; }
  Eigen::Vector2d velocity() const { return velocity_; }

private:
  SensorSettings settings_;
  phri_core::Random noise_;
  Eigen::Vector2d position_, velocity_{ 0, 0 }, bias_;
  std::uint64_t sequence_ = 0;
};
}  // namespace phri_sim
