#pragma once
#include <memory>
#include <vector>

#include "phri_sim/spring_hand.hpp"

namespace phri_sim
{
/// What a hand did, tick by tick from the start of the trial, in the control frame.
struct Recording
{
  std::vector<Eigen::Vector2d> positions;  ///< [m] of the handle at the start of the tick
  std::vector<Eigen::Vector2d> forces;     ///< [N] BY the hand ON the handle during the tick, as the loop used it
};

/// Throws std::invalid_argument unless there is a tick, as many forces as positions, and all are finite; the message
/// names the first one that is not.
void check(const Recording& recording);

/// A recorded hand. At the recording's end it lets go.
///
/// kForce: the measured force, as readings of a sensor. Open loop: it does not answer to what the handle does. Under
/// the same experiment, controller, seed and predictions it gives the same trial to the last bit, unless the recorded
/// trial was in FAULT or had readings refused or clamped (the recording holds what the loop made of those).
///
/// kMotion: a spring towards where the handle was, for another controller or another object. It follows 2 tau
/// (SpringSettings::smoothing) late, and holds the last position for kLinger before it lets go.
class RecordedHand : public Hand
{
public:
  enum class Mode
  {
    kForce,
    kMotion
  };
  static constexpr double kLinger = 1.0;  ///< [s]

  /// Throws std::invalid_argument like `check` and Spring.
  RecordedHand(std::shared_ptr<const Recording> recording, Mode mode, const SpringSettings& spring, double dt);
  HandForce act(const HandleState& handle) noexcept override;

private:
  std::shared_ptr<const Recording> recording_;
  Mode mode_;
  Spring spring_;
  std::size_t tick_ = 0, linger_ticks_;
};
}  // namespace phri_sim
