#pragma once
#include <ros/ros.h>

#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "stage_view.hpp"

namespace phri_sim
{
/// The names of the topics of a trial, resolved once. `joints`: of the object's own coordinates, see LoopFrame.
struct TopicNames
{
  TopicNames(const ros::NodeHandle& node, const ros::NodeHandle& private_node, const LoopFrame& frame);
  std::string tick, joints, human, environment, assistance, requested, state, prediction, observation, metadata;
};

/// What people and tools see of the running trial: throttled by the clock on the wall (motion, wrenches, state and
/// /clock at 100 Hz, pictures at 30 Hz), so that a trial that runs faster than real time floods nobody; the bag has
/// everything. Static things are latched. What belongs to one kind of stage only is the StageView's. One thread at a
/// time.
class LiveView
{
public:
  LiveView(ros::NodeHandle& node, ros::NodeHandle& private_node, std::shared_ptr<const Experiment> experiment,
           const ros::Time& now);

  /// A trial begins: forgets the pictures of the last one. `stage` is null while a hand is waited for.
  void begin(const TrialSpec& spec, const Stage* stage);
  void tick(const Moment& moment, const TickMessages& messages, const TrialMonitor& monitor);
  void predicted(const phri_core::Prediction& prediction) { prediction_ = prediction; }
  /// /clock, now; from any thread.
  void clock(const ros::Time& stamp) const;
  StageView& stage() { return *stage_; }
  const LoopFrame& frame() const { return frame_; }

private:
  using WallClock = std::chrono::steady_clock;
  struct Throttle
  {
    std::chrono::microseconds period;
    WallClock::time_point next{};
    bool due(WallClock::time_point now);
  };
  void draw(const Moment& moment, const std::string& controller);

  LoopFrame frame_;
  ros::Publisher clock_, tick_, joints_, human_, environment_, assistance_, requested_, state_, path_, markers_;
  Throttle fast_{ std::chrono::microseconds(10000) }, slow_{ std::chrono::microseconds(33333) };
  std::optional<phri_core::Prediction> prediction_;
  std::unique_ptr<StageView> stage_;
};
}  // namespace phri_sim
