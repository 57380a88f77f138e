#include "phri_sim/contact_run.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "phri_learning/hmm_training.hpp"

namespace phri_sim
{
namespace
{
using Eigen::Vector3d;

constexpr int kDof = 3;

void judge(const ContactStage& stage, ContactOutcome& outcome)
{
  outcome.pointing_error = stage.pointingError();
  if (const Button* button = stage.button())
  {
    outcome.touches = button->touches();
    outcome.clicks = button->clicks();
    outcome.deepest = button->deepest();
  }
  if (const Whiteboard* board = stage.whiteboard())
    outcome.wiped = board->share();
}

bool done(const ContactTask& task, const ContactOutcome& outcome)
{
  if (task.scene.wipes)
    return wipingVerdict(task, outcome) == "success";
  return pressingVerdict(outcome) == "success" && pointingVerdict(task, outcome) == "success";
}

/// Over `count` samples, the mean length of the demonstrations: (3.10) adds up the spreads of all states and comes out
/// a tenth longer where legs vary on their own.
phri_control::ContactReference referenceOf(const phri_learning::TimeHmm& model, int count, double dt)
{
  const auto learned = model.regress(Eigen::VectorXd::LinSpaced(count, 0.0, (count - 1) * dt));
  phri_control::ContactReference reference;
  reference.dt = dt;
  for (int k = 0; k < count; ++k)
  {
    const Eigen::VectorXd mean = learned.means.row(k).transpose();
    const Eigen::MatrixXd& covariance = learned.covariances[std::size_t(k)];
    reference.motion.push_back({ mean.head(2 * kDof), covariance.topLeftCorner(2 * kDof, 2 * kDof) });
    reference.environment_wrench.push_back({ mean.tail(kDof), covariance.bottomRightCorner(kDof, kDof) });
  }
  return reference;
}
}  // namespace

std::string pressingVerdict(const ContactOutcome& outcome)
{
  return outcome.clicks > 0 ? "success" : outcome.touches > 0 ? "partial" : "failure";
}

std::string pointingVerdict(const ContactTask& task, const ContactOutcome& outcome)
{
  return outcome.pointing_error <= task.pointing_tolerance ? "success" : "failure";
}

std::string wipingVerdict(const ContactTask& task, const ContactOutcome& outcome)
{
  return outcome.wiped >= task.wiped_success ? "success" : outcome.wiped > task.wiped_partial ? "partial" : "failure";
}

Demonstration demonstrate(std::shared_ptr<const ContactTask> task, std::uint64_t seed, int index)
{
  ContactStage stage(task, { seed, 0.0, index });
  phri_control::InteractionLoop loop(task->loop);
  loop.place(stage.start());
  loop.start();
  const double dt = task->loop.dt;
  const int ticks = int(std::lround(stage.teacher()->duration() / dt)), every = int(std::lround(task->dt / dt));
  Demonstration demonstration;
  demonstration.samples.resize((ticks + every - 1) / every, 3 * kDof);
  ContactOutcome& outcome = demonstration.outcome;
  for (int k = 0; k < ticks; ++k)
  {
    const std::int64_t now = std::llround(k * dt * 1e9);
    const phri_core::Measurement m = stage.read(now, loop.record().assistance_wrench);
    const phri_core::Command command = loop.tick(m, now);
    if (k % every == 0)
      demonstration.samples.row(k / every) << m.position.transpose(), loop.record().velocity.transpose(),
          m.environment_wrench.transpose();
    stage.write(command);
    outcome.peak_force = std::max(outcome.peak_force, stage.contactForce().norm());
    outcome.faulted = outcome.faulted || loop.record().state == phri_core::LoopState::Fault;
  }
  judge(stage, outcome);
  return demonstration;
}

TaughtTask teach(std::shared_ptr<const ContactTask> task, std::uint64_t seed)
{
  TaughtTask taught;
  std::vector<Eigen::MatrixXd> samples;
  for (int index = 0; int(samples.size()) < task->demonstrations; ++index)
  {
    if (index >= 2 * task->demonstrations)
      throw std::runtime_error(task->name + ": " + std::to_string(taught.repeated) + " of " + std::to_string(index) +
                               " demonstrations did not do the task; expected at most half of them");
    Demonstration demonstration = demonstrate(task, seed, index);
    if (!done(*task, demonstration.outcome))
    {
      ++taught.repeated;
      continue;
    }
    samples.push_back(demonstration.samples);
    taught.demonstrations.push_back(std::move(demonstration));
  }
  phri_learning::TrainingOptions options;
  options.states = task->states;
  options.dt = task->dt;
  const phri_learning::TrainingResult result = phri_learning::train(samples, options);
  Eigen::Index total = 0;
  for (const Eigen::MatrixXd& one : samples)
    total += one.rows();
  const int count = std::max(2, int(total / Eigen::Index(samples.size())));
  taught.reference = referenceOf(result.model, count, task->dt);
  taught.length = (count - 1) * task->dt;
  return taught;
}

ContactRun::ContactRun(std::shared_ptr<const ContactTask> task, const std::string& controller,
                       std::shared_ptr<const TaughtTask> taught, const ContactTrial& trial)
  : task_(std::move(task)),
    taught_(std::move(taught)),
    stage_(task_, trial),
    loop_(task_->loop),
    controller_(controller, task_->control),
    ticks_(int(std::lround((taught_->length + task_->rest) / task_->loop.dt))),
    plan_ticks_(int(std::lround(task_->dt / task_->loop.dt)))
{
  controller_.follow(taught_->reference);
  loop_.place(stage_.start());
  loop_.start();
  log_.reserve(std::size_t(ticks_ / plan_ticks_ + 1));
}

void ContactRun::step()
{
  const std::int64_t now = std::llround(time() * 1e9);
  const phri_core::Measurement m = stage_.read(now, loop_.record().assistance_wrench);
  controller_.observe(now * 1e-9, m.environment_wrench);
  if (tick_ % plan_ticks_ == 0)
    plan(m);
  stage_.write(loop_.tick(m, now));
  const phri_control::TickRecord& record = loop_.record();
  peak_force_ = std::max(peak_force_, stage_.contactForce().norm());
  limited_ += (record.limits & phri_core::kAssistanceLimits) != 0;
  faulted_ = faulted_ || record.state == phri_core::LoopState::Fault;
  ++tick_;
}

void ContactRun::plan(const phri_core::Measurement& m)
{
  phri_core::Observation seen = loop_.observation();
  seen.t = m.receive_ns * 1e-9;
  seen.state.head(kDof) = m.position;
  seen.environment_wrench = m.environment_wrench;
  if (auto policy = controller_.plan(seen))
    loop_.adopt(std::move(*policy));
  const phri_control::ContactPlan& last = controller_.last();
  const std::size_t k = std::min(std::size_t(tick_ / plan_ticks_), taught_->reference.motion.size() - 1);
  ContactSample row;
  row.t = seen.t;
  row.position = m.position;
  row.learned = taught_->reference.motion[k].mean.head(kDof);
  row.reference = last.reference.head(kDof);
  row.stiffness = last.stiffness;
  row.noise = last.noise_variance.cwiseSqrt();
  row.input = controller_.forceInput(seen.t, m.environment_wrench);
  row.force = m.environment_wrench;
  row.taught = taught_->reference.environment_wrench[k].mean;
  row.contact = stage_.contactForce().norm();
  row.travel = stage_.button() ? stage_.button()->travel() : 0.0;
  row.wiped = stage_.whiteboard() ? stage_.whiteboard()->share() : 0.0;
  log_.push_back(row);
}

ContactOutcome ContactRun::outcome() const
{
  ContactOutcome outcome;
  judge(stage_, outcome);
  outcome.peak_force = peak_force_;
  outcome.faulted = faulted_;
  outcome.limited = tick_ > 0 ? double(limited_) / tick_ : 0.0;
  return outcome;
}
}  // namespace phri_sim
