#pragma once
/// The safety layer of the tick: input guard, limits on the assistance, energy tank, limits on the motion, state
/// machine. Everything that runs in the tick is noexcept and allocates nothing; NaN never passes. Research software,
/// not a certified safety function. Wrenches are exerted BY the named agent ON the object, in the control frame.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "phri_core/interaction.hpp"
#include "phri_core/parameters.hpp"

namespace phri_core
{
/// What the loop does. INIT: not configured. IDLE: holds still. PASSIVE: plain admittance, u_r = 0. ACTIVE: assistance.
/// FAULT: latched; u_r = 0, the human's wrench ramps to 0, the damping is multiplied.
enum class LoopState : std::uint8_t
{
  Init,
  Idle,
  Passive,
  Active,
  Fault
};
constexpr std::size_t kLoopStates = 5;

enum class LoopEvent : std::uint8_t
{
  Configured,  ///< parameters and models are valid
  Start,       ///< the operator starts the interaction
  Stop,        ///< the operator stops it
  Assist,      ///< a valid policy is at hand
  Degrade,     ///< the policy has expired, or the sensor is saturated: back to PASSIVE, reversible
  Fail,        ///< any fault
  Clear        ///< the operator clears a fault whose cause has gone
};
constexpr std::size_t kLoopEvents = 7;

/// kTransitions[state][event]; an event that means nothing in a state leaves it. FAULT leads to IDLE only.
constexpr std::array<std::array<LoopState, kLoopEvents>, kLoopStates> kTransitions = { {
    // Configured, Start, Stop, Assist, Degrade, Fail, Clear
    { LoopState::Idle, LoopState::Init, LoopState::Init, LoopState::Init, LoopState::Init, LoopState::Fault,
      LoopState::Init },
    { LoopState::Idle, LoopState::Passive, LoopState::Idle, LoopState::Idle, LoopState::Idle, LoopState::Fault,
      LoopState::Idle },
    { LoopState::Passive, LoopState::Passive, LoopState::Idle, LoopState::Active, LoopState::Passive, LoopState::Fault,
      LoopState::Passive },
    { LoopState::Active, LoopState::Active, LoopState::Idle, LoopState::Active, LoopState::Passive, LoopState::Fault,
      LoopState::Active },
    { LoopState::Fault, LoopState::Fault, LoopState::Fault, LoopState::Fault, LoopState::Fault, LoopState::Fault,
      LoopState::Idle },
} };

constexpr LoopState transition(LoopState state, LoopEvent event)
{
  return kTransitions[static_cast<std::size_t>(state)][static_cast<std::size_t>(event)];
}

/// Why the loop is in FAULT; the names stand in every message and in the bag.
enum class FaultCode : std::uint8_t
{
  None,
  WrenchStale,      ///< no good wrench sample for longer than `guard/fault_age`
  WrenchFrame,      ///< a wrench in another frame than the control frame
  PositionInvalid,  ///< the encoder reading is not finite
  LateCycle,        ///< the loop itself came later than `guard/late_cycle`
  NotFinite         ///< the computed command is not finite
};
const char* faultName(FaultCode code);
const char* stateName(LoopState state);

/// Bits of the mask of limits that acted in a tick.
enum Limit : std::uint32_t
{
  kLimitWrench = 1u << 0,        ///< |u_h| clamped
  kLimitForce = 1u << 1,         ///< |u_r| clamped
  kLimitSlew = 1u << 2,          ///< growth of |u_r| slowed
  kLimitPower = 1u << 3,         ///< u_r . v clamped
  kLimitTank = 1u << 4,          ///< the energy tank scaled u_r down
  kLimitRelease = 1u << 5,       ///< the hand has let go: assistance withdrawn
  kLimitWorkspace = 1u << 6,     ///< velocity funnel at the edge of the workspace
  kLimitVelocity = 1u << 7,      ///< |v| clamped
  kLimitAcceleration = 1u << 8,  ///< |a| or its growth clamped while speeding up
  kLimitBias = 1u << 9,          ///< in IDLE: the sensor reads a force while nothing moves; no start until it does not
};
/// Names of the bits above, bit i = name i.
const std::vector<std::string>& limitNames();
/// The bits that take something away from the assistance; a controller under them for more than 5 % of the time is
/// marked.
constexpr std::uint32_t kAssistanceLimits = kLimitForce | kLimitSlew | kLimitPower | kLimitTank | kLimitRelease;

/// The safety profile; defaults are `haptic_2dof`. `parameterTable` holds keys, units and ranges.
struct SafetySettings
{
  /// The last so many coordinates are angles. An angle counts as the motion of a point `rotation_length` [m] away:
  /// every bound below in N, m/s or m/s^2 holds for the norm over all coordinates with angular rates times, torques
  /// over it.
  int rotations = 0;
  double rotation_length = 0.5;        ///< [m]
  double sensor_range = 200.0;         ///< [N] per axis; beyond it a sample is rejected
  double hold = 0.005;                 ///< [s] the last good wrench is held, then ramps to 0
  double fault_age = 0.020;            ///< [s] without a good wrench: FAULT
  double late_cycle = 0.020;           ///< [s] the loop may come late before it FAULTs
  double wrench_max = 140.0;           ///< [N] clamp of |u_h|
  double assistance_max = 60.0;        ///< [N] clamp of |u_r|
  double assistance_slew = 300.0;      ///< [N/s] per axis, only where |u_r| grows
  double assistance_power = 15.0;      ///< [W] clamp of u_r . v
  double tank_max = 1.5;               ///< [J]
  double tank_initial = 0.3;           ///< [J]
  double tank_ramp = 0.2;              ///< [-] fraction of tank_max below which u_r is scaled down
  double bias_force = 3.0;             ///< [N] a sensor that reads more while IDLE ...
  double bias_time = 0.5;              ///< [s] ... for so long is biased, or held: no start
  double release_force = 0.3;          ///< [N] |u_h| below it ...
  double release_time = 0.2;           ///< [s] ... for so long: the hand has let go
  bool autonomous_completion = false;  ///< the robot may go on without the hand
  double fade = 0.2;                   ///< [s] cross-fade between strategies, and to and from passive
  double velocity_max = 1.0;           ///< [m/s]
  double acceleration_max = 5.0;       ///< [m/s^2] only while speeding up
  double jerk_max = 200.0;             ///< [m/s^3] only while speeding up
  double workspace = 0.15;             ///< [m] half width, per axis; angles have none
  double funnel = 20.0;                ///< [1/s] outward speed per distance to the edge
  double fault_damping = 4.0;          ///< [-] factor on the damping in FAULT
};
ParameterTable parameterTable(SafetySettings& settings);

/// Per coordinate what it moves at the reference: 1, or rotation_length for an angle.
VectorDof lengths(const SafetySettings& settings, Eigen::Index dof);

/// C1 ramp: 0 for x <= 0, 1 for x >= 1.
constexpr double smoothStep(double x)
{
  return x <= 0.0 ? 0.0 : (x >= 1.0 ? 1.0 : x * x * (3.0 - 2.0 * x));
}

/// Judges wrench samples by value, range, age, order and frame, and says which wrench the tick may use.
class InputGuard
{
public:
  struct Verdict
  {
    VectorDof wrench;                   ///< [N] to be used; held, ramped or 0 when samples are missing
    double force = 0.0;                 ///< [N] its norm, torques over rotation_length
    double age = 0.0;                   ///< [s] of the last good sample
    bool good = false;                  ///< a good sample not older than `hold`
    bool saturated = false;             ///< at the sensor's end for 3 samples or more
    bool clamped = false;               ///< |u_h| was clamped to `wrench_max`
    FaultCode fault = FaultCode::None;  ///< WrenchStale, WrenchFrame or PositionInvalid
  };
  /// Counts since construction, for diagnostics.
  struct Counters
  {
    std::uint64_t not_finite = 0, out_of_range = 0, out_of_order = 0, bad_stamp = 0, bad_frame = 0;
  };

  InputGuard(const SafetySettings& settings, Eigen::Index dof);
  Verdict check(const Measurement& measurement, std::int64_t now_ns) noexcept;
  const Counters& counters() const { return counters_; }

private:
  bool accept(const Measurement& measurement, std::int64_t now_ns) noexcept;
  SafetySettings settings_;
  VectorDof lengths_;
  VectorDof last_good_;
  std::int64_t last_good_ns_ = 0;
  std::uint64_t last_sequence_ = 0;
  bool seen_ = false, wrong_frame_ = false;
  int saturated_samples_ = 0;
  Counters counters_;
};

/// Says whether a force/torque sensor reads a force while nothing moves: it wants to be tared, or the handle to be let
/// go, before anything starts (fault matrix, row 6).
class BiasCheck
{
public:
  explicit BiasCheck(const SafetySettings& settings) : force_(settings.bias_force), time_(settings.bias_time) {}
  /// A reading of norm `force` [N], `dt` [s] after the one before, while at rest. True while biased.
  bool update(double force, double dt) noexcept
  {
    above_ = force > force_ ? above_ + dt : 0.0;
    return biased();
  }
  void reset() noexcept { above_ = 0.0; }
  bool biased() const noexcept { return above_ >= time_; }

private:
  double force_, time_, above_ = 0.0;
};

/// Force, one-sided slew, power and energy limits on the assistance u_r, in this order. The tank obeys
///   E' = sigma phi v'Dv - gamma u_r . v,  0 <= E <= E_max,
/// with phi = 1, sigma = 0 at E_max, and gamma falling from 1 to 0 over the last `tank_ramp` of it.
class AssistanceLimiter
{
public:
  AssistanceLimiter(const SafetySettings& settings, Eigen::Index dof, double dt);
  /// Applied u_r [N] for the requested one, at velocity `v` [m/s] and damping `d` [Ns/m]; sets bits in `limits`.
  VectorDof apply(const VectorDof& requested, const VectorDof& v, const VectorDof& d, std::uint32_t& limits) noexcept;
  /// [J] in the tank.
  double energy() const { return energy_; }
  void reset() noexcept;

private:
  SafetySettings settings_;
  VectorDof lengths_;
  double dt_, energy_;
  VectorDof slewed_;
};

/// Limits on velocity, acceleration, jerk and workspace. Only speeding up is limited: braking passes untouched, for a
/// symmetric limiter makes contact harder (134 -> 167 N in a published-style wall test).
class MotionLimiter
{
public:
  MotionLimiter(const SafetySettings& settings, Eigen::Index dof, double dt);
  /// Replaces (x, v), reached from (x_before, v_before) in one tick, by a state within the limits; what is not finite
  /// by rest at x_before. Sets bits in `limits`.
  void apply(const VectorDof& x_before, const VectorDof& v_before, VectorDof& x, VectorDof& v,
             std::uint32_t& limits) noexcept;
  void reset() noexcept;

private:
  SafetySettings settings_;
  VectorDof lengths_;
  double dt_, last_acceleration_ = 0.0;
};
}  // namespace phri_core
