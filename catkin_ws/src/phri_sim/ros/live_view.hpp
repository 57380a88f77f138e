#pragma once
#include <ros/ros.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>

#include <chrono>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "markers.hpp"
#include "trial_messages.hpp"

namespace phri_sim
{
/// The names of the topics of a trial, resolved once.
struct TopicNames
{
  explicit TopicNames(const ros::NodeHandle& node, const ros::NodeHandle& private_node);
  std::string tick, joints, human, environment, assistance, requested, state, prediction, observation, metadata;
};

/// What people and tools see of the running trial: throttled by the clock on the wall (motion, wrenches, state and
/// /clock at 100 Hz, pictures at 30 Hz), so that a trial that runs faster than real time floods nobody; the bag has
/// everything. Static things are latched. One thread at a time.
class LiveView
{
public:
  LiveView(ros::NodeHandle& node, ros::NodeHandle& private_node, std::shared_ptr<const Experiment> experiment,
           const ros::Time& now);

  /// A trial begins: forgets the pictures of the last one.
  void begin(const TrialSpec& spec, const std::vector<MovingObstacle>& obstacles);
  void tick(const phri_control::TickRecord& record, const TickMessages& messages, const TrialMonitor& monitor,
            const ros::Time& stamp);
  void predicted(const phri_core::Prediction& prediction) { prediction_ = prediction; }
  /// /clock, now; from any thread.
  void clock(const ros::Time& stamp) const;

private:
  using WallClock = std::chrono::steady_clock;
  struct Throttle
  {
    std::chrono::microseconds period;
    WallClock::time_point next{};
    bool due(WallClock::time_point now);
  };
  void draw(const phri_control::TickRecord& record, const std::string& controller, const ros::Time& stamp);

  std::shared_ptr<const Experiment> experiment_;
  ros::Publisher clock_, tick_, joints_, human_, environment_, assistance_, requested_, state_, path_, markers_, map_;
  tf2_ros::TransformBroadcaster transforms_;
  tf2_ros::StaticTransformBroadcaster static_transforms_;
  Throttle fast_{ std::chrono::microseconds(10000) }, slow_{ std::chrono::microseconds(33333) };

  std::optional<Route> route_;  // with a pace
  std::optional<Pace> pace_;
  std::vector<MovingObstacle> obstacles_;
  std::optional<phri_core::Prediction> prediction_;
  std::deque<Eigen::Vector2d> trail_;
  std::string participant_, trial_;  // in words
  ros::Time last_transform_;
};
}  // namespace phri_sim
