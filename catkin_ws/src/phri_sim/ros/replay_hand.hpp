#pragma once
#include "hand_source.hpp"
#include "phri_sim/recorded_hand.hpp"

namespace phri_sim
{
/// Reads what the hand did from a bag of the experiment node (topics `.../tick`, `.../joint_states`,
/// `.../human_wrench`, one message each per tick). Throws std::invalid_argument naming the file, the cause and what was
/// expected. `dt` [s] of the tick.
Recording readRecording(const std::string& path, double dt);

/// A recorded person, who starts at once.
class ReplayHand : public HandSource
{
public:
  /// Reads `settings.bag`; throws like readRecording.
  ReplayHand(const HandSettings& settings, double dt);
  std::unique_ptr<Hand> hand(const TrialSpec& spec) override;
  std::string waitingFor() override { return ""; }
  bool autostart() const override { return true; }
  void show(const Eigen::Vector2d& /*position*/, const ros::Time& /*stamp*/, const std::string& /*state*/) override {}

private:
  const HandSettings settings_;
  const double dt_;
  std::shared_ptr<const Recording> recording_;
};
}  // namespace phri_sim
