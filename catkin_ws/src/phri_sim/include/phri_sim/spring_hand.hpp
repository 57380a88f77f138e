#pragma once
#include <memory>

#include "phri_core/mailbox.hpp"
#include "phri_core/parameters.hpp"
#include "phri_sim/hand.hpp"
#include "phri_sim/monotonic.hpp"

namespace phri_sim
{
/// The spring between a target (a marker, a joystick, a recorded path) and the handle.
struct SpringSettings
{
  double stiffness = 1500.0;  ///< K [N/m]
  double damping = 200.0;     ///< D [Ns/m] of the handle's velocity relative to the filtered target's
  double force_max = 50.0;    ///< F [N]
  double smoothing = 0.06;    ///< tau [s] of the target's filter, critically damped, second order
  double timeout = 0.5;       ///< [s] a target older than this has let go
};
/// Keys `hand/stiffness`, `hand/damping`, `hand/force_max`, `hand/smoothing`, `hand/timeout`.
void addParameters(phri_core::ParameterTable& table, SpringSettings& settings);

/// A saturated spring-damper from a filtered target y to the handle x:
///   f = g sat_F( K (y - x) + D (y' - x') ),  |sat_F| <= F,
///   y'' = (r - y)/tau^2 - 2 y'/tau,  r = target, brought to within L = F/K of y.
/// The grip g goes from 0 to 1 and back in `kFade`. When the hand takes hold, the filter starts where the handle is,
/// and as fast as it is. Integrated exactly for a target that is constant over a tick.
///
/// Passive towards a fixed target (y = r, g = 1): sat_F is a projection on a convex set, hence monotone, so that
/// (sat_F(K e) - sat_F(K e - D v)) . v >= 0 and the kinetic energy plus U(e) = K|e|^2/2 (|e| <= L), F|e| - F L/2
/// beyond, never grows.
///
/// No steps: whatever the target does, |y''| <= L/tau^2 + 2|y'|/tau and |y'| <= max(L/(2 tau), speed when it took
/// hold); so the force changes by at most maxForceRate() per second.
class Spring
{
public:
  static constexpr double kFade = 0.1;  ///< [s]

  /// Throws std::invalid_argument naming what is out of range.
  Spring(const SpringSettings& settings, double dt);

  /// Force [N] on the handle during the next tick. `target`: where the hand wants it [m]; null: the hand lets go.
  Eigen::Vector2d step(const HandleState& handle, const Eigen::Vector2d* target) noexcept;
  /// [m] the target leads the handle by when the force is at its maximum.
  double reach() const { return settings_.force_max / settings_.stiffness; }
  /// [N/s] bound on the force's rate, for a handle not faster than `speed` [m/s] whose acceleration stays below
  /// `acceleration` [m/s^2].
  double maxForceRate(double speed, double acceleration) const;

private:
  SpringSettings settings_;
  double dt_, decay_, grip_ = 0.0;
  Eigen::Vector2d target_{ 0, 0 }, filtered_{ 0, 0 }, filtered_velocity_{ 0, 0 };
};

/// Where a person wants the handle: written by a thread of ROS (one at a time), read by the tick; neither waits.
/// Positions in the control frame.
class SpringTarget
{
public:
  /// What the hand wants since `set_ns`.
  struct Wish
  {
    enum Kind : std::uint8_t
    {
      kNothing,   ///< let go
      kPosition,  ///< the target is at `value` [m]
      kVelocity   ///< the target moves on with `value` [m/s], from where the handle is when the hand takes hold
    };
    Kind kind = kNothing;
    Eigen::Vector2d value{ 0, 0 };
    std::int64_t set_ns = 0;
  };
  static constexpr double kFarthest = 100.0;  ///< [m], [m/s] what is farther or faster is refused

  explicit SpringTarget(MonotonicClock clock = &monotonicNs) : clock_(clock) {}

  /// False, and nothing changes, when the position is not finite or beyond kFarthest. Repeat it to keep it fresh.
  bool set(const Eigen::Vector2d& position);
  /// The same for a velocity: a stick. The target leads the handle by the spring's reach at most.
  bool move(const Eigen::Vector2d& velocity);
  void release();

  /// For the tick: the newest wish, or kNothing when it is older than `timeout` [s].
  Wish current(double timeout) noexcept;

private:
  bool post(Wish::Kind kind, const Eigen::Vector2d& value);
  MonotonicClock clock_;
  phri_core::Mailbox<Wish> mailbox_;
  Wish wish_;  // the tick's copy
};

/// The hand of a person who drags a marker or pushes a stick.
class SpringHand : public Hand
{
public:
  SpringHand(const SpringSettings& settings, double dt, std::shared_ptr<SpringTarget> target);
  HandForce act(const HandleState& handle) noexcept override;

private:
  double timeout_, dt_;
  Spring spring_;
  std::shared_ptr<SpringTarget> target_;
  bool moving_ = false;  // a wish for a velocity is in force
  Eigen::Vector2d goal_{ 0, 0 };
};
}  // namespace phri_sim
