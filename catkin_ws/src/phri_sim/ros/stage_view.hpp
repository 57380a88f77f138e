#pragma once
#include <nav_msgs/Path.h>
#include <ros/ros.h>
#include <visualization_msgs/MarkerArray.h>

#include <memory>
#include <string>

#include "stage_sample.hpp"
#include "trial_messages.hpp"

namespace phri_sim
{
class Recorder;

/// A tick as it is shown and recorded.
struct Moment
{
  const phri_control::TickRecord& record;
  const StageSample& sample;
  ros::Time stamp;
};

/// What is to be seen, and recorded, of one kind of stage besides what all trials have (ticks, wrenches, the object's
/// own coordinates, state, predictions: LiveView and TrialOutput do these). Lives as long as the node; one thread at a
/// time.
class StageView
{
public:
  virtual ~StageView() = default;
  /// A trial begins: forgets the last one. `stage` is null while a hand is waited for.
  virtual void begin(const TrialSpec& spec, const Stage* stage) = 0;
  /// Every tick: for trails.
  virtual void follow(const Moment& moment) = 0;
  /// At about 100 Hz: motion as topics and transforms.
  virtual void publish(const Moment& moment) = 0;
  /// At about 30 Hz: `prediction` may be null.
  virtual visualization_msgs::MarkerArray markers(const Moment& moment, const phri_core::Prediction* prediction,
                                                  const std::string& controller) const = 0;
  virtual nav_msgs::Path predictedPath(const phri_core::Prediction& prediction, const ros::Time& stamp) const = 0;

  /// What a bag says once, in its beginning. Throws RecordingError, as the next.
  virtual void recordFirst(Recorder& recorder, const ros::Time& start) const = 0;
  /// Every tick.
  virtual void record(Recorder& recorder, const Moment& moment) = 0;
};

/// Whether there is a view of the experiment's task.
bool hasView(const Experiment& experiment);
/// The view of the experiment's stage, its topics in the namespace of `node`.
std::unique_ptr<StageView> makeStageView(ros::NodeHandle& node, std::shared_ptr<const Experiment> experiment,
                                         const ros::Time& now);
}  // namespace phri_sim
