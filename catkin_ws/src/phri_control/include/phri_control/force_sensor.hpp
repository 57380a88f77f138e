#pragma once
#include <Eigen/Geometry>
#include <string>

#include "phri_control/payload.hpp"
#include "phri_core/parameters.hpp"

/// From `wrench_raw` to `wrench`: bias and payload removed, filtered. Signs and frames: payload.hpp.
namespace phri_control
{
/// The same wrench in and about the origin of another frame. `pose`: the present frame in the other one.
///   f' = R f,   t' = R t + p x R f
Vector6d transformWrench(const Eigen::Isometry3d& pose, const Vector6d& wrench) noexcept;

/// Low-pass of six channels, first order 1 / (s / w + 1) or second order 1 / (s^2 / w^2 + sqrt(2) s / w + 1)
/// (Butterworth), discretised exactly for an input that is constant over the period before each sample.
class LowPass
{
public:
  /// `cutoff` [Hz], 0: none, nothing is filtered. `order`: 1 or 2. Throws std::invalid_argument naming value and range.
  LowPass(double cutoff, int order, double dt);

  /// Takes the sample of this tick; the first one since construction or `reset` sets the state: no transient.
  Vector6d step(const Vector6d& input) noexcept;
  void reset() noexcept { empty_ = true; }
  /// Adds a constant to all that was filtered so far.
  void shift(const Vector6d& offset) noexcept { state_.col(0) += offset; }
  /// Delay of slow signals [s]: how far the output lags behind a ramp, to the last digit.
  double delay() const noexcept { return delay_; }

private:
  Eigen::Matrix2d transition_ = Eigen::Matrix2d::Zero();  // of (output, its derivative)
  Eigen::Vector2d input_gain_{ 1.0, 0.0 };
  Eigen::Matrix<double, 6, 2> state_ = Eigen::Matrix<double, 6, 2>::Zero();
  double delay_ = 0.0;
  bool empty_ = true;
};

struct ForceSensorSettings
{
  Payload payload;
  Vector6d bias = Vector6d::Zero();  ///< reading without load, as calibrated [N, Nm]
  double force_range = 200.0;        ///< [N] full scale of the raw reading, per axis
  double torque_range = 10.0;        ///< [Nm]
  double cutoff = 100.0;             ///< [Hz] of the low-pass; 0: none
  int order = 1;                     ///< of the low-pass: 1 or 2
  double dt = 0.001;                 ///< [s] period of the readings
  bool inertial = false;             ///< remove the payload's inertial wrench, too; needs measured accelerations

  double tare_time = 0.5;             ///< [s] readings that a tare averages
  double tare_force_scatter = 0.3;    ///< [N] largest standard deviation per axis meanwhile
  double tare_torque_scatter = 0.02;  ///< [Nm]
  double tare_speed = 0.005;          ///< [m/s] largest speed of the sensor meanwhile
  double tare_turn = 0.01;            ///< [rad/s] largest angular speed, and [rad] largest turn meanwhile
  double tare_force = 20.0;           ///< [N] largest change of the bias per axis
  double tare_torque = 1.0;           ///< [Nm]
};
/// The scalar settings, under `ft_sensor/`.
void addParameters(phri_core::ParameterTable& table, ForceSensorSettings& settings);

struct ForceReading
{
  Vector6d wrench;         ///< by human and environment on the robot, sensor's frame [N, Nm]; NaN where not valid
  bool valid = false;      ///< false: the raw reading or the motion is not finite, or the orientation no rotation
  bool saturated = false;  ///< a raw channel is at 95 % of its range or beyond: the truth may be larger
};

enum class TareState
{
  None,  ///< never asked for
  Running,
  Done,    ///< the bias is the new one
  Refused  ///< the bias is the old one
};
enum class TareCause
{
  None,
  Invalid,  ///< a reading without numbers
  Saturated,
  Speed,          ///< [m/s]
  Turning,        ///< [rad/s]
  Turned,         ///< [rad] since the tare began
  ForceScatter,   ///< [N]
  TorqueScatter,  ///< [Nm]
  ForceChange,    ///< [N] the new bias is far from the old one: somebody holds the tool, or it touches something
  TorqueChange    ///< [Nm]
};
struct TareReport
{
  TareState state = TareState::None;
  TareCause cause = TareCause::None;  ///< of a refusal
  double value = 0.0, bound = 0.0;    ///< what was measured, and how much would have been accepted
};
/// For people: what happened; of a refusal the cause, its value and its bound. Allocates: not for the tick.
std::string describe(const TareReport& report);

/// The sensor of one wrist. Only the constructor throws; the rest is noexcept and allocates nothing.
class ForceSensor
{
public:
  /// Throws std::invalid_argument naming the setting, its value and range.
  explicit ForceSensor(const ForceSensorSettings& settings);

  /// One raw reading, once per `dt`. An invalid one leaves the filter as it is.
  ForceReading update(const Vector6d& raw, const SensorMotion& motion) noexcept;

  /// Begins a tare: the readings of the next `tare_time` decide. Call where nobody touches the tool; payload and
  /// orientation are taken into account, so that any pose will do.
  void tare() noexcept;
  TareReport tareReport() const noexcept { return report_; }
  /// Sets the bias directly, ends a running tare.
  void setBias(const Vector6d& bias) noexcept;

  const Vector6d& bias() const noexcept { return bias_; }
  /// Delay that the filter adds to slow signals [s]: part of the loop's delay (see delay_estimation.hpp).
  double delay() const noexcept { return filter_.delay(); }

private:
  void accumulate(const Vector6d& residual, bool saturated, const SensorMotion& motion) noexcept;
  void refuse(TareCause cause, double value, double bound) noexcept;
  void finish() noexcept;

  ForceSensorSettings settings_;
  LowPass filter_;
  Vector6d bias_;
  TareReport report_;
  int tare_samples_ = 1, count_ = 0;
  Vector6d mean_ = Vector6d::Zero(), squares_ = Vector6d::Zero();
  Eigen::Matrix3d first_orientation_ = Eigen::Matrix3d::Identity();
};
}  // namespace phri_control
