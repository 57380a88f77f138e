#include "recorded_case.hpp"

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "phri_core/gaussian.hpp"

namespace phri_sim_bench
{
namespace
{
using nlohmann::json;
using Problem = phri_control::LinearQuadraticProblem<4, 2>;
constexpr int kDof = 2;
constexpr double kRounding = 1e-9;  // relative; the two ways to the same gain differ in the order of sums

/// (5.28) and (5.29) written out once more, apart from the controller: `weights` are Q at the prediction's own times.
Problem problemOf(const phri_control::AssistanceSettings& settings, const phri_core::Prediction& prediction,
                  const std::vector<Eigen::Matrix4d>& weights)
{
  const int horizon = static_cast<int>(std::lround(settings.horizon / settings.dt));
  const auto weightAt = [&](int k) -> Eigen::Matrix4d {
    const double s = std::min(k * settings.dt / prediction.dt, static_cast<double>(weights.size() - 1));
    const std::size_t i = std::min(static_cast<std::size_t>(s), weights.size() - 2);
    return weights[i] + (s - static_cast<double>(i)) * (weights[i + 1] - weights[i]);
  };
  phri_control::LqStage<4, 2> stage = phri_control::LqStage<4, 2>::zero();
  stage.A.setIdentity();
  for (int i = 0; i < kDof; ++i)
  {
    stage.A(i, kDof + i) = settings.dt;
    stage.A(kDof + i, kDof + i) -= settings.dt * settings.damping(i) / settings.mass(i);
    stage.B(kDof + i, i) = settings.dt / settings.mass(i);
  }
  stage.R.diagonal().setConstant(settings.control_weight);
  Problem problem;
  for (int k = 0; k < horizon; ++k)
  {
    stage.Q = weightAt(k);
    problem.stages.push_back(stage);
  }
  problem.terminal = phri_control::LqTerminal<4>::zero();
  problem.terminal.Q = weightAt(horizon);
  return problem;
}

Eigen::Matrix4d diagonal(const phri_control::AssistanceSettings& settings, const phri_control::StateWeights& weights)
{
  const double x = settings.q_scale * weights.position, v = settings.q_scale * weights.velocity;
  return Eigen::Vector4d(x, x, v, v).asDiagonal();
}

void requireSamePolicy(const RecordedCase& recorded, const std::string& controller, const Problem& problem)
{
  const auto policy = phri_control::makeAssistance(controller, recorded.experiment->assistance)
                          ->plan(recorded.now(), recorded.prediction);
  if (!policy || policy->stages().size() != problem.stages.size())
    throw std::runtime_error("bench: " + controller + " made no policy of " + std::to_string(problem.stages.size()) +
                             " stages");
  const auto gain = phri_control::solve(problem).gains.front();
  const double difference = (gain - policy->stages().front().gain).cwiseAbs().maxCoeff();
  if (!(difference <= kRounding * gain.cwiseAbs().maxCoeff()))
    throw std::runtime_error("bench: the first gain of " + controller + " differs by " + std::to_string(difference) +
                             " from that of its LQ problem");
}

json rows(const Eigen::MatrixXd& matrix)
{
  json out = json::array();
  for (Eigen::Index i = 0; i < matrix.rows(); ++i)
  {
    const Eigen::VectorXd row = matrix.row(i);
    out.push_back(std::vector<double>(row.data(), row.data() + row.size()));
  }
  return out;
}

json list(const Eigen::VectorXd& vector)
{
  return std::vector<double>(vector.data(), vector.data() + vector.size());
}

json lqJson(const Problem& problem)
{
  json out = { { "A", rows(problem.stages.front().A) },
               { "B", rows(problem.stages.front().B) },
               { "R", rows(problem.stages.front().R) },
               { "gain", rows(phri_control::solve(problem).gains.front()) } };
  for (const auto& stage : problem.stages)
    out["Q"].push_back(rows(stage.Q));
  out["Q"].push_back(rows(problem.terminal.Q));
  return out;
}

json hmmJson(const phri_learning::TimeHmm& hmm)
{
  const phri_learning::TimeHmmParameters& p = hmm.parameters();
  json out = { { "dt", p.dt },
               { "length", hmm.length() },
               { "transition", rows(p.transition) },
               { "mean_s", rows(p.mean_s) },
               { "mean_t", list(p.mean_t) },
               { "tt", list(p.tt) },
               { "ts", rows(p.ts) },
               { "scale", list(p.scale) },
               { "durations", list(hmm.durations()) },
               { "covariance_floor", p.covariance_floor },
               { "repeat_variance", p.repeat_variance },
               { "pace_variance", p.pace_variance } };
  for (const Eigen::MatrixXd& covariance : p.ss)
    out["ss"].push_back(rows(covariance));
  return out;
}
}  // namespace

std::vector<Eigen::MatrixXd> RecordedCase::windows() const
{
  const Eigen::MatrixXd all = phri_learning::demonstration(observations, kDof);
  const Eigen::Index length = experiment->model.window;
  std::vector<Eigen::MatrixXd> out;
  for (Eigen::Index end = all.rows(); end >= length; end -= length / 2)
    out.push_back(all.middleRows(end - length, length));
  return out;
}

RecordedCase recordCase()
{
  RecordedCase recorded;
  recorded.experiment = std::make_shared<const phri_sim::Experiment>(phri_sim::loadExperiment("maze_assistance"));
  const phri_sim::Experiment& experiment = *recorded.experiment;
  std::vector<Eigen::MatrixXd> demonstrations;
  for (int trial = 1; trial <= experiment.trials; ++trial)
  {
    recorded.spec = phri_sim::trialSpec(0, "mahalanobis", trial, experiment.trials, trial - 1,
                                        static_cast<std::uint64_t>(experiment.seed));
    recorded.model =
        std::dynamic_pointer_cast<phri_learning::TimeHmmModel>(phri_sim::learn(experiment.model, demonstrations));
    if (trial < experiment.trials)
      demonstrations.push_back(phri_sim::runTrial(recorded.experiment, recorded.spec, recorded.model).demonstration);
  }
  if (!recorded.model)
    throw std::runtime_error("bench: nothing was learned, expected a time-based HMM");

  phri_sim::Trial trial(recorded.experiment, recorded.spec);
  recorded.model->reset();
  const double middle = 0.5 * recorded.hmm().length();
  while (!trial.finished() && trial.time() < middle)
  {
    trial.step();
    if (!trial.planDue())
      continue;
    recorded.observations.push_back(trial.observation());
    recorded.model->observe(recorded.now());
    recorded.prediction = *recorded.model->predict(experiment.model.horizon, experiment.model.dt);
    trial.plan(recorded.prediction);
  }

  if (recorded.windows().empty())
    throw std::runtime_error("bench: the trial is shorter than two windows of the model");

  const phri_control::AssistanceSettings& settings = experiment.assistance;
  const std::size_t nodes = recorded.prediction.desired_state.size();
  recorded.lqr =
      problemOf(settings, recorded.prediction, std::vector<Eigen::Matrix4d>(nodes, diagonal(settings, settings.lqr)));
  std::vector<Eigen::Matrix4d> weights;
  for (const phri_core::Gaussian& state : recorded.prediction.desired_state)
  {
    const Eigen::Matrix4d root = phri_core::inverseSquareRoot(state.covariance, settings.covariance_floor);
    weights.push_back(root * diagonal(settings, settings.mahalanobis) * root);
  }
  recorded.mahalanobis = problemOf(settings, recorded.prediction, weights);
  requireSamePolicy(recorded, "lqr", recorded.lqr);
  requireSamePolicy(recorded, "mahalanobis", recorded.mahalanobis);
  return recorded;
}

void writeCase(const RecordedCase& recorded, const std::string& path)
{
  json predicted, windows, paths;
  for (const Eigen::MatrixXd& window : recorded.windows())
  {
    windows.push_back(rows(window));
    paths.push_back(recorded.hmm().viterbi(window, phri_learning::Start::kAnywhere));
  }
  for (std::size_t k = 0; k < recorded.prediction.desired_state.size(); ++k)
  {
    predicted["mean"].push_back(list(recorded.prediction.desired_state[k].mean));
    predicted["covariance"].push_back(rows(recorded.prediction.desired_state[k].covariance));
  }
  const json out = { { "experiment", recorded.experiment->name },
                     { "lq", { { "lqr", lqJson(recorded.lqr) }, { "mahalanobis", lqJson(recorded.mahalanobis) } } },
                     { "hmm", hmmJson(recorded.hmm()) },
                     { "recognised", kDof },
                     { "windows", windows },
                     { "paths", paths },
                     { "prediction_dt", recorded.prediction.dt },
                     { "prediction", predicted },
                     { "admittance",
                       { { "mass", list(recorded.experiment->loop.mass) },
                         { "damping", list(recorded.experiment->loop.damping) },
                         { "dt", recorded.experiment->loop.dt } } } };
  std::ofstream file(path);
  file << out << '\n';
  if (!file.flush())
    throw std::runtime_error("bench: cannot write " + path);
}
}  // namespace phri_sim_bench
