// The real-time half of TrialHost: tick, plan and record in three threads.
#include <atomic>
#include <deque>

#include "phri_msgs/conversions.hpp"
#include "trial_host.hpp"

namespace phri_sim
{
namespace
{
constexpr auto kDrainPeriod = std::chrono::milliseconds(2);
constexpr auto kPlannerPeriod = std::chrono::milliseconds(1);
constexpr unsigned kLookRounds = 100;

phri_core::Observation observationOf(const phri_control::TickRecord& record)
{
  phri_core::VectorState xi(record.position.size() + record.velocity.size());
  xi << record.position, record.velocity;
  return { record.time_ns * 1e-9, xi, record.human_wrench, record.environment_wrench, Eigen::VectorXd() };
}
}  // namespace

void TrialHost::realtime(Run& run)
{
  const ros::Time first = run.output.stamp(0);
  std::mutex handover;  // between planner and drain, neither of them real-time
  std::deque<std::pair<phri_core::Prediction, phri_msgs::PredictionConstPtr>> planned;
  std::string planner_error;
  std::atomic<std::int64_t> answered_ns{ 0 };

  RealtimeLoop loop(run.trial);
  const auto plan = [&] {
    std::optional<phri_control::TickRecord> latest;
    ros::Time used;
    while (loop.running() && !interrupted())
    {
      std::this_thread::sleep_for(kPlannerPeriod);
      if (const phri_control::TickRecord* due = loop.newestDue())
        latest = *due;
      const phri_msgs::PredictionConstPtr message = inbox_.newest();
      if (!run.use_model || !latest || !message || message->header.stamp < first || message->header.stamp <= used)
        continue;
      used = message->header.stamp;
      answered_ns = (used - first).toNSec();  // a model that cannot tell answers, too
      const std::optional<phri_core::Prediction> prediction = phri_msgs::fromMessage(*message);
      if (!prediction)
        continue;
      run.trial.plan(observationOf(*latest), prediction);
      const std::lock_guard<std::mutex> lock(handover);
      planned.emplace_back(*prediction, message);
    }
  };
  std::thread planner([&] {
    try
    {
      plan();
    }
    catch (const std::exception& error)
    {
      const std::lock_guard<std::mutex> lock(handover);
      planner_error = error.what();
    }
  });

  const std::int64_t period_ns = std::llround(run.trial.experiment().model.dt * 1e9);
  phri_control::TickRecord record;
  StageSample sample;
  const auto drain = [&] {
    while (loop.pop(record, &sample))
    {
      tick(run, record, sample);
      if (record.time_ns % period_ns == 0)
        observe(run, observationOf(record), record.time_ns);
      if (run.use_model && (record.time_ns - answered_ns) * 1e-9 > kModelWait)
        throw PeerLost("no new " + inbox_.topic() + " for " + std::to_string(int(kModelWait)) + " s at t = " +
                       std::to_string(record.time_ns * 1e-9) + " s: is " + setup_.settings.model_node + " running?");
    }
    const std::lock_guard<std::mutex> lock(handover);
    for (const auto& [prediction, message] : planned)
      run.output.predicted(prediction, *message, run.output.stamp(record.time_ns));
    planned.clear();
    if (!planner_error.empty())
      throw std::runtime_error("planner: " + planner_error);
  };
  const auto look = [&] {
    const std::lock_guard<std::mutex> lock(mutex_);
    status_.lateness = loop.lateness().text();
    status_.refused = loop.refused();
  };
  std::exception_ptr error;
  try
  {
    for (unsigned round = 0; loop.running() && !interrupted(); ++round)
    {
      std::this_thread::sleep_for(kDrainPeriod);
      drain();
      if (round % kLookRounds == 0)
        look();
    }
  }
  catch (...)
  {
    error = std::current_exception();
    abort_ = true;  // lets the planner go
  }
  loop.stop();
  planner.join();
  look();
  if (error)
    std::rethrow_exception(error);
  drain();
}
}  // namespace phri_sim
