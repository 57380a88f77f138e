#pragma once
#include <phri_msgs/Observation.h>
#include <phri_msgs/Prediction.h>

#include <memory>

#include "live_view.hpp"
#include "recorder.hpp"

namespace phri_sim
{
/// Where a trial's ticks go: into the bag, all of them, and to those who watch, some of them. On the side that may
/// block. Every member throws RecordingError when the bag cannot be written.
class TrialOutput
{
public:
  /// `recorder` may be null. Trial time t has the session time `start` + t.
  TrialOutput(LiveView& live, const TopicNames& names, std::unique_ptr<Recorder> recorder, const TrialSpec& spec,
              const Stage& stage, const ros::Time& start);

  void tick(const phri_control::TickRecord& record, const StageSample& sample, unsigned failed_plans);
  /// The controller in force, for those who watch.
  void controllerIs(const std::string& name) { monitor_.controller = name; }
  void observed(const phri_msgs::Observation& message);
  /// A prediction that was planned on; `message` is how it came.
  void predicted(const phri_core::Prediction& prediction, const phri_msgs::Prediction& message, const ros::Time& now);
  void metadata(const std::string& text, const ros::Time& now);
  /// Completes the bag; its path, or nothing without a recorder.
  std::string finish();

  ros::Time stamp(std::int64_t time_ns) const;

private:
  template <typename Message>
  void record(const std::string& topic, const ros::Time& now, const Message& message)
  {
    if (recorder_)
      recorder_->write(topic, now, message);
  }
  template <typename Message>
  void recordLatched(const std::string& topic, const ros::Time& now, const Message& message)
  {
    if (recorder_)
      recorder_->writeLatched(topic, now, message);
  }

  LiveView& live_;
  const TopicNames& names_;
  std::unique_ptr<Recorder> recorder_;
  ros::Time start_;
  TickMessages messages_;
  TrialMonitor monitor_;
};
}  // namespace phri_sim
