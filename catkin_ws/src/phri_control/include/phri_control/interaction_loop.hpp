#pragma once
#include <atomic>
#include <cstdint>

#include "phri_control/feedback_policy.hpp"
#include "phri_core/admittance.hpp"
#include "phri_core/interaction.hpp"
#include "phri_core/mailbox.hpp"
#include "phri_core/safety.hpp"

namespace phri_control
{
/// Settings of the 1 kHz tick.
struct LoopSettings
{
  phri_core::VectorDof mass;     ///< rendered mass M, diagonal [kg]
  phri_core::VectorDof damping;  ///< rendered damping D, diagonal [Ns/m]
  double dt = 0.001;             ///< [s]
  double replan_blend = 0.02;    ///< [s] over which a newer plan of the same controller replaces the older one
  phri_core::SafetySettings safety;
};

/// Everything that one tick saw and did; plain data of fixed size, for the recorder's preallocated storage. Position
/// and velocity are those at the start of the tick, the wrenches act during it.
struct TickRecord
{
  std::int64_t time_ns = 0;
  std::uint64_t sequence = 0;
  phri_core::LoopState state = phri_core::LoopState::Init;
  phri_core::FaultCode fault = phri_core::FaultCode::None;
  std::uint32_t limits = 0;                 ///< bits of phri_core::Limit
  phri_core::VectorDof position;            ///< measured [m]
  phri_core::VectorDof velocity;            ///< of the admittance [m/s]
  phri_core::VectorDof human_wrench;        ///< as used, by the human on the object [N]
  phri_core::VectorDof environment_wrench;  ///< by the environment on the object [N]
  phri_core::VectorDof requested_wrench;    ///< assistance before the limits [N]
  phri_core::VectorDof assistance_wrench;   ///< assistance as applied, by the robot on the object [N]
  double wrench_age = 0.0;                  ///< [s]
  double tank = 0.0;                        ///< [J]
  double passivity = 0.0;                   ///< [J] work on the object less its kinetic energy: never below -1e-6
  double lateness = 0.0;                    ///< [s] of this cycle
  std::int32_t source = -1;                 ///< of the policy in force, -1 without one
};

/// The tick: measurement in, command out, every millisecond. It renders M xdd + D xd = u_h + u_env + u_r (2.16), lets
/// the policy in force decide u_r, and applies the safety layer in this order: input guard, state machine, policy with
/// cross-fade, authority (let go, sensor saturated), force, slew, power, tank, admittance, motion limits.
///
/// `tick` is noexcept, allocates nothing, takes no lock. `adopt` and the requests may be called from one other thread;
/// they act at the next tick. A policy lives to its horizon's end and then fades to passive; a newer one of the same
/// source and generation takes over within `replan_blend`, another one within `safety.fade`; the force has no step in
/// either case. `render` changes the admittance by a ramp that keeps the loop passive.
class InteractionLoop
{
public:
  /// Throws std::invalid_argument naming what is out of range.
  explicit InteractionLoop(const LoopSettings& settings);

  /// `now_ns`: monotonic (or simulated) time of this cycle, counted from the start of the trial. `lateness` [s]: by how
  /// much it missed its deadline, where `now_ns` does not show it (simulated time driven in real time).
  phri_core::Command tick(const phri_core::Measurement& measurement, std::int64_t now_ns,
                          double lateness = 0.0) noexcept;

  void adopt(FeedbackPolicy policy) { policies_.post(std::move(policy)); }
  /// Starts from IDLE, unless the sensor is biased or held (kLimitBias): then it is ignored.
  void start() { requests_ |= kStart; }
  void stop() { requests_ |= kStop; }
  /// Acts once the cause has been gone for 1 s, |v| < 1 mm/s and |u_h| < 3 N; until then it is ignored.
  void clearFault() { requests_ |= kClear; }

  /// Another rendered mass [kg] and damping [Ns/m], from now on, within AdmittanceRamp::kTime or somewhat more. Throws
  /// std::invalid_argument naming what is out of the range of phri_core::Admittance.
  void render(const phri_core::VectorDof& mass, const phri_core::VectorDof& damping);

  /// Places the object at rest: before the first tick, or in IDLE from the thread that ticks.
  void place(const phri_core::VectorDof& position);

  const TickRecord& record() const { return record_; }
  /// What models and controllers see of the last tick.
  phri_core::Observation observation() const;
  const phri_core::InputGuard::Counters& rejected() const { return guard_.counters(); }

private:
  static constexpr unsigned kStart = 1, kStop = 2, kClear = 4;

  void handle(phri_core::LoopEvent event) { state_ = phri_core::transition(state_, event); }
  void fail(phri_core::FaultCode code);
  void takeRequests(const phri_core::InputGuard::Verdict& input, double t);
  phri_core::VectorDof requestedAssistance(const phri_core::VectorState& xi, double t);
  double authority(const phri_core::InputGuard::Verdict& input);

  struct Rendering
  {
    phri_core::VectorDof mass, damping;
  };

  LoopSettings settings_;
  phri_core::Admittance admittance_;
  phri_core::AdmittanceRamp ramp_;
  phri_core::InputGuard guard_;
  phri_core::AssistanceLimiter assistance_limiter_;
  phri_core::MotionLimiter motion_limiter_;
  phri_core::BiasCheck bias_check_;
  phri_core::Mailbox<FeedbackPolicy> policies_;
  phri_core::Mailbox<Rendering> renderings_;
  std::atomic<unsigned> requests_{ 0 };

  phri_core::LoopState state_;
  phri_core::FaultCode fault_ = phri_core::FaultCode::None;
  const FeedbackPolicy* policy_ = nullptr;
  int generation_ = 0;                     // of the policy in force
  phri_core::VectorDof planned_, offset_;  // output of the plan in force; step to the one before, being blended out
  phri_core::VectorDof output_, frozen_;   // after cross-fading; value that the present source started from
  double replan_start_ = 0.0, switch_start_ = 0.0;
  double authority_ = 0.0, released_for_ = 0.0, fault_ramp_ = 0.0, good_since_ = 0.0;
  double energy_in_ = 0.0;
  std::int64_t last_ns_ = -1;
  TickRecord record_;
};
}  // namespace phri_control
