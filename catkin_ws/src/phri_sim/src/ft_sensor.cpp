#include "phri_sim/ft_sensor.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "phri_core/check.hpp"

namespace phri_sim
{
namespace
{
using phri_control::Vector6d;

constexpr double kMinute = 60.0;  // [s]

Vector6d both(double force, double torque)
{
  return (Vector6d() << force, force, force, torque, torque, torque).finished();
}

FtSensorSettings checked(FtSensorSettings settings)
{
  phri_core::ParameterTable table;
  addParameters(table, settings);
  for (const phri_core::ParameterTable::Entry& entry : table.entries())
    phri_core::requireRange(entry.key, entry.value, entry.low, entry.high, entry.unit);
  return settings;
}
}  // namespace

void addParameters(phri_core::ParameterTable& table, FtSensorSettings& s)
{
  table.number("ft_sensor/sim/force_range", &s.force_range, "N", 1.0, 1e4, "full scale per axis, saturates")
      .number("ft_sensor/sim/torque_range", &s.torque_range, "Nm", 0.1, 1e3, "likewise")
      .number("ft_sensor/sim/force_noise", &s.force_noise, "N", 0.0, 10.0, "standard deviation per axis and sample")
      .number("ft_sensor/sim/torque_noise", &s.torque_noise, "Nm", 0.0, 1.0, "likewise")
      .number("ft_sensor/sim/force_bias", &s.force_bias, "N", 0.0, 50.0,
              "standard deviation of the untared offset, per trial")
      .number("ft_sensor/sim/torque_bias", &s.torque_bias, "Nm", 0.0, 5.0, "likewise")
      .number("ft_sensor/sim/force_drift", &s.force_drift, "N/min", 0.0, 60.0,
              "standard deviation of the offset's rate, per trial")
      .number("ft_sensor/sim/torque_drift", &s.torque_drift, "Nm/min", 0.0, 5.0, "likewise")
      .number("ft_sensor/sim/resolution", &s.resolution, "", 1e-9, 0.01, "step of the readings, of full scale")
      .number("ft_sensor/sim/cutoff", &s.cutoff, "Hz", 0.0, 500.0, "of the anti-alias filter; 0: none");
}

FtSensor::FtSensor(const FtSensorSettings& settings, double dt, std::uint64_t trial_seed, std::string_view name)
  : filter_(checked(settings).cutoff, 1, dt),
    random_(phri_core::Random::stream(trial_seed, "ft sensor " + std::string(name)))
{
  noise_ = both(settings.force_noise, settings.torque_noise);
  range_ = both(settings.force_range, settings.torque_range);
  step_ = settings.resolution * range_;
  bias_ = both(settings.force_bias, settings.torque_bias);
  rate_ = both(settings.force_drift, settings.torque_drift) * (dt / kMinute);
  for (int i = 0; i < 6; ++i)
  {
    bias_(i) *= random_.normal();
    rate_(i) *= random_.normal();
  }
}

Vector6d FtSensor::bias() const noexcept
{
  return bias_ + static_cast<double>(readings_) * rate_;
}

Vector6d FtSensor::read(const Vector6d& wrench) noexcept
{
  const Vector6d offset = bias();
  ++readings_;
  const bool finite = wrench.allFinite();
  Vector6d reading = finite ? filter_.step(wrench) : Vector6d::Constant(std::numeric_limits<double>::quiet_NaN());
  for (int i = 0; i < 6; ++i)
  {
    // drawn whatever the wrench, so that one bad sample does not change all the noise after it
    reading(i) += offset(i) + noise_(i) * random_.normal();
    const double saturated = std::clamp(reading(i), -range_(i), range_(i));
    reading(i) = std::round(saturated / step_(i)) * step_(i);
  }
  return reading;
}
}  // namespace phri_sim
