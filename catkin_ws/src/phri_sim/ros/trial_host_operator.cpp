// What the operator asks of TrialHost, and the wait for a hand.
#include <algorithm>
#include <sstream>
#include <thread>

#include "operator_text.hpp"
#include "phri_core/check.hpp"
#include "phri_sim/tuning.hpp"
#include "trial_host.hpp"

namespace phri_sim
{
namespace
{
constexpr auto kShowPeriod = std::chrono::milliseconds(33);
constexpr auto kWaitPeriod = std::chrono::milliseconds(20);
const char* const kNothingRuns = "no trial is running";

/// The object at rest at the start: what is to be seen while a hand is waited for. Hands are there for the planar
/// device only.
phri_control::TickRecord atStart(const Experiment& experiment)
{
  phri_control::TickRecord record;
  record.state = phri_core::LoopState::Idle;
  record.position = experiment.scene->start;
  record.velocity = record.human_wrench = record.environment_wrench = record.requested_wrench =
      record.assistance_wrench = phri_core::VectorDof::Zero(2);
  return record;
}

std::string text(const phri_core::ParameterValue& value)
{
  std::ostringstream out;
  if (const auto* number = std::get_if<double>(&value))
    out << *number;
  return out.str();
}
}  // namespace

void TrialHost::waitForHand(const TrialSpec& spec)
{
  const std::shared_ptr<const Experiment> experiment = inForce().experiment;
  const phri_control::TickRecord record = atStart(*experiment);
  TickMessages messages;
  TrialMonitor monitor;
  const StageSample nothing;
  live_.begin(spec, nullptr);
  start_asked_ = false;
  waiting_ = true;
  while (!interrupted())
  {
    monitor.message = hands_->waitingFor();
    const bool there = monitor.message.empty();
    if (there && (hands_->autostart() || start_asked_))
      break;
    start_asked_ = false;
    if (there)
      monitor.message = "ready: start";
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      monitor.controller = chosen_.empty() ? spec.controller : chosen_;
      status_.record = record;
    }
    messages.fill(record, sessionTime());
    live_.tick({ record, nothing, sessionTime() }, messages, monitor);
    show(record, monitor.message, sessionTime());
    std::this_thread::sleep_for(kWaitPeriod);
  }
  waiting_ = false;
  if (interrupted())
    throw Interrupted("aborted while waiting for the hand");
}

/// From here on requests reach the trial; those that came while it was made are made up for.
void TrialHost::enter(Trial& trial, const Experiment& experiment)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  trial_ = &trial;
  if (setup_.experiment.get() != &experiment)
  {
    trial.planner().retune(setup_.experiment->assistance);
    trial.loop().render(setup_.experiment->loop.mass, setup_.experiment->loop.damping);
    changed("tuned while the trial was made");
  }
  if (!chosen_.empty() && chosen_ != trial.planner().controller())
  {
    trial.planner().select(chosen_);
    changed("controller = " + chosen_);
  }
}

void TrialHost::show(const phri_control::TickRecord& record, const std::string& text, const ros::Time& stamp)
{
  const auto now = std::chrono::steady_clock::now();
  if (now < next_show_)
    return;
  next_show_ = now + kShowPeriod;
  hands_->show(record.position, stamp, text);
}

Reply TrialHost::ask(const std::string& done, const std::function<void(phri_control::InteractionLoop&)>& request)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!trial_)
    return { false, kNothingRuns };
  request(trial_->loop());
  return { true, done };
}

Reply TrialHost::start()
{
  if (waiting_)
  {
    const std::string missing = hands_->waitingFor();
    if (!missing.empty())
      return { false, missing };
    start_asked_ = true;
    return { true, "started" };
  }
  phri_control::TickRecord last;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    last = status_.record;
  }
  if (last.state == phri_core::LoopState::Fault || (last.limits & phri_core::kLimitBias))
    return { false, operatorText(last) };
  return ask("started", [](phri_control::InteractionLoop& loop) { loop.start(); });
}

Reply TrialHost::stop()
{
  return ask("stopped", [](phri_control::InteractionLoop& loop) { loop.stop(); });
}

Reply TrialHost::clearFault()
{
  return ask("asked for; ignored unless the cause has been gone for 1 s and all is at rest",
             [](phri_control::InteractionLoop& loop) { loop.clearFault(); });
}

Reply TrialHost::reset()
{
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!status_.running)
    return { false, kNothingRuns };
  abort_ = true;
  return { true, "trial ended" };
}

Reply TrialHost::switchController(const std::string& name)
{
  const std::vector<std::string>& known = phri_control::assistanceNames();
  if (std::find(known.begin(), known.end(), name) == known.end())
  {
    const std::string meant = phri_core::closest(name, known);
    return { false, "controller \"" + name + "\": unknown" +
                        (meant.empty() ? "" : "; did you mean \"" + meant + "\"?") + " The old one stays." };
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!trial_ && !hands_)
    return { false, std::string(kNothingRuns) + "; a simulated session keeps to its schedule" };
  if (hands_)
    chosen_ = name;
  if (trial_)
  {
    trial_->planner().select(name);
    changed("controller = " + name);
  }
  if (hands_)
    hands_->controllerIs(name);
  return { true, name + " is in force" };
}

TuningServer::Entries TrialHost::tunables() const
{
  Tuning tuning(*inForce().experiment);
  return tuning.table().entries();
}

void TrialHost::tune(const TuningServer::Values& values)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  auto next = std::make_shared<Experiment>(*setup_.experiment);
  Tuning tuning(*next);
  tuning.table().assign("set_parameters", values);
  tuning.apply(*next);
  if (trial_)
  {
    trial_->planner().retune(next->assistance);
    trial_->loop().render(next->loop.mass, next->loop.damping);
    for (const auto& [key, value] : values)
      changed(key + " = " + text(value));
  }
  setup_.experiment = next;
}

NodeSetup TrialHost::inForce() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return setup_;
}

std::vector<Change> TrialHost::changes() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return changes_;
}

/// Precondition: mutex_ is held.
void TrialHost::changed(const std::string& what)
{
  changes_.push_back({ status_.record.time_ns * 1e-9, what });
  ROS_INFO("%s: %s from t = %.3f s on", status_.trial.c_str(), what.c_str(), changes_.back().t);
}

std::string TrialHost::runningController() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return trial_ ? trial_->planner().controller() : chosen_;
}

OperatorActions TrialHost::actions()
{
  OperatorActions actions;
  actions.start = [this] { return start().text; };
  actions.stop = [this] { return stop().text; };
  actions.clear_fault = [this] { return clearFault().text; };
  actions.reset = [this] { return reset().text; };
  actions.controller = [this](const std::string& name) { return switchController(name).text; };
  actions.controllers = phri_control::assistanceNames();
  return actions;
}
}  // namespace phri_sim
