#include "trial_output.hpp"

#include <rosgraph_msgs/Clock.h>
#include <std_msgs/String.h>
#include <tf2_msgs/TFMessage.h>

namespace phri_sim
{
namespace
{
constexpr std::int64_t kMonitorPeriod = 10000000;    // [ns] of session time between states, and between clocks
constexpr std::int64_t kTransformPeriod = 20000000;  // [ns]

tf2_msgs::TFMessage one(const geometry_msgs::TransformStamped& transform)
{
  tf2_msgs::TFMessage message;
  message.transforms.push_back(transform);
  return message;
}
}  // namespace

TrialOutput::TrialOutput(LiveView& live, const TopicNames& names, std::unique_ptr<Recorder> recorder,
                         const TrialSpec& spec, const Scene& scene, const std::vector<MovingObstacle>& obstacles,
                         const ros::Time& start)
  : live_(live), names_(names), recorder_(std::move(recorder)), start_(start)
{
  monitor_.controller = spec.controller;
  live_.begin(spec, obstacles);
  recordLatched("/tf_static", start, one(mazeTransform(start)));
  if (recorder_)
    recordLatched(names.metadata.substr(0, names.metadata.rfind('/') + 1) + "map", start, occupancyGrid(scene, start));
}

ros::Time TrialOutput::stamp(std::int64_t time_ns) const
{
  ros::Time time;
  time.fromNSec(start_.toNSec() + time_ns);
  return time;
}

void TrialOutput::tick(const phri_control::TickRecord& tick, unsigned failed_plans)
{
  const ros::Time now = stamp(tick.time_ns);
  messages_.fill(tick, now);
  monitor_.limits |= tick.limits;
  monitor_.failed_plans = failed_plans;
  live_.tick(tick, messages_, monitor_, now);
  if (recorder_)
  {
    record(names_.tick, now, messages_.tick);
    record(names_.joints, now, messages_.joints);
    record(names_.human, now, messages_.human);
    record(names_.environment, now, messages_.environment);
    record(names_.assistance, now, messages_.assistance);
    record(names_.requested, now, messages_.requested);
    if (tick.time_ns % kTransformPeriod == 0)
      record("/tf", now, one(objectTransform(tick, now)));
  }
  if (tick.time_ns % kMonitorPeriod != 0)
    return;
  if (recorder_)
  {
    rosgraph_msgs::Clock clock;
    clock.clock = now;
    record("/clock", now, clock);
    record(names_.state, now, controllerState(tick, monitor_, now));
  }
  monitor_.limits = 0;
}

void TrialOutput::observed(const phri_msgs::Observation& message)
{
  record(names_.observation, message.header.stamp, message);
}

void TrialOutput::predicted(const phri_core::Prediction& prediction, const phri_msgs::Prediction& message,
                            const ros::Time& now)
{
  monitor_.prediction_t0 = prediction.t0;
  live_.predicted(prediction);
  record(names_.prediction, now, message);
}

void TrialOutput::metadata(const std::string& text, const ros::Time& now)
{
  std_msgs::String message;
  message.data = text;
  recordLatched(names_.metadata, now, message);
}

std::string TrialOutput::finish()
{
  return recorder_ ? recorder_->finish() : "";
}
}  // namespace phri_sim
