#include "phri_sim/spring_hand.hpp"

#include <algorithm>
#include <cmath>

#include "phri_core/check.hpp"
#include "phri_core/safety.hpp"

namespace phri_sim
{
namespace
{
Eigen::Vector2d bounded(const Eigen::Vector2d& value, double most)
{
  const double norm = value.norm();
  return norm > most ? Eigen::Vector2d(value * (most / norm)) : value;
}
}  // namespace

void addParameters(phri_core::ParameterTable& table, SpringSettings& s)
{
  table.number("hand/stiffness", &s.stiffness, "N/m", 10.0, 5000.0, "of the spring between target and handle")
      .number("hand/damping", &s.damping, "Ns/m", 0.0, 2000.0, "of the handle relative to its target")
      .number("hand/force_max", &s.force_max, "N", 1.0, 140.0, "at which the spring's force saturates")
      .number("hand/smoothing", &s.smoothing, "s", 0.005, 1.0, "time constant of the target's filter")
      .number("hand/timeout", &s.timeout, "s", 0.05, 5.0, "a target older than this has let go of the handle");
}

Spring::Spring(const SpringSettings& settings, double dt)
  : settings_(settings), dt_(dt), decay_(std::exp(-dt / settings.smoothing))
{
  phri_core::requireRange("tick of the hand", dt, 1e-5, 0.02, "s");
  phri_core::requireRange("hand/stiffness", settings.stiffness, 10.0, 5000.0, "N/m");
  phri_core::requireRange("hand/damping", settings.damping, 0.0, 2000.0, "Ns/m");
  phri_core::requireRange("hand/force_max", settings.force_max, 1.0, 140.0, "N");
  phri_core::requireRange("hand/smoothing", settings.smoothing, 0.005, 1.0, "s");
  phri_core::requireRange("hand/timeout", settings.timeout, 0.05, 5.0, "s");
}

Eigen::Vector2d Spring::step(const HandleState& handle, const Eigen::Vector2d* target) noexcept
{
  if (target && grip_ == 0.0)
  {
    filtered_ = handle.position;
    filtered_velocity_ = handle.velocity;
  }
  if (target)
    target_ = *target;
  grip_ = std::clamp(grip_ + (target ? dt_ : -dt_) / kFade, 0.0, 1.0);
  if (grip_ == 0.0)
    return Eigen::Vector2d::Zero();

  const double tau = settings_.smoothing;
  const Eigen::Vector2d error = -bounded(target_ - filtered_, reach());
  const Eigen::Vector2d slope = filtered_velocity_ + error / tau;
  filtered_ += (error + slope * dt_) * decay_ - error;
  filtered_velocity_ = (filtered_velocity_ - slope * (dt_ / tau)) * decay_;

  const Eigen::Vector2d force =
      settings_.stiffness * (filtered_ - handle.position) + settings_.damping * (filtered_velocity_ - handle.velocity);
  return phri_core::smoothStep(grip_) * bounded(force, settings_.force_max);
}

double Spring::maxForceRate(double speed, double acceleration) const
{
  const double tau = settings_.smoothing;
  const double target_speed = std::max(reach() / (2.0 * tau), speed);
  // within a tick the target's lead may grow beyond the reach by what the filter moves
  const double target_acceleration = (reach() + target_speed * dt_) / (tau * tau) + 2.0 * target_speed / tau;
  const double steepest_fade = 1.5 / kFade;
  return steepest_fade * settings_.force_max + settings_.stiffness * (target_speed + speed) +
         settings_.damping * (target_acceleration + acceleration);
}

bool SpringTarget::post(Wish::Kind kind, const Eigen::Vector2d& value)
{
  if (!value.allFinite() || value.cwiseAbs().maxCoeff() > kFarthest)
    return false;
  mailbox_.post({ kind, value, clock_() });
  return true;
}

bool SpringTarget::set(const Eigen::Vector2d& position)
{
  return post(Wish::kPosition, position);
}

bool SpringTarget::move(const Eigen::Vector2d& velocity)
{
  return post(Wish::kVelocity, velocity);
}

void SpringTarget::release()
{
  post(Wish::kNothing, Eigen::Vector2d::Zero());
}

SpringTarget::Wish SpringTarget::current(double timeout) noexcept
{
  if (const Wish* newer = mailbox_.take())
    wish_ = *newer;
  if (wish_.kind != Wish::kNothing && (clock_() - wish_.set_ns) * 1e-9 > timeout)
    wish_.kind = Wish::kNothing;
  return wish_;
}

SpringHand::SpringHand(const SpringSettings& settings, double dt, std::shared_ptr<SpringTarget> target)
  : timeout_(settings.timeout), dt_(dt), spring_(settings, dt), target_(std::move(target))
{
}

HandForce SpringHand::act(const HandleState& handle) noexcept
{
  const SpringTarget::Wish wish = target_->current(timeout_);
  HandForce out;
  if (wish.kind == SpringTarget::Wish::kNothing)
  {
    moving_ = false;
    out.force = spring_.step(handle, nullptr);
    return out;
  }
  const bool moving = wish.kind == SpringTarget::Wish::kVelocity;
  if (moving && !moving_)
    goal_ = handle.position;
  moving_ = moving;
  if (moving)
    goal_ = handle.position + bounded(goal_ + wish.value * dt_ - handle.position, spring_.reach());
  else
    goal_ = wish.value;
  out.force = spring_.step(handle, &goal_);
  return out;
}
}  // namespace phri_sim
