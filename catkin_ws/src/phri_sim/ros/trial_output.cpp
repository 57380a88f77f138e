#include "trial_output.hpp"

#include <rosgraph_msgs/Clock.h>
#include <std_msgs/String.h>

namespace phri_sim
{
namespace
{
constexpr std::int64_t kMonitorPeriod = 10000000;  // [ns] of session time between states, and between clocks
}  // namespace

TrialOutput::TrialOutput(LiveView& live, const TopicNames& names, std::unique_ptr<Recorder> recorder,
                         const TrialSpec& spec, const Stage& stage, const ros::Time& start)
  : live_(live), names_(names), recorder_(std::move(recorder)), start_(start), messages_(live.frame())
{
  monitor_.controller = spec.controller;
  live_.begin(spec, &stage);
  if (recorder_)
    live_.stage().recordFirst(*recorder_, start);
}

ros::Time TrialOutput::stamp(std::int64_t time_ns) const
{
  ros::Time time;
  time.fromNSec(start_.toNSec() + time_ns);
  return time;
}

void TrialOutput::tick(const phri_control::TickRecord& tick, const StageSample& sample, unsigned failed_plans)
{
  const ros::Time now = stamp(tick.time_ns);
  const Moment moment{ tick, sample, now };
  messages_.fill(tick, now);
  monitor_.limits |= tick.limits;
  monitor_.failed_plans = failed_plans;
  live_.tick(moment, messages_, monitor_);
  if (recorder_)
  {
    record(names_.tick, now, messages_.tick);
    record(names_.joints, now, messages_.joints);
    record(names_.human, now, messages_.human);
    record(names_.environment, now, messages_.environment);
    record(names_.assistance, now, messages_.assistance);
    record(names_.requested, now, messages_.requested);
    live_.stage().record(*recorder_, moment);
  }
  if (tick.time_ns % kMonitorPeriod != 0)
    return;
  if (recorder_)
  {
    rosgraph_msgs::Clock clock;
    clock.clock = now;
    record("/clock", now, clock);
    record(names_.state, now, controllerState(tick, monitor_, now, live_.frame()));
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
