#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "phri_core/random.hpp"
#include "phri_sim/participant.hpp"
#include "phri_sim/route.hpp"

namespace phri_sim
{
/// Values of the last second, one per millisecond.
class DelayLine
{
public:
  void push(const Eigen::Vector2d& value)
  {
    newest_ = (newest_ + 1) % values_.size();
    values_[newest_] = value;
  }
  void fill(const Eigen::Vector2d& value) { values_.fill(value); }
  /// The value `steps` pushes ago; at most 511.
  const Eigen::Vector2d& before(std::size_t steps) const
  {
    return values_[(newest_ + values_.size() - steps) % values_.size()];
  }

private:
  std::array<Eigen::Vector2d, 512> values_{};
  std::size_t newest_ = 0;
};

/// Where the person wants the object to be: along a route, at a pace that obeys curvature, channel width and comfort,
/// and around or behind moving obstacles that are seen late. Five times a second the person weighs some lateral offsets
/// and paces over the next 0.8 s and takes the best; what follows is smooth. Told to follow an exemplary run of `pace`
/// [s] instead (0: not told), the person's place along the route is that of its dot.
class Intention
{
public:
  Intention(std::shared_ptr<const Scene> scene, std::shared_ptr<const Route> route, const Participant& person,
            std::uint64_t trial_seed, double pace = 0.0);
  /// One millisecond; `x` [m] is where the person sees the object.
  void step(double t, const Eigen::Vector2d& x, const std::vector<MovingObstacle>& obstacles);

  Eigen::Vector2d position{ 0, 0 }, velocity{ 0, 0 }, acceleration{ 0, 0 };  ///< [m, m/s, m/s2] desired

private:
  double pace(double s) const;
  void decide(double t, const std::vector<MovingObstacle>& obstacles);

  std::shared_ptr<const Scene> scene_;
  std::shared_ptr<const Route> route_;
  Participant person_;
  phri_core::Random random_;
  std::vector<double> pace_;  // [m/s] along the route
  std::optional<Pace> dot_;
  std::array<double, 3> wander_phase_, wander_amplitude_;
  double s_ = 0.0, s_dot_ = 0.0;
  double offset_ = 0.0, offset_dot_ = 0.0;  // lateral, left positive
  double chosen_offset_ = 0.0, chosen_pace_ = 1.0, pace_factor_ = 1.0;
  int tick_ = 0;
};

/// The person: intention, feed-forward of a learned internal model, reflexes, visual correction, muscle lag, intrinsic
/// impedance, signal-dependent noise, giving in or fighting. One call per millisecond; the returned force [N] is
/// exerted BY the person ON the handle. A model for testing, not evidence about people.
class HumanPartner
{
public:
  /// `mass` [kg] and `damping` [Ns/m]: the rendered object that the person has learned to move; `practice`: trials
  /// before this one; `pace` [s] of the exemplary run to follow, 0: none.
  HumanPartner(std::shared_ptr<const Scene> scene, std::shared_ptr<const Route> route, const Participant& person,
               int practice, double mass, double damping, std::uint64_t trial_seed, double pace = 0.0);

  Eigen::Vector2d step(double t, const Eigen::Vector2d& x, const Eigen::Vector2d& v, const Eigen::Vector2d& robot_force,
                       const std::vector<MovingObstacle>& obstacles);
  const Intention& intention() const { return intention_; }

private:
  Eigen::Vector2d noise(const Eigen::Vector2d& force, double t);

  Participant person_;
  Intention intention_;
  phri_core::Random random_;
  double mass_, damping_, gain_;
  double reflex_stiffness_, reflex_damping_;
  Eigen::Matrix2d intrinsic_;
  DelayLine x_, v_, x_desired_, v_desired_;
  Eigen::Vector2d muscle_first_{ 0, 0 }, muscle_{ 0, 0 }, expected_help_{ 0, 0 }, variation_{ 0, 0 },
      last_force_{ 0, 0 };
  double role_ = 0.0, tremor_rate_, tremor_phase_;
};
}  // namespace phri_sim
