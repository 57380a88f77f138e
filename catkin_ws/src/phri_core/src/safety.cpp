#include "phri_core/safety.hpp"

#include <algorithm>
#include <cmath>

#include "phri_core/check.hpp"

namespace phri_core
{
namespace
{
constexpr double kNanosecond = 1e-9;
constexpr double kFutureStamp = 0.001;  // [s] a stamp may lie ahead of the clock
constexpr double kSaturation = 0.95;    // of the sensor's range
constexpr int kSaturatedSamples = 3;
}  // namespace

const char* faultName(FaultCode code)
{
  switch (code)
  {
    case FaultCode::None:
      return "NONE";
    case FaultCode::WrenchStale:
      return "E_WRENCH_STALE";
    case FaultCode::WrenchFrame:
      return "E_FRAME";
    case FaultCode::PositionInvalid:
      return "E_POSITION_INVALID";
    case FaultCode::LateCycle:
      return "E_LATE_CYCLE";
    case FaultCode::NotFinite:
      return "E_NOT_FINITE";
  }
  return "UNKNOWN";
}

const char* stateName(LoopState state)
{
  constexpr std::array<const char*, kLoopStates> names = { "INIT", "IDLE", "PASSIVE", "ACTIVE", "FAULT" };
  return names[static_cast<std::size_t>(state)];
}

const std::vector<std::string>& limitNames()
{
  static const std::vector<std::string> names = { "wrench",  "force",     "slew",     "power",        "tank",
                                                  "release", "workspace", "velocity", "acceleration", "bias" };
  return names;
}

ParameterTable parameterTable(SafetySettings& s)
{
  ParameterTable table;
  table
      .number("guard/sensor_range", &s.sensor_range, "N", 1.0, 1000.0,
              "beyond it a wrench sample is rejected, per axis")
      .number("guard/hold", &s.hold, "s", 0.0, 0.02, "time the last good wrench is held before it ramps to zero")
      .number("guard/fault_age", &s.fault_age, "s", 0.002, 0.1, "age of the last good wrench that leads to FAULT")
      .number("guard/late_cycle", &s.late_cycle, "s", 0.002, 1.0, "lateness of a cycle that leads to FAULT")
      .number("limits/wrench", &s.wrench_max, "N", 1.0, 1000.0, "clamp of the human force")
      .number("limits/assistance_force", &s.assistance_max, "N", 0.0, 60.0, "clamp of the assistance force")
      .number("limits/assistance_slew", &s.assistance_slew, "N/s", 1.0, 10000.0,
              "growth of the assistance force per axis")
      .number("limits/assistance_power", &s.assistance_power, "W", 0.0, 15.0, "clamp of the injected power")
      .number("tank/max", &s.tank_max, "J", 0.01, 1.5, "capacity of the energy tank")
      .number("tank/initial", &s.tank_initial, "J", 0.0, 1.5, "energy in the tank at the start")
      .number("tank/ramp", &s.tank_ramp, "-", 0.01, 1.0,
              "fraction of the capacity below which assistance is scaled down")
      .number("bias/force", &s.bias_force, "N", 0.1, 50.0,
              "a sensor that reads more at rest, in IDLE, is biased or held")
      .number("bias/time", &s.bias_time, "s", 0.05, 5.0, "for how long it must read that; then no start")
      .number("release/force", &s.release_force, "N", 0.0, 10.0, "human force below which the hand counts as let go")
      .number("release/time", &s.release_time, "s", 0.02, 5.0, "for how long it must be below")
      .flag("autonomous_completion", &s.autonomous_completion, "the robot may go on when the hand has let go")
      .number("fade", &s.fade, "s", 0.02, 2.0, "cross-fade between strategies and to passive")
      .number("limits/velocity", &s.velocity_max, "m/s", 0.001, 1.0, "clamp of the speed")
      .number("limits/acceleration", &s.acceleration_max, "m/s2", 0.01, 100.0,
              "clamp of the acceleration, speeding up only")
      .number("limits/jerk", &s.jerk_max, "m/s3", 1.0, 1e5, "growth of the acceleration, speeding up only")
      .number("limits/workspace", &s.workspace, "m", 0.001, 10.0, "half width of the workspace per axis")
      .number("limits/funnel", &s.funnel, "1/s", 1.0, 500.0,
              "outward speed allowed per distance to the workspace's edge")
      .number("limits/rotation_length", &s.rotation_length, "m", 0.01, 10.0,
              "an angle counts as the motion of a point so far away, a torque as a force there")
      .number("fault_damping", &s.fault_damping, "-", 1.0, 100.0, "factor on the damping in FAULT");
  return table;
}

VectorDof lengths(const SafetySettings& settings, Eigen::Index dof)
{
  requireRange("rotations", settings.rotations, 0, static_cast<double>(dof), "");
  VectorDof result = VectorDof::Ones(dof);
  result.tail(settings.rotations).setConstant(settings.rotation_length);
  return result;
}

InputGuard::InputGuard(const SafetySettings& settings, Eigen::Index dof)
  : settings_(settings), lengths_(lengths(settings, dof)), last_good_(VectorDof::Zero(dof))
{
}

bool InputGuard::accept(const Measurement& m, std::int64_t now_ns) noexcept
{
  if (m.frame != 0)
  {
    ++counters_.bad_frame;
    wrong_frame_ = true;
    return false;
  }
  wrong_frame_ = false;
  if (m.human_wrench.size() != last_good_.size() || !m.human_wrench.allFinite())
  {
    ++counters_.not_finite;
    return false;
  }
  const double largest = m.human_wrench.cwiseQuotient(lengths_).cwiseAbs().maxCoeff();
  if (largest > settings_.sensor_range)
  {
    ++counters_.out_of_range;
    return false;
  }
  const double stamp_age = (now_ns - m.stamp_ns) * kNanosecond;
  if (stamp_age > settings_.fault_age || stamp_age < -kFutureStamp)
  {
    ++counters_.bad_stamp;
    return false;
  }
  saturated_samples_ = largest >= kSaturation * settings_.sensor_range ? saturated_samples_ + 1 : 0;
  return true;
}

InputGuard::Verdict InputGuard::check(const Measurement& m, std::int64_t now_ns) noexcept
{
  if (!seen_)
    last_good_ns_ = now_ns;  // the first sample has as long to come as any other
  if (!seen_ || m.sequence > last_sequence_)
  {
    last_sequence_ = m.sequence;
    if (accept(m, now_ns))
    {
      last_good_ = m.human_wrench;
      last_good_ns_ = m.receive_ns;
    }
  }
  else if (m.sequence < last_sequence_)
    ++counters_.out_of_order;
  seen_ = true;

  Verdict verdict;
  verdict.age = (now_ns - last_good_ns_) * kNanosecond;
  verdict.good = verdict.age <= settings_.hold && !wrong_frame_;
  verdict.saturated = saturated_samples_ >= kSaturatedSamples;
  const double ramp_end = std::max(settings_.fault_age, settings_.hold + 1e-6);
  const double weight =
      verdict.good ? 1.0 : std::max(0.0, 1.0 - (verdict.age - settings_.hold) / (ramp_end - settings_.hold));
  verdict.wrench = wrong_frame_ ? VectorDof::Zero(last_good_.size()) : VectorDof(last_good_ * std::min(1.0, weight));
  verdict.force = verdict.wrench.cwiseQuotient(lengths_).norm();
  if (verdict.force > settings_.wrench_max)
  {
    verdict.wrench *= settings_.wrench_max / verdict.force;
    verdict.force = settings_.wrench_max;
    verdict.clamped = true;
  }
  if (wrong_frame_)
    verdict.fault = FaultCode::WrenchFrame;
  else if (verdict.age > settings_.fault_age)
    verdict.fault = FaultCode::WrenchStale;
  else if (m.position.size() != last_good_.size() || !m.position.allFinite())
    verdict.fault = FaultCode::PositionInvalid;
  return verdict;
}

AssistanceLimiter::AssistanceLimiter(const SafetySettings& settings, Eigen::Index dof, double dt)
  : settings_(settings),
    lengths_(lengths(settings, dof)),
    dt_(dt),
    energy_(std::min(settings.tank_initial, settings.tank_max)),
    slewed_(VectorDof::Zero(dof))
{
}

void AssistanceLimiter::reset() noexcept
{
  energy_ = std::min(settings_.tank_initial, settings_.tank_max);
  slewed_.setZero();
}

VectorDof AssistanceLimiter::apply(const VectorDof& requested, const VectorDof& v, const VectorDof& d,
                                   std::uint32_t& limits) noexcept
{
  VectorDof u = requested;
  if (!u.allFinite())
    u.setZero();
  const double norm = u.cwiseQuotient(lengths_).norm();
  if (norm > settings_.assistance_max)
  {
    u *= settings_.assistance_max / norm;
    limits |= kLimitForce;
  }
  for (Eigen::Index i = 0; i < u.size(); ++i)
  {
    const double step = settings_.assistance_slew * lengths_(i) * dt_;
    // what the last tick already had of this sign is free; only the rest counts as growth
    const double free = u(i) * slewed_(i) > 0.0 ? std::min(std::abs(u(i)), std::abs(slewed_(i))) : 0.0;
    if (std::abs(u(i)) - free > step)
    {
      u(i) = std::copysign(free + step, u(i));
      limits |= kLimitSlew;
    }
  }
  slewed_ = u;
  double power = u.dot(v);
  if (power > settings_.assistance_power)
  {
    u *= settings_.assistance_power / power;
    power = settings_.assistance_power;
    limits |= kLimitPower;
  }
  if (power > 0.0)
  {
    const double gamma = std::min(1.0, energy_ / (settings_.tank_ramp * settings_.tank_max));
    if (gamma < 1.0)
    {
      u *= gamma;
      power *= gamma;
      limits |= kLimitTank;
    }
  }
  const double dissipated = (d.array() * v.array().square()).sum();
  energy_ = std::min(settings_.tank_max, std::max(0.0, energy_ + dt_ * (dissipated - power)));
  return u;
}

MotionLimiter::MotionLimiter(const SafetySettings& settings, Eigen::Index dof, double dt)
  : settings_(settings), lengths_(lengths(settings, dof)), dt_(dt)
{
}

void MotionLimiter::reset() noexcept
{
  last_acceleration_ = 0.0;
}

void MotionLimiter::apply(const VectorDof& x_before, const VectorDof& v_before, VectorDof& x, VectorDof& v,
                          std::uint32_t& limits) noexcept
{
  if (!v.allFinite() || !x.allFinite())
  {
    v = VectorDof::Zero(v_before.size());
    x = x_before;
  }
  bool changed = false;
  const double speed_before = v_before.cwiseProduct(lengths_).norm();
  const VectorDof a = (v - v_before) / dt_;
  const double magnitude = a.cwiseProduct(lengths_).norm();
  double acceleration = 0.0;
  if (v.cwiseProduct(lengths_).norm() > speed_before)
  {
    acceleration = magnitude;
    const double allowed = std::min(settings_.acceleration_max, last_acceleration_ + settings_.jerk_max * dt_);
    if (magnitude > allowed)
    {
      v = v_before + a * (allowed / magnitude * dt_);
      acceleration = allowed;
      changed = true;
      limits |= kLimitAcceleration;
    }
  }
  last_acceleration_ = acceleration;
  const double speed = v.cwiseProduct(lengths_).norm();
  if (speed > settings_.velocity_max)
  {
    v *= settings_.velocity_max / speed;
    changed = true;
    limits |= kLimitVelocity;
  }
  for (Eigen::Index i = 0; i < v.size() - settings_.rotations; ++i)
  {
    const double room = settings_.workspace - std::copysign(1.0, v(i)) * x_before(i);
    const double allowed = settings_.funnel * std::max(0.0, room);
    if (std::abs(v(i)) > allowed)
    {
      v(i) = std::copysign(allowed, v(i));
      changed = true;
      limits |= kLimitWorkspace;
    }
  }
  if (changed)
    x = x_before + 0.5 * dt_ * (v_before + v);
}
}  // namespace phri_core
