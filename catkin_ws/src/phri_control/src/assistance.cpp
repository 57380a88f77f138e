#include "phri_control/assistance.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <variant>

#include "phri_control/lq_solver.hpp"
#include "phri_core/check.hpp"
#include "phri_core/gaussian.hpp"

namespace phri_control
{
namespace
{
using phri_core::Gaussian;
using phri_core::Observation;
using phri_core::Prediction;
using phri_core::VectorState;

/// A point between two elements of the prediction: (1 - fraction) of `index` and `fraction` of `index + 1`.
struct Point
{
  std::size_t index = 0;
  double fraction = 0.0;
};

/// Where time `t` lies in `prediction`; its ends hold outside of it.
Point locate(const Prediction& prediction, double t)
{
  const double last = static_cast<double>(prediction.desired_state.size() - 1);
  const double s = std::clamp((t - prediction.t0) / prediction.dt, 0.0, last);
  const double index = std::min(std::floor(s), std::max(last - 1.0, 0.0));
  return { static_cast<std::size_t>(index), s - index };
}

void meanAt(const Prediction& prediction, double t, VectorState& mean)
{
  const Point point = locate(prediction, t);
  const auto& states = prediction.desired_state;
  mean = states[point.index].mean;
  if (point.fraction > 0.0)
    mean += point.fraction * (states[point.index + 1].mean - states[point.index].mean);
}

/// Why a controller of `dof` degrees of freedom cannot use these inputs; empty if it can.
std::string unusable(const Observation& observation, const Prediction& prediction, Eigen::Index dof, bool covariances)
{
  const Eigen::Index n = 2 * dof;
  if (!std::isfinite(observation.t) || !observation.state.allFinite())
    return "the observation is not finite";
  if (observation.state.size() != n)
    return "the observed state has " + std::to_string(observation.state.size()) + " elements, expected " +
           std::to_string(n);
  if (prediction.desired_state.empty() || !std::isfinite(prediction.t0) || !(prediction.dt > 0.0) ||
      !std::isfinite(prediction.dt))
    return "the prediction is empty or its times are not finite and increasing";
  for (std::size_t k = 0; k < prediction.desired_state.size(); ++k)
  {
    const Gaussian& state = prediction.desired_state[k];
    const std::string name = "the predicted state " + std::to_string(k);
    if (state.mean.size() != n)
      return name + " has " + std::to_string(state.mean.size()) + " elements, expected " + std::to_string(n);
    if (!state.mean.allFinite())
      return name + " is not finite";
    if (!covariances)
      continue;
    if (state.covariance.rows() != n || state.covariance.cols() != n)
      return name + " has a covariance of " + std::to_string(state.covariance.rows()) + " x " +
             std::to_string(state.covariance.cols()) + ", expected " + std::to_string(n) + " x " + std::to_string(n);
    if (!state.covariance.allFinite() || state.covariance.diagonal().minCoeff() < 0.0)
      return name + " has a covariance that is not finite or has a negative variance";
  }
  return "";
}

/// Stages that fit into the horizon and into what is left of the prediction at time `t`.
int stageCount(const AssistanceSettings& settings, const Prediction& prediction, double t)
{
  constexpr double kRounding = 1e-6;  // of a stage
  const double end = prediction.t0 + prediction.dt * static_cast<double>(prediction.desired_state.size() - 1);
  const double left = std::floor((end - t) / settings.dt + kRounding);
  const double wanted = std::round(settings.horizon / settings.dt);
  return static_cast<int>(std::clamp(left, 0.0, wanted));
}

const char* const kNoHorizon = "nothing of the prediction is left at the time of the observation";

class NoAssistance : public AssistanceController
{
public:
  NoAssistance(const AssistanceSettings& settings, int source) : settings_(settings), source_(source) {}

  std::optional<FeedbackPolicy> plan(const Observation& observation, const Prediction&) override
  {
    failure_ = std::isfinite(observation.t) ? "" : "the observation is not finite";
    if (!failure_.empty())
      return std::nullopt;
    const Eigen::Index dof = settings_.mass.size();
    const FeedbackPolicy::Stage passive{ MatrixGain::Zero(dof, 2 * dof), VectorState::Zero(2 * dof),
                                         phri_core::VectorDof::Zero(dof) };
    return FeedbackPolicy(observation.t, settings_.horizon, { passive }, source_);
  }

private:
  AssistanceSettings settings_;
  int source_;
};

/// (5.2)
class PdAssistance : public AssistanceController
{
public:
  PdAssistance(const AssistanceSettings& settings, int source) : settings_(settings), source_(source)
  {
    const Eigen::Index dof = settings.mass.size();
    stage_.gain.setZero(dof, 2 * dof);
    stage_.gain.leftCols(dof).diagonal().setConstant(-settings.pd_stiffness);
    stage_.gain.rightCols(dof).diagonal().setConstant(-settings.pd_damping);
    stage_.gain.leftCols(dof).diagonal().tail(settings.rotations).setConstant(-settings.pd_turn_stiffness);
    stage_.gain.rightCols(dof).diagonal().tail(settings.rotations).setConstant(-settings.pd_turn_damping);
    stage_.reference.setZero(2 * dof);
    stage_.feedforward.setZero(dof);
  }

  std::optional<FeedbackPolicy> plan(const Observation& observation, const Prediction& prediction) override
  {
    failure_ = unusable(observation, prediction, settings_.mass.size(), false);
    const int horizon = failure_.empty() ? stageCount(settings_, prediction, observation.t) : 0;
    if (failure_.empty() && horizon == 0)
      failure_ = kNoHorizon;
    if (!failure_.empty())
      return std::nullopt;
    std::vector<FeedbackPolicy::Stage> stages(horizon, stage_);
    for (int k = 0; k < horizon; ++k)
      meanAt(prediction, observation.t + k * settings_.dt + settings_.pd_lookahead, stages[k].reference);
    return FeedbackPolicy(observation.t, settings_.dt, std::move(stages), source_);
  }

private:
  AssistanceSettings settings_;
  int source_;
  FeedbackPolicy::Stage stage_;
};

/// The tracking problem (5.28), (5.29) in the deviation from the reference, e = xi - mu: e+ = A e + B u + d with
/// d_k = A mu_k - mu_{k+1}. Error feedback leaves d out: its gains are the same, its feedforward is 0.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
class Tracking
{
public:
  Tracking(const AssistanceSettings& settings, Eigen::Index dof) : base_(LqStage<N, M>::zero(2 * dof, dof))
  {
    base_.A.setIdentity();
    for (Eigen::Index i = 0; i < dof; ++i)
    {
      base_.A(i, dof + i) = settings.dt;
      base_.A(dof + i, dof + i) -= settings.dt * settings.damping(i) / settings.mass(i);
      base_.B(dof + i, i) = settings.dt / settings.mass(i);
    }
    base_.R.diagonal().setConstant(settings.control_weight);
    problem_.terminal = LqTerminal<N>::zero(2 * dof);
  }

  /// True if the number of stages changed, so that weights and drift are to be set anew.
  bool resize(int horizon)
  {
    if (static_cast<int>(problem_.stages.size()) == horizon)
      return false;
    problem_.stages.assign(horizon, base_);
    return true;
  }

  /// Q_k, k = 0..T; T is the terminal one.
  Eigen::Matrix<double, N, N>& weight(int k)
  {
    return k < static_cast<int>(problem_.stages.size()) ? problem_.stages[k].Q : problem_.terminal.Q;
  }

  void setDrift(int k, const VectorState& reference, const VectorState& next)
  {
    problem_.stages[k].d.noalias() = base_.A.lazyProduct(reference);
    problem_.stages[k].d -= next;
  }

  LqStatus solve() { return phri_control::solve(problem_, solution_); }
  const LqSolution<N, M>& solution() const { return solution_; }

private:
  LqStage<N, M> base_;
  LinearQuadraticProblem<N, M> problem_;
  LqSolution<N, M> solution_;
};

class LqAssistance : public AssistanceController
{
public:
  LqAssistance(const AssistanceSettings& settings, int source, bool mahalanobis)
    : settings_(settings),
      source_(source),
      mahalanobis_(mahalanobis),
      preview_(settings.law == "preview"),
      dof_(settings.mass.size()),
      tracking_(dof_ == 2 ? AnyTracking(Tracking<4, 2>(settings, 2)) : AnyTracking(Tracking<>(settings, dof_)))
  {
    const StateWeights& weights = mahalanobis ? settings.mahalanobis : settings.lqr;
    diagonal_.resize(2 * dof_);
    diagonal_.head(dof_).setConstant(settings.q_scale * weights.position);
    diagonal_.tail(dof_).setConstant(settings.q_scale * weights.velocity);
  }

  std::optional<FeedbackPolicy> plan(const Observation& observation, const Prediction& prediction) override
  {
    failure_ = unusable(observation, prediction, dof_, mahalanobis_);
    const int horizon = failure_.empty() ? stageCount(settings_, prediction, observation.t) : 0;
    if (failure_.empty() && horizon == 0)
      failure_ = kNoHorizon;
    if (!failure_.empty())
      return std::nullopt;
    return std::visit([&](auto& tracking) { return track(tracking, observation.t, horizon, prediction); }, tracking_);
  }

private:
  using AnyTracking = std::variant<Tracking<4, 2>, Tracking<>>;  // planar objects get the fast fixed-size solver

  template <int N, int M>
  std::optional<FeedbackPolicy> track(Tracking<N, M>& tracking, double t, int horizon, const Prediction& prediction)
  {
    const bool resized = tracking.resize(horizon);
    if (mahalanobis_ && !setPredictedWeights(tracking, t, horizon, prediction))
      return std::nullopt;
    if (!mahalanobis_ && resized)
      for (int k = 0; k <= horizon; ++k)
        tracking.weight(k) = diagonal_.asDiagonal();

    std::vector<FeedbackPolicy::Stage> stages(horizon);
    for (int k = 0; k < horizon; ++k)
      meanAt(prediction, t + k * settings_.dt, stages[k].reference);
    if (preview_)
    {
      VectorState last;
      meanAt(prediction, t + horizon * settings_.dt, last);
      for (int k = 0; k < horizon; ++k)
        tracking.setDrift(k, stages[k].reference, k + 1 < horizon ? stages[k + 1].reference : last);
    }

    // without predicted weights and drift the problem depends on nothing but the horizon
    if ((mahalanobis_ || preview_ || resized || !solved_) && !(solved_ = tracking.solve().ok))
    {
      failure_ = "the Riccati recursion broke down at stage " + std::to_string(tracking.solution().status.stage);
      return std::nullopt;
    }
    for (int k = 0; k < horizon; ++k)
    {
      stages[k].gain = tracking.solution().gains[k];
      stages[k].feedforward = tracking.solution().feedforward[k];
    }
    return FeedbackPolicy(t, settings_.dt, std::move(stages), source_);
  }

  /// Qhat of (5.29) at the prediction's own times, interpolated to the stages. False if a covariance is indefinite by
  /// more than rounding (1e-6 of its mean eigenvalue): such a prediction is wrong, not merely singular.
  template <int N, int M>
  bool setPredictedWeights(Tracking<N, M>& tracking, double t, int horizon, const Prediction& prediction)
  {
    const std::size_t first = locate(prediction, t).index;
    std::vector<Eigen::Matrix<double, N, N>> nodes;
    for (int k = 0; k <= horizon; ++k)
    {
      const Point point = locate(prediction, t + k * settings_.dt);
      while (first + nodes.size() <= std::min(point.index + 1, prediction.desired_state.size() - 1))
      {
        const Eigen::MatrixXd& covariance = prediction.desired_state[first + nodes.size()].covariance;
        Eigen::Matrix<double, N, N> shifted = covariance;
        shifted.diagonal().array() += 1e-6 * covariance.diagonal().mean() + settings_.covariance_floor;
        if (!detail::factorise(shifted))
        {
          failure_ = "the covariance of the predicted state " + std::to_string(first + nodes.size()) + " is indefinite";
          return false;
        }
        const Eigen::Matrix<double, N, N> root = phri_core::inverseSquareRoot(covariance, settings_.covariance_floor);
        nodes.push_back(root * diagonal_.asDiagonal() * root);
      }
      const std::size_t i = point.index - first;
      tracking.weight(k) = nodes[i];
      if (point.fraction > 0.0)
        tracking.weight(k) += point.fraction * (nodes[i + 1] - nodes[i]);
    }
    return true;
  }

  AssistanceSettings settings_;
  int source_;
  bool mahalanobis_, preview_;
  Eigen::Index dof_;
  VectorState diagonal_;
  bool solved_ = false;
  AnyTracking tracking_;
};

using Factory = std::unique_ptr<AssistanceController> (*)(const AssistanceSettings&, int source);

const std::vector<std::pair<std::string, Factory>>& catalogue()
{
  static const std::vector<std::pair<std::string, Factory>> entries = {
    { "none",
      [](const AssistanceSettings& s, int id) -> std::unique_ptr<AssistanceController> {
        return std::make_unique<NoAssistance>(s, id);
      } },
    { "lqr",
      [](const AssistanceSettings& s, int id) -> std::unique_ptr<AssistanceController> {
        return std::make_unique<LqAssistance>(s, id, false);
      } },
    { "mahalanobis",
      [](const AssistanceSettings& s, int id) -> std::unique_ptr<AssistanceController> {
        return std::make_unique<LqAssistance>(s, id, true);
      } },
    { "pd",
      [](const AssistanceSettings& s, int id) -> std::unique_ptr<AssistanceController> {
        return std::make_unique<PdAssistance>(s, id);
      } },
  };
  return entries;
}

}  // namespace

bool withinGate(const phri_core::Observation& observation, const phri_core::Prediction& prediction, double gate,
                int rotations)
{
  if (gate <= 0.0 || prediction.desired_state.empty())
    return true;
  const Eigen::VectorXd& start = prediction.desired_state.front().mean;
  const Eigen::Index dof = observation.state.size() / 2;
  const Eigen::Index places = dof - rotations;
  return start.size() != 2 * dof || (start.head(places) - observation.state.head(places)).norm() <= gate;
}

std::unique_ptr<AssistanceController> makeAssistance(const std::string& name, const AssistanceSettings& settings)
{
  requireValid(settings);
  const auto& entries = catalogue();
  for (std::size_t i = 0; i < entries.size(); ++i)
    if (entries[i].first == name)
      return entries[i].second(settings, static_cast<int>(i));
  std::string message = "unknown assistance controller \"" + name + "\": expected one of";
  for (const std::string& known : assistanceNames())
    message += " " + known;
  const std::string meant = phri_core::closest(name, assistanceNames());
  throw std::invalid_argument(message + (meant.empty() ? "" : "; did you mean " + meant + '?'));
}

const std::vector<std::string>& assistanceNames()
{
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const auto& entry : catalogue())
      list.push_back(entry.first);
    return list;
  }();
  return names;
}
}  // namespace phri_control
