#include "phri_sim/trial.hpp"

#include "phri_learning/behavior_models.hpp"
#include "phri_learning/emerging_partner.hpp"
#include "phri_learning/hmm_training.hpp"
#include "phri_sim/route.hpp"

namespace phri_sim
{
namespace
{
constexpr int kDof = 2;
constexpr double kReach = 0.02;         // [m] along a path that one may be ahead or back within a tick
constexpr double kSettledSpeed = 0.02;  // [m/s] at the goal: arrived, not passing through

std::shared_ptr<const Route> routeOf(const Experiment& experiment, const Participant& person)
{
  return std::make_shared<const Route>(planRoute(*experiment.scene, person.clearance));
}

class SimulatedHand : public Hand
{
public:
  SimulatedHand(const Experiment& experiment, const Participant& person, const TrialSpec& spec)
    : human_(experiment.scene, routeOf(experiment, person), person, spec.practice, experiment.loop.mass(0),
             experiment.loop.damping(0), spec.seed, experiment.pace),
      let_go_(experiment.letsGo(spec.trial))
  {
  }
  HandForce act(const HandleState& handle) noexcept override
  {
    HandForce out;
    if (handle.t >= let_go_)
      return out;
    out.force = human_.step(handle.t, handle.position, handle.velocity, handle.robot_force, *handle.obstacles);
    return out;
  }

private:
  HumanPartner human_;
  double let_go_;  // [s]
};

PredictedPosition atHorizon(const phri_core::Prediction& prediction, std::int64_t now_ns)
{
  const phri_core::Gaussian& last = prediction.desired_state.back();
  return { now_ns, prediction.t0, prediction.dt * double(prediction.desired_state.size() - 1), last.mean.head<2>(),
           last.covariance.topLeftCorner<2, 2>() };
}
}  // namespace

Trial::Trial(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec, std::unique_ptr<Hand> hand)
  : experiment_(std::move(experiment)),
    spec_(spec),
    person_(experiment_->population.person(spec.study_seed, spec.participant)),
    obstacles_(obstaclesOfTrial(*experiment_->scene, spec.seed)),
    device_(experiment_->sensors, experiment_->scene->start, spec.seed),
    hand_(std::move(hand)),
    loop_(experiment_->loop),
    planner_(experiment_->assists(spec.trial) ? spec.controller : "none", experiment_->assistance,
             experiment_->model.gate),
    replan_ticks_(experiment_->replanTicks())
{
  if (!hand_)
    hand_ = std::make_unique<SimulatedHand>(*experiment_, person_, spec);
  if (!experiment_->scene->path.empty())
    path_ = planRoute(*experiment_->scene, person_.clearance);
  loop_.place(experiment_->scene->start);
  loop_.start();
}

void Trial::step(double lateness)
{
  const double dt = experiment_->loop.dt, t = tick_ * dt;
  const std::int64_t now_ns = tick_ * std::llround(dt * 1e9);
  const Eigen::Vector2d x = device_.position(), v = device_.velocity();
  const HandForce hand = hand_->act({ t, x, v, loop_.record().assistance_wrench, &obstacles_ });
  const Eigen::Vector2d contact = contactForce(*experiment_->scene, obstacles_, x, v, t);
  phri_core::Measurement measurement = device_.read(hand.force, contact, now_ns);
  if (hand.sensed)
  {
    measurement.human_wrench = hand.force;
    measurement.receive_ns = now_ns - hand.age_ns;
    measurement.stamp_ns = now_ns - hand.stamp_age_ns;
    measurement.sequence = hand.sequence;
    measurement.frame = hand.frame;
  }
  if (tamper)
    tamper(measurement, now_ns);
  device_.write(loop_.tick(measurement, now_ns, lateness));
  ++tick_;
  completed_ = (device_.position() - experiment_->scene->goal).norm() < experiment_->scene->goal_radius &&
               device_.velocity().norm() < kSettledSpeed;
  if (path_)
  {
    progress_ = path_->project(device_.position(), progress_, kReach);
    completed_ = completed_ && path_->length() - progress_ < kReach;
  }
  timed_out_ = !completed_ && tick_ * dt >= experiment_->timeout;
}

void Trial::plan(const phri_core::Observation& observation, const std::optional<phri_core::Prediction>& prediction)
{
  if (std::optional<phri_control::FeedbackPolicy> policy = planner_.plan(observation, prediction))
    loop_.adopt(std::move(*policy));
}

std::shared_ptr<phri_core::BehaviorModel> learn(const ModelSettings& settings,
                                                const std::vector<Eigen::MatrixXd>& demonstrations)
{
  if (demonstrations.empty())
    return nullptr;
  phri_learning::TrainingOptions options;
  options.states = settings.states;
  options.dt = settings.dt;
  phri_learning::TimeHmmModelSettings model;
  model.dof = kDof;
  model.window = settings.window;
  model.reference = phri_learning::referenceNamed(settings.reference);
  model.time = phri_learning::timeEstimateNamed(settings.time);
  model.recognition = phri_learning::recognitionNamed(settings.recognition);
  model.adapt_pace = settings.adapt_pace;
  auto hmm = std::make_shared<const phri_learning::TimeHmm>(phri_learning::train(demonstrations, options).model);
  return std::make_shared<phri_learning::TimeHmmModel>(std::move(hmm), model);
}

TrialLog runTrial(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec,
                  std::shared_ptr<phri_core::BehaviorModel> model, const std::function<void()>& learn)
{
  Trial trial(experiment, spec);
  TrialLog log;
  log.spec = spec;
  log.ticks.reserve(20000);
  std::vector<Eigen::VectorXd> samples;
  if (model)
    model->reset();
  if (learn)
    learn();
  while (!trial.finished())
  {
    trial.step();
    log.ticks.push_back(trial.record());
    if (!trial.planDue())
      continue;
    const phri_core::Observation observation = trial.observation();
    samples.push_back(phri_learning::observationVector(observation, kDof));
    if (!model)
      continue;
    ++log.plans;
    model->observe(observation);
    const auto prediction = model->predict(experiment->model.horizon, experiment->model.dt);
    if (prediction)
      log.predictions.push_back(atHorizon(*prediction, trial.record().time_ns));
    trial.plan(prediction);
    if (learn)
      learn();
  }
  log.completed = trial.completed();
  log.failed_plans = trial.failedPlans();
  log.demonstration.resize(samples.size(), 3 * kDof);
  for (std::size_t k = 0; k < samples.size(); ++k)
    log.demonstration.row(k) = samples[k];
  return log;
}

std::vector<TrialLog> runBlock(std::shared_ptr<const Experiment> experiment, const Block& block)
{
  std::vector<TrialLog> logs;
  if (experiment->model.emerging())
  {
    const phri_learning::EmergingOptions options = experiment->model.emergingOptions();
    const auto partner = std::make_shared<phri_learning::EmergingPartner>(options);
    phri_learning::PrimitiveLearner learner(options);
    for (const TrialSpec& spec : block.trials)
    {
      logs.push_back(runTrial(experiment, spec, partner, [&] { phri_learning::learn(partner.get(), &learner); }));
      logs.back().primitives = partner->learned() ? int(partner->learned()->primitives.size()) : 0;
    }
    return logs;
  }
  std::vector<Eigen::MatrixXd> demonstrations;
  for (const TrialSpec& spec : block.trials)
  {
    logs.push_back(runTrial(experiment, spec, learn(experiment->model, demonstrations)));
    demonstrations.push_back(logs.back().demonstration);
  }
  return logs;
}
}  // namespace phri_sim
