#include "phri_sim/haptic_device.hpp"

#include <algorithm>
#include <cmath>

namespace phri_sim
{
void addParameters(phri_core::ParameterTable& table, SensorSettings& s)
{
  table.number("encoder/resolution", &s.encoder, "m", 1e-9, 1e-3, "step of the position encoders")
      .number("ft_sensor/noise", &s.force_noise, "N", 0.0, 10.0, "standard deviation per axis and sample")
      .number("ft_sensor/bias", &s.force_bias, "N", 0.0, 50.0,
              "standard deviation of the bias left after taring, per trial")
      .number("ft_sensor/range", &s.force_range, "N", 1.0, 1000.0, "saturation per axis")
      .number("ft_sensor/resolution", &s.force_resolution, "N", 1e-6, 1.0, "step of the readings");
}

HapticDevice::HapticDevice(const SensorSettings& settings, const phri_core::VectorDof& start, std::uint64_t trial_seed)
  : settings_(settings), noise_(phri_core::Random::stream(trial_seed, "force sensor")), position_(start)
{
  bias_ = settings.force_bias * Eigen::Vector2d(noise_.normal(), noise_.normal());
}

phri_core::Measurement HapticDevice::read(const Eigen::Vector2d& human, const Eigen::Vector2d& environment,
                                          std::int64_t now_ns)
{
  phri_core::Measurement m;
  m.receive_ns = m.stamp_ns = now_ns;
  m.sequence = ++sequence_;
  m.position = (position_ / settings_.encoder).array().round() * settings_.encoder;
  m.environment_wrench = environment;
  m.human_wrench.resize(2);
  for (int i = 0; i < 2; ++i)
  {
    const double force = human(i) + bias_(i) + settings_.force_noise * noise_.normal();
    const double saturated = std::clamp(force, -settings_.force_range, settings_.force_range);
    m.human_wrench(i) = std::round(saturated / settings_.force_resolution) * settings_.force_resolution;
  }
  return m;
}

void HapticDevice::write(const phri_core::Command& command)
{
  position_ = command.position;
  velocity_ = command.velocity;
}
}  // namespace phri_sim
