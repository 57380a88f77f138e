#include "trial_host.hpp"

#include <phri_msgs/Trial.h>

#include <algorithm>

#include "operator_text.hpp"
#include "phri_core/check.hpp"
#include "phri_msgs/conversions.hpp"

namespace phri_sim
{
namespace
{
using Response = phri_msgs::RunTrialResponse;
using SteadyClock = std::chrono::steady_clock;

constexpr double kConnectWait = 10.0;               // [s] on the wall for a model node to connect before a trial
constexpr std::int64_t kSessionStart = 1000000000;  // [ns]; 0 means "no time" in ROS
constexpr std::int64_t kPause = 1000000000;         // [ns] of session time between trials
constexpr int kObservationQueue = 10000;            // a whole trial: without a model nothing waits for who listens

double secondsSince(SteadyClock::time_point start)
{
  return std::chrono::duration<double>(SteadyClock::now() - start).count();
}
}  // namespace

TrialHost::TrialHost(ros::NodeHandle& node, ros::NodeHandle& private_node, const NodeSetup& setup)
  : setup_(setup),
    names_(node, private_node, loopFrame(*setup.experiment)),
    live_(node, private_node, setup.experiment, ros::Time().fromNSec(kSessionStart)),
    inbox_(node, names_.prediction),
    observations_(node.advertise<phri_msgs::Observation>("observation", kObservationQueue)),
    trials_(node.advertise<phri_msgs::Trial>("trial", 10, true)),
    session_ns_(kSessionStart),
    hands_(makeHandSource(setup.settings.human, setup.settings.hand, setup.experiment->loop, node, private_node,
                          actions()))
{
}

ros::Time TrialHost::sessionTime() const
{
  return ros::Time().fromNSec(session_ns_);
}

phri_msgs::RunTrialResponse TrialHost::run(const phri_msgs::RunTrialRequest& request)
{
  Response response;
  response.reason = Response::BAD_REQUEST;
  const std::unique_lock<std::mutex> busy(busy_, std::try_to_lock);
  if (!busy)
  {
    response.message = "a trial is running; one at a time";
    return response;
  }
  abort_ = false;
  TrialSpec spec;
  try
  {
    check(request);
    spec = trialSpec(request.participant, request.controller, request.trial, request.trials, request.practice,
                     request.study_seed);
    response.reason = Response::INTERNAL;
    conduct(request, spec, response);
    response.reason = Response::OK;
    response.success = true;
  }
  catch (const PeerLost& error)
  {
    response.reason = Response::PEER_LOST;
    response.message = error.what();
  }
  catch (const RecordingError& error)
  {
    response.reason = Response::IO_ERROR;
    response.message = error.what();
  }
  catch (const Interrupted& error)
  {
    response.reason = Response::ABORTED;
    response.message = error.what();
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  if (!response.success)
  {
    ROS_ERROR("participant %d, %s, trial %d: %s", request.participant, request.controller.c_str(), request.trial,
              response.message.c_str());
    if (response.reason != Response::BAD_REQUEST)
      announce(spec, phri_msgs::Trial::ABORTED, false, response.observations);
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  status_.running = false;
  status_.error = response.success ? "" : response.message;
  return response;
}

void TrialHost::check(const phri_msgs::RunTrialRequest& request) const
{
  const std::vector<std::string>& known = phri_control::assistanceNames();
  if (std::find(known.begin(), known.end(), request.controller) == known.end())
  {
    const std::string meant = phri_core::closest(request.controller, known);
    throw std::invalid_argument("controller \"" + request.controller + "\": unknown" +
                                (meant.empty() ? "" : "; did you mean \"" + meant + "\"?"));
  }
  phri_core::requireRange("participant", request.participant, 0, 100000, "");
  phri_core::requireRange("trials", request.trials, 1, 1000, "");
  phri_core::requireRange("trial", request.trial, 1, request.trials, "");
  phri_core::requireRange("practice", request.practice, 0, 1e6, "");
}

void TrialHost::waitForModel() const
{
  const auto start = SteadyClock::now();
  while (inbox_.publishers() == 0 || observations_.getNumSubscribers() == 0)
  {
    if (interrupted())
      throw Interrupted("aborted while waiting for a model");
    if (secondsSince(start) > kConnectWait)
      throw PeerLost("nobody publishes " + inbox_.topic() + " and listens to observations: is " +
                     setup_.settings.model_node + " running?");
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

void TrialHost::conduct(const phri_msgs::RunTrialRequest& request, TrialSpec spec, Response& response)
{
  if (!setup_.settings.model_node.empty() || request.use_model)
    waitForModel();
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    changes_.clear();
    status_ = HostStatus();
    status_.running = true;
    status_.trial = "participant " + std::to_string(spec.participant) + ", " + spec.controller + ", trial " +
                    std::to_string(spec.trial);
  }
  if (hands_)
    waitForHand(spec);
  const NodeSetup setup = inForce();
  if (hands_ && !runningController().empty())
    spec.controller = runningController();
  Trial trial(setup.experiment, spec, hands_ ? hands_->hand(spec) : nullptr);
  std::unique_ptr<Recorder> recorder;
  if (!request.bag_dir.empty())
    recorder = std::make_unique<Recorder>(
        request.bag_dir, (request.bag_prefix.empty() ? setup.experiment->name : request.bag_prefix) + "_p" +
                             std::to_string(spec.participant) + "_" + spec.controller + "_t" +
                             std::to_string(spec.trial));
  TrialOutput output(live_, names_, std::move(recorder), spec, trial.stage(), sessionTime());
  Run run{ trial, output, bool(request.use_model) };
  output.metadata(metadata(setup, spec, false, 0, {}), output.stamp(0));
  announce(spec, phri_msgs::Trial::STARTED, false, 0);
  response.controller = spec.controller;
  enter(trial, *setup.experiment);
  const auto leave = [&] {
    const std::lock_guard<std::mutex> lock(mutex_);
    trial_ = nullptr;
    response.observations = run.observations;
    response.duration = run.ticks * setup_.experiment->loop.dt;
    session_ns_ = output.stamp(std::llround(response.duration * 1e9) + kPause).toNSec();
  };
  try
  {
    setup_.settings.realtime() ? realtime(run) : lockstep(run);
    if (interrupted())
      throw Interrupted("aborted by the operator");
  }
  catch (...)
  {
    leave();
    throw;
  }
  leave();
  response.completed = trial.completed();
  response.changed = !changes().empty();
  output.metadata(metadata(setup, spec, trial.completed(), int(run.failed_plans), changes()),
                  output.stamp(std::llround(response.duration * 1e9)));
  response.bag = output.finish();
  announce(spec, phri_msgs::Trial::FINISHED, trial.completed(), run.observations);
  const HostStatus now = status();
  char text[160];
  std::snprintf(text, sizeof(text), "%s after %.3f s, %.1f times real time, %u plans failed",
                trial.completed() ? "goal reached" : "goal NOT reached", response.duration, now.real_time_factor,
                run.failed_plans);
  response.message = text;
  ROS_INFO("%s: %s", now.trial.c_str(), text);
  if (!now.lateness.empty())
    ROS_INFO("%s: lateness of the ticks: %s", now.trial.c_str(), now.lateness.c_str());
}

void TrialHost::observe(Run& run, const phri_core::Observation& observation, std::int64_t time_ns)
{
  phri_msgs::Observation message = phri_msgs::toMessage(observation);
  message.header.stamp = run.output.stamp(time_ns);
  message.header.frame_id = live_.frame().motion;
  observations_.publish(message);
  ++run.observations;
  run.output.observed(message);
}

void TrialHost::tick(Run& run, const phri_control::TickRecord& record, const StageSample& sample)
{
  run.failed_plans = unsigned(run.trial.failedPlans());
  run.output.tick(record, sample, run.failed_plans);
  if (++run.ticks % 10 != 0)
    return;
  run.output.controllerIs(run.trial.planner().controller());
  if (hands_)
    show(record, operatorText(record), run.output.stamp(record.time_ns));
  const std::lock_guard<std::mutex> lock(mutex_);
  status_.record = record;
  status_.ticks = run.ticks;
  status_.failed_plans = run.failed_plans;
  status_.limits |= record.limits;
  status_.real_time_factor = run.ticks * setup_.experiment->loop.dt / std::max(1e-6, secondsSince(run.start));
}

void TrialHost::lockstep(Run& run)
{
  const auto give_up = [this] { return interrupted(); };
  Trial& trial = run.trial;
  const StageSampler sampler(trial.stage(), trial.experiment());
  StageSample sample;
  while (!trial.finished() && !interrupted())
  {
    sampler.before(sample);
    trial.step();
    sampler.after(sample);
    const std::int64_t now_ns = trial.record().time_ns;
    tick(run, trial.record(), sample);
    if (!trial.planDue())
      continue;
    if (setup_.settings.pace > 0.0)
      std::this_thread::sleep_until(run.start + std::chrono::nanoseconds(std::llround(now_ns / setup_.settings.pace)));
    observe(run, trial.observation(), now_ns);
    if (!run.use_model)
      continue;
    const ros::Time stamp = run.output.stamp(now_ns);
    const phri_msgs::PredictionConstPtr message = inbox_.wait(stamp, kModelWait, give_up);
    if (interrupted())
      return;
    if (!message)
      throw PeerLost("no " + inbox_.topic() + " for t = " + std::to_string(now_ns * 1e-9) + " s within " +
                     std::to_string(int(kModelWait)) + " s from " + setup_.settings.model_node +
                     (inbox_.publishers() == 0 ? ": it is gone" : ": it is connected but does not answer"));
    const std::optional<phri_core::Prediction> prediction = phri_msgs::fromMessage(*message);
    if (prediction)
      run.output.predicted(*prediction, *message, stamp);
    trial.plan(prediction);
  }
}

void TrialHost::announce(const TrialSpec& spec, std::uint8_t phase, bool completed, std::uint32_t observations)
{
  phri_msgs::Trial message;
  message.header.stamp = sessionTime();
  message.header.frame_id = live_.frame().motion;
  message.participant = spec.participant;
  message.controller = spec.controller;
  message.trial = spec.trial;
  message.practice = spec.practice;
  message.evaluated = spec.evaluated;
  message.seed = spec.seed;
  message.phase = phase;
  message.completed = completed;
  message.observations = observations;
  trials_.publish(message);
}

void TrialHost::idle()
{
  const std::unique_lock<std::mutex> busy(busy_, std::try_to_lock);
  if (busy)
    live_.clock(sessionTime());
}

HostStatus TrialHost::status()
{
  const std::lock_guard<std::mutex> lock(mutex_);
  HostStatus now = status_;
  status_.limits = 0;
  return now;
}
}  // namespace phri_sim
