#include "phri_sim/trial.hpp"

#include "phri_learning/behavior_models.hpp"
#include "phri_learning/emerging_partner.hpp"
#include "phri_learning/hmm_training.hpp"

namespace phri_sim
{
namespace
{
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
    stage_(makeStage(experiment_, spec, std::move(hand))),
    loop_(experiment_->loop),
    planner_(experiment_->assists(spec.trial) ? spec.controller : "none", experiment_->assistance,
             experiment_->model.gate),
    replan_ticks_(experiment_->replanTicks())
{
  loop_.place(stage_->start());
  loop_.start();
}

void Trial::step(double lateness)
{
  const std::int64_t now_ns = tick_ * std::llround(experiment_->loop.dt * 1e9);
  phri_core::Measurement measurement = stage_->read(now_ns, loop_.record().assistance_wrench);
  if (tamper)
    tamper(measurement, now_ns);
  stage_->write(loop_.tick(measurement, now_ns, lateness));
  ++tick_;
  completed_ = stage_->arrived();
  timed_out_ = !completed_ && time() >= experiment_->timeout;
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
  model.dof = int(demonstrations.front().cols()) / 3;
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
  const int dof = int(trial.stage().start().size());
  const auto* transport = dynamic_cast<const TransportStage*>(&trial.stage());
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
    samples.push_back(phri_learning::observationVector(observation, dof));
    if (transport)
      log.transport.push_back(transport->sample());
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
  log.demonstration.resize(samples.size(), 3 * dof);
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
    if (!logs.empty() && partner->learned())
      for (const phri_learning::LearnedPrimitive& primitive : partner->learned()->primitives)
        logs.back().primitive_outputs.push_back(phri_learning::generalisedOutput(*primitive.own));
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
