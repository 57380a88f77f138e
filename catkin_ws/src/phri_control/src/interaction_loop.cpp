#include "phri_control/interaction_loop.hpp"

#include <algorithm>

#include "phri_core/check.hpp"

namespace phri_control
{
using phri_core::FaultCode;
using phri_core::LoopEvent;
using phri_core::LoopState;
using phri_core::VectorDof;
using phri_core::VectorState;

namespace
{
constexpr double kClearWait = 1.0;     // [s] the cause of a fault must have been gone
constexpr double kClearSpeed = 0.001;  // [m/s]
constexpr double kClearForce = 3.0;    // [N]

VectorState stack(const VectorDof& x, const VectorDof& v)
{
  VectorState xi(x.size() + v.size());
  xi << x, v;
  return xi;
}
}  // namespace

InteractionLoop::InteractionLoop(const LoopSettings& settings)
  : settings_(settings),
    admittance_(settings.mass, settings.damping, settings.dt),
    ramp_(settings.mass, settings.damping),
    guard_(settings.safety, settings.mass.size()),
    assistance_limiter_(settings.safety, settings.mass.size(), settings.dt),
    motion_limiter_(settings.safety, settings.mass.size(), settings.dt),
    bias_check_(settings.safety),
    state_(phri_core::transition(LoopState::Init, LoopEvent::Configured))
{
  phri_core::requireRange("number of degrees of freedom", settings.mass.size(), 1, phri_core::kMaxDof, "");
  phri_core::requireRange("replan_blend", settings.replan_blend, 0.0, 1.0, "s");
  const VectorDof zero = VectorDof::Zero(settings.mass.size());
  output_ = planned_ = offset_ = frozen_ = zero;
  record_.position = record_.velocity = record_.human_wrench = record_.environment_wrench = zero;
  record_.requested_wrench = record_.assistance_wrench = zero;
}

void InteractionLoop::place(const VectorDof& position)
{
  phri_core::requireShape("start position", position, settings_.mass.size(), 1);
  phri_core::requireFinite("start position", position);
  admittance_.reset(position, VectorDof::Zero(position.size()));
}

void InteractionLoop::render(const VectorDof& mass, const VectorDof& damping)
{
  phri_core::requireShape("rendered mass", mass, settings_.mass.size(), 1);
  const phri_core::Admittance checked(mass, damping, settings_.dt);  // throws
  renderings_.post({ mass, damping });
}

phri_core::Observation InteractionLoop::observation() const
{
  return { record_.time_ns * 1e-9, stack(record_.position, record_.velocity), record_.human_wrench,
           record_.environment_wrench, Eigen::VectorXd() };
}

void InteractionLoop::fail(FaultCode code)
{
  if (state_ != LoopState::Fault)
  {
    fault_ = code;
    fault_ramp_ = 1.0;
  }
  handle(LoopEvent::Fail);
}

void InteractionLoop::takeRequests(const phri_core::InputGuard::Verdict& input, double t)
{
  if (input.fault != FaultCode::None || !input.good)
    good_since_ = t;
  if (requests_.load(std::memory_order_relaxed) == 0)
    return;
  const unsigned requests = requests_.exchange(0);
  if (requests & kStop)
    handle(LoopEvent::Stop);
  const bool cleared =
      t - good_since_ >= kClearWait && admittance_.velocity().norm() < kClearSpeed && input.force < kClearForce;
  if ((requests & kClear) && state_ == LoopState::Fault && cleared)
  {
    handle(LoopEvent::Clear);
    fault_ = FaultCode::None;
  }
  if ((requests & kStart) && !(state_ == LoopState::Idle && bias_check_.biased()))
    handle(LoopEvent::Start);
}

VectorDof InteractionLoop::requestedAssistance(const VectorState& xi, double t)
{
  VectorDof u = VectorDof::Zero(output_.size());
  if (const FeedbackPolicy* newer = policies_.take())
  {
    const bool switched = !policy_ || newer->source() != record_.source || newer->generation() != generation_;
    policy_ = newer;
    generation_ = newer->generation();
    policy_->act(t, xi, u);
    if (switched)
    {
      frozen_ = output_;
      switch_start_ = t;
      offset_.setZero();
    }
    else
      offset_ = planned_ - u;
    replan_start_ = t;
  }
  if (policy_ && policy_->expired(t))
    policy_ = nullptr;
  if (!policy_)
    return output_ = planned_ = VectorDof::Zero(output_.size());
  policy_->act(t, xi, u);
  // two layers, so that a plan that arrives during a switch does not cut the switch short
  if (t - replan_start_ < settings_.replan_blend)
    u += offset_ * (1.0 - phri_core::smoothStep((t - replan_start_) / settings_.replan_blend));
  planned_ = u;
  if (t - switch_start_ < settings_.safety.fade)
    u += (frozen_ - u) * (1.0 - phri_core::smoothStep((t - switch_start_) / settings_.safety.fade));
  return output_ = u;
}

double InteractionLoop::authority(const phri_core::InputGuard::Verdict& input)
{
  const phri_core::SafetySettings& safety = settings_.safety;
  released_for_ = input.force < safety.release_force ? released_for_ + settings_.dt : 0.0;
  const bool released = !safety.autonomous_completion && released_for_ >= safety.release_time;
  if (released && policy_)
    record_.limits |= phri_core::kLimitRelease;
  const bool wanted = state_ == LoopState::Active && !released;
  const double step = settings_.dt / safety.fade;
  authority_ = std::clamp(authority_ + (wanted ? step : -step), 0.0, 1.0);
  if (state_ == LoopState::Fault || state_ == LoopState::Idle)
    authority_ = 0.0;
  return phri_core::smoothStep(authority_);
}

phri_core::Command InteractionLoop::tick(const phri_core::Measurement& measurement, std::int64_t now_ns,
                                         double lateness) noexcept
{
  const double t = now_ns * 1e-9;
  record_.limits = 0;
  const double since_last = last_ns_ < 0 ? 0.0 : (now_ns - last_ns_) * 1e-9 - settings_.dt;
  record_.lateness = std::max({ 0.0, lateness, since_last });
  last_ns_ = now_ns;

  const auto input = guard_.check(measurement, now_ns);
  if (input.clamped)
    record_.limits |= phri_core::kLimitWrench;
  if (const Rendering* newer = renderings_.take())
    ramp_.toward(newer->mass, newer->damping);
  if (ramp_.step(settings_.dt))
    admittance_.set(ramp_.mass(), ramp_.damping());
  if (state_ == LoopState::Idle && bias_check_.update(input.force, settings_.dt))
    record_.limits |= phri_core::kLimitBias;
  takeRequests(input, t);
  if (state_ != LoopState::Idle)
  {
    bias_check_.reset();
    if (record_.lateness > settings_.safety.late_cycle)
      fail(FaultCode::LateCycle);
    if (input.fault != FaultCode::None)
      fail(input.fault);
  }
  const bool finite_position = measurement.position.size() == output_.size() && measurement.position.allFinite();
  record_.position = finite_position ? measurement.position : admittance_.position();

  const VectorState xi = stack(record_.position, admittance_.velocity());
  record_.requested_wrench = requestedAssistance(xi, t);
  handle(policy_ && !input.saturated ? LoopEvent::Assist : LoopEvent::Degrade);
  const double weight = authority(input);
  record_.requested_wrench *= weight;
  if (weight == 0.0)
    record_.requested_wrench.setZero();
  record_.assistance_wrench = assistance_limiter_.apply(record_.requested_wrench, admittance_.velocity(),
                                                        admittance_.damping(), record_.limits);

  fault_ramp_ = std::max(0.0, fault_ramp_ - settings_.dt / settings_.safety.fade);
  record_.human_wrench = input.wrench;
  record_.environment_wrench = measurement.environment_wrench;
  if (record_.environment_wrench.size() != output_.size() || !record_.environment_wrench.allFinite())
    record_.environment_wrench = VectorDof::Zero(output_.size());
  VectorDof u = record_.environment_wrench + record_.assistance_wrench;
  u += state_ == LoopState::Fault ? VectorDof(fault_ramp_ * input.wrench) : input.wrench;

  const VectorDof x_before = admittance_.position(), v_before = admittance_.velocity();
  if (state_ == LoopState::Idle || state_ == LoopState::Init)
    admittance_.reset(x_before, VectorDof::Zero(x_before.size()));
  else
  {
    admittance_.scaleDamping(state_ == LoopState::Fault ? settings_.safety.fault_damping : 1.0);
    admittance_.step(u);
    VectorDof x = admittance_.position(), v = admittance_.velocity();
    if (!x.allFinite() || !v.allFinite())
    {
      fail(FaultCode::NotFinite);
      x = x_before;
      v.setZero();
    }
    motion_limiter_.apply(x_before, v_before, x, v, record_.limits);
    admittance_.reset(x, v);
    energy_in_ += u.dot(x - x_before);
  }
  const double kinetic = 0.5 * (admittance_.mass().array() * admittance_.velocity().array().square()).sum();
  record_.passivity = energy_in_ - kinetic;
  record_.time_ns = now_ns;
  record_.sequence = measurement.sequence;
  record_.state = state_;
  record_.fault = fault_;
  record_.velocity = v_before;
  record_.wrench_age = input.age;
  record_.tank = assistance_limiter_.energy();
  record_.source = policy_ ? policy_->source() : -1;
  return { admittance_.position(), admittance_.velocity() };
}
}  // namespace phri_control
