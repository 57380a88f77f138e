#include "interaction_host.hpp"

#include <chrono>

#include "phri_msgs/conversions.hpp"

namespace phri_control
{
using phri_core::LoopState;

namespace
{
constexpr double kAnswer = 0.5;    // [s] that a request may take
constexpr double kWait = 0.1;      // [s] for the next output
constexpr double kFarewell = 0.1;  // [s] of zero velocities at the end
constexpr double kWarnPeriod = 5.0;
constexpr auto kLook = std::chrono::milliseconds(2);

bool running(const RobotOutput& output)
{
  return output.record.state == LoopState::Passive || output.record.state == LoopState::Active;
}

bool resting(const RobotOutput& output)
{
  return output.rates.isZero(0.0) && output.base.isZero(0.0);
}
}  // namespace

InteractionHost::InteractionHost(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                                 const InteractionSetup& setup)
  : setup_(setup),
    tick_(setup_.tick, setup_.loop, setup_.arm.front(), setup_.body, setup_.sensor),
    outputs_(node, private_node, setup_),
    topics_(node, setup_, tick_, start_ns_),
    thread_(tick_, setup_.loop.dt, start_ns_),
    publisher_(&InteractionHost::publish, this),
    prediction_spinner_(1, &prediction_queue_)
{
  if (setup_.settings.model.empty())
    return;
  planner_ = std::make_unique<AssistancePlanner>(setup_.settings.controller, setup_.assistance, setup_.settings.gate);
  ros::NodeHandle own(node);
  own.setCallbackQueue(&prediction_queue_);
  predictions_ = own.subscribe("prediction/" + setup_.settings.model, 1, &InteractionHost::plan, this,
                               ros::TransportHints().tcpNoDelay());
  prediction_spinner_.start();
}

InteractionHost::~InteractionHost()
{
  prediction_spinner_.stop();
  stop();
  std::this_thread::sleep_for(std::chrono::duration<double>(kFarewell));
  done_ = true;
  publisher_.join();
  thread_.stop();
}

void InteractionHost::publish()
{
  while (!done_)
  {
    const RobotOutput* output = thread_.wait(kWait);
    if (!output)
      continue;
    outputs_.publish(*output, [this] { return monitor(); });
    // only now: whoever waits for rest may rely on its being published
    const std::lock_guard<std::mutex> lock(mutex_);
    newest_ = *output;
    ++cycles_;
  }
}

void InteractionHost::plan(const phri_msgs::PredictionConstPtr& message)
{
  try
  {
    if (message->header.frame_id != "interaction")
    {
      ROS_ERROR_THROTTLE(kWarnPeriod, "E_FRAME topic=%s frame_id=\"%s\" expected=\"interaction\" action=DROP",
                         predictions_.getTopic().c_str(), message->header.frame_id.c_str());
      return;
    }
    const std::optional<phri_core::Prediction> prediction = phri_msgs::fromMessage(*message);
    const RobotOutput output = newest();
    if (!prediction || !running(output))
      return;
    if (std::optional<FeedbackPolicy> policy = planner_->plan(observationOf(output.record), prediction))
      tick_.loop().adopt(std::move(*policy));
    const std::lock_guard<std::mutex> lock(mutex_);
    prediction_t0_ = prediction->t0;
  }
  catch (const std::exception& error)
  {
    ROS_ERROR_THROTTLE(kWarnPeriod, "E_PREDICTION topic=%s: %s", predictions_.getTopic().c_str(), error.what());
  }
}

RobotOutput InteractionHost::newest() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return newest_;
}

InteractionMonitor InteractionHost::monitor() const
{
  InteractionMonitor result;
  const TopicHealth health = topics_.health();
  result.odometry_frame = health.odometry_frame;
  result.controller = setup_.settings.controller;
  result.failed_plans = planner_ ? unsigned(planner_->failures()) : 0;
  const std::lock_guard<std::mutex> lock(mutex_);
  result.message = operatorText(newest_, health, setup_);
  result.prediction_t0 = prediction_t0_;
  return result;
}

bool InteractionHost::until(double timeout, const std::function<bool(const RobotOutput&)>& reached) const
{
  const std::int64_t end = monotonicNs() + std::int64_t(timeout * 1e9);
  while (!reached(newest()))
  {
    if (monotonicNs() > end)
      return false;
    std::this_thread::sleep_for(kLook);
  }
  return true;
}

Reply InteractionHost::start()
{
  const RobotOutput before = newest();
  if (running(before))
    return { true, "it runs already" };
  if (before.record.state == LoopState::Fault)
    return { false, "in FAULT: " + operatorText(before, topics_.health(), setup_) };
  const std::string obstacle = obstacleText(before, topics_.health(), setup_);
  if (!obstacle.empty())
    return { false, obstacle };
  tick_.loop().start();
  if (until(kAnswer, running))
    return { true, setup_.tick.dry_run ? "started, dry: nothing moves" : "started" };
  return { false, "not started: " + operatorText(newest(), topics_.health(), setup_) };
}

Reply InteractionHost::stop()
{
  tick_.loop().stop();
  if (until(kAnswer + setup_.tick.stop_time, [](const RobotOutput& o) { return !running(o) && resting(o); }))
    return { true, newest().record.state == LoopState::Fault ? "at rest, in FAULT" : "stopped" };
  return { false, "not at rest" };
}

Reply InteractionHost::clearFault()
{
  if (newest().record.state != LoopState::Fault)
    return { true, "there is no fault" };
  tick_.loop().clearFault();
  if (until(kAnswer, [](const RobotOutput& o) { return o.record.state != LoopState::Fault; }))
    return { true, "cleared" };
  return { false, "not cleared: " + operatorText(newest(), topics_.health(), setup_) };
}

Reply InteractionHost::tare()
{
  if (setup_.settings.ft_input != "raw")
    return { false, "the wrench comes compensated: tare it where it is compensated" };
  if (newest().record.state != LoopState::Idle)
    return { false, "only while stopped" };
  topics_.tare();
  const bool over = until(setup_.force_sensor.tare_time + 2.0 * kAnswer,
                          [this](const RobotOutput&) { return topics_.health().tare.state != TareState::Running; });
  const TareReport report = topics_.health().tare;
  return { report.state == TareState::Done, over ? describe(report) : "no readings: is the sensor's driver running?" };
}

InteractionHost::Status InteractionHost::status() const
{
  Status status;
  status.health = topics_.health();
  status.refused = thread_.refused();
  status.worst_lateness = thread_.worstLateness();
  status.late_cycles = thread_.lateCycles();
  const std::lock_guard<std::mutex> lock(mutex_);
  status.output = newest_;
  status.cycles = cycles_;
  status.message = operatorText(newest_, status.health, setup_);
  return status;
}
}  // namespace phri_control
