#include "phri_control/force_sensor.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
using phri_core::requireRange;

constexpr double kSaturation = 0.95;            // of the range
constexpr double kOrientationTolerance = 1e-3;  // of R'R: a tenth of a percent of the weight

bool finite(const SensorMotion& motion) noexcept
{
  return motion.velocity.allFinite() && motion.angular_velocity.allFinite() && motion.acceleration.allFinite() &&
         motion.angular_acceleration.allFinite();
}

/// Angle between two orientations [rad].
double turnBetween(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) noexcept
{
  const Eigen::Matrix3d turn = a.transpose().lazyProduct(b);
  const Eigen::Vector3d axis(turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1));
  return std::atan2(axis.norm(), turn.trace() - 1.0);
}

struct CauseText
{
  const char *what, *unit, *hint;
};

CauseText textOf(TareCause cause)
{
  switch (cause)
  {
    case TareCause::Invalid:
      return { "readings or motions that are not finite", "", "check the sensor's cable and driver" };
    case TareCause::Saturated:
      return { "saturated readings", "", "take the load off" };
    case TareCause::Speed:
      return { "the sensor's speed", "m/s", "wait until the robot stands" };
    case TareCause::Turning:
      return { "the sensor's angular speed", "rad/s", "wait until the robot stands" };
    case TareCause::Turned:
      return { "the sensor's turn", "rad", "wait until the robot stands" };
    case TareCause::ForceScatter:
      return { "the scatter of the force", "N", "let go of the tool; check for vibration" };
    case TareCause::TorqueScatter:
      return { "the scatter of the torque", "Nm", "let go of the tool; check for vibration" };
    case TareCause::ForceChange:
      return { "the change of the force's bias", "N", "let go of the tool; calibrate the payload" };
    case TareCause::TorqueChange:
      return { "the change of the torque's bias", "Nm", "let go of the tool; calibrate the payload" };
    case TareCause::None:
      break;
  }
  return { "", "", "" };
}
}  // namespace

Vector6d transformWrench(const Eigen::Isometry3d& pose, const Vector6d& wrench) noexcept
{
  Vector6d result;
  const Eigen::Vector3d force = pose.linear() * wrench.head<3>();
  result.head<3>() = force;
  result.tail<3>() = pose.linear() * wrench.tail<3>() + Eigen::Vector3d(pose.translation()).cross(force);
  return result;
}

LowPass::LowPass(double cutoff, int order, double dt)
{
  requireRange("low-pass dt", dt, 1e-6, 1.0, "s");
  requireRange("low-pass cutoff", cutoff, 0.0, 0.5 / dt, "Hz");
  requireRange("low-pass order", order, 1, 2, "");
  if (cutoff == 0.0)
    return;
  const double w = 2.0 * M_PI * cutoff;
  if (order == 1)
    transition_(0, 0) = std::exp(-w * dt);
  else
  {
    const double s = w * M_SQRT1_2;  // poles -s +- i s
    const double decay = std::exp(-s * dt), c = std::cos(s * dt), n = std::sin(s * dt);
    transition_ << c + n, n / s, -w * w * n / s, c - n;
    transition_ *= decay;
  }
  // a constant input is a fixed point of output (1, 0)
  input_gain_ = Eigen::Vector2d::UnitX() - transition_.col(0);
  const Eigen::Matrix2d rest = Eigen::Matrix2d::Identity() - transition_;
  const double determinant = rest(0, 0) * rest(1, 1) - rest(0, 1) * rest(1, 0);
  // dt e1' (I - A)^-1 A e1: slope of the transfer function at frequency 0
  delay_ = dt * (rest(1, 1) * transition_(0, 0) - rest(0, 1) * transition_(1, 0)) / determinant;
}

Vector6d LowPass::step(const Vector6d& input) noexcept
{
  if (empty_)
  {
    state_.col(0) = input;
    state_.col(1).setZero();
    empty_ = false;
    return input;
  }
  const Vector6d output =
      transition_(0, 0) * state_.col(0) + transition_(0, 1) * state_.col(1) + input_gain_(0) * input;
  state_.col(1) = transition_(1, 0) * state_.col(0) + transition_(1, 1) * state_.col(1) + input_gain_(1) * input;
  state_.col(0) = output;
  return output;
}

void addParameters(phri_core::ParameterTable& table, ForceSensorSettings& s)
{
  table.number("ft_sensor/payload/mass", &s.payload.mass, "kg", 0.0, 50.0, "what hangs on the sensor, as calibrated")
      .number("ft_sensor/force_range", &s.force_range, "N", 1.0, 1e4, "full scale of the raw reading, per axis")
      .number("ft_sensor/torque_range", &s.torque_range, "Nm", 0.1, 1e3, "likewise")
      .number("ft_sensor/cutoff", &s.cutoff, "Hz", 0.0, 500.0, "of the low-pass of the wrench; 0: none")
      .integer("ft_sensor/order", &s.order, "", 1, 2, "of this low-pass")
      .flag("ft_sensor/inertial", &s.inertial, "remove the payload's inertial wrench, too")
      .number("ft_sensor/tare/time", &s.tare_time, "s", 0.05, 10.0, "readings that a tare averages")
      .number("ft_sensor/tare/force_scatter", &s.tare_force_scatter, "N", 1e-3, 100.0,
              "largest standard deviation per axis during a tare")
      .number("ft_sensor/tare/torque_scatter", &s.tare_torque_scatter, "Nm", 1e-5, 10.0, "likewise")
      .number("ft_sensor/tare/speed", &s.tare_speed, "m/s", 0.0, 0.1, "largest speed during a tare")
      .number("ft_sensor/tare/turn", &s.tare_turn, "rad/s", 0.0, 0.5,
              "largest angular speed, and [rad] largest turn, during a tare")
      .number("ft_sensor/tare/force", &s.tare_force, "N", 0.1, 1e3, "largest change of the bias by a tare, per axis")
      .number("ft_sensor/tare/torque", &s.tare_torque, "Nm", 0.01, 100.0, "likewise");
}

std::string describe(const TareReport& report)
{
  if (report.state == TareState::None)
    return "not tared";
  if (report.state == TareState::Running)
    return "taring";
  if (report.state == TareState::Done)
    return "tared";
  const CauseText words = textOf(report.cause);
  std::ostringstream text;
  text << "tare refused: " << words.what;
  if (*words.unit)
    text << " is " << report.value << ' ' << words.unit << ", expected at most " << report.bound << ' ' << words.unit;
  text << " (" << words.hint << ')';
  return text.str();
}

ForceSensor::ForceSensor(const ForceSensorSettings& settings)
  : settings_(settings), filter_(settings.cutoff, settings.order, settings.dt), bias_(settings.bias)
{
  phri_core::ParameterTable table;
  addParameters(table, settings_);
  for (const phri_core::ParameterTable::Entry& entry : table.entries())
    if (entry.kind == "number")
      requireRange(entry.key, entry.value, entry.low, entry.high, entry.unit);
  phri_core::requireFinite("ft_sensor/bias", settings.bias);
  phri_core::requireFinite("ft_sensor/payload/centre", settings.payload.centre);
  phri_core::requireRange("ft_sensor/payload/centre, distance", settings.payload.centre.norm(), 0.0, 2.0, "m");
  phri_core::requireCovariance("ft_sensor/payload/inertia", settings.payload.inertia);
  tare_samples_ = std::max(2, static_cast<int>(std::lround(settings.tare_time / settings.dt)));
}

ForceReading ForceSensor::update(const Vector6d& raw, const SensorMotion& motion) noexcept
{
  ForceReading reading;
  if (!raw.allFinite() || !isRotation(motion.orientation, kOrientationTolerance) || !finite(motion))
  {
    reading.wrench.setConstant(std::numeric_limits<double>::quiet_NaN());
    refuse(TareCause::Invalid, 0.0, 0.0);
    return reading;
  }
  reading.valid = true;
  reading.saturated = raw.head<3>().cwiseAbs().maxCoeff() >= kSaturation * settings_.force_range ||
                      raw.tail<3>().cwiseAbs().maxCoeff() >= kSaturation * settings_.torque_range;
  const Vector6d load = settings_.inertial ? payloadWrench(settings_.payload, motion)
                                           : gravityWrench(settings_.payload, motion.orientation);
  const Vector6d residual = raw - bias_ - load;
  reading.wrench = filter_.step(residual);
  if (report_.state == TareState::Running)
    accumulate(residual, reading.saturated, motion);
  return reading;
}

void ForceSensor::tare() noexcept
{
  report_ = { TareState::Running, TareCause::None, 0.0, 0.0 };
  count_ = 0;
  mean_.setZero();
  squares_.setZero();
}

void ForceSensor::setBias(const Vector6d& bias) noexcept
{
  filter_.shift(bias_ - bias);
  bias_ = bias;
  report_ = TareReport();
}

void ForceSensor::accumulate(const Vector6d& residual, bool saturated, const SensorMotion& motion) noexcept
{
  if (count_ == 0)
    first_orientation_ = motion.orientation;
  const double speed = motion.velocity.norm(), turning = motion.angular_velocity.norm();
  const double turned = turnBetween(first_orientation_, motion.orientation);
  if (saturated)
    return refuse(TareCause::Saturated, 0.0, 0.0);
  if (speed > settings_.tare_speed)
    return refuse(TareCause::Speed, speed, settings_.tare_speed);
  if (turning > settings_.tare_turn)
    return refuse(TareCause::Turning, turning, settings_.tare_turn);
  if (turned > settings_.tare_turn)
    return refuse(TareCause::Turned, turned, settings_.tare_turn);
  // Welford's update: no cancellation however large the mean
  ++count_;
  const Vector6d before = residual - mean_;
  mean_ += before / count_;
  squares_ += before.cwiseProduct(residual - mean_);
  if (count_ == tare_samples_)
    finish();
}

void ForceSensor::refuse(TareCause cause, double value, double bound) noexcept
{
  if (report_.state == TareState::Running)
    report_ = { TareState::Refused, cause, value, bound };
}

void ForceSensor::finish() noexcept
{
  const Vector6d scatter = (squares_ / (count_ - 1)).cwiseSqrt();
  const double force = scatter.head<3>().maxCoeff(), torque = scatter.tail<3>().maxCoeff();
  const double force_change = mean_.head<3>().cwiseAbs().maxCoeff();
  const double torque_change = mean_.tail<3>().cwiseAbs().maxCoeff();
  if (force > settings_.tare_force_scatter)
    return refuse(TareCause::ForceScatter, force, settings_.tare_force_scatter);
  if (torque > settings_.tare_torque_scatter)
    return refuse(TareCause::TorqueScatter, torque, settings_.tare_torque_scatter);
  if (force_change > settings_.tare_force)
    return refuse(TareCause::ForceChange, force_change, settings_.tare_force);
  if (torque_change > settings_.tare_torque)
    return refuse(TareCause::TorqueChange, torque_change, settings_.tare_torque);
  setBias(bias_ + mean_);
  report_.state = TareState::Done;
}
}  // namespace phri_control
