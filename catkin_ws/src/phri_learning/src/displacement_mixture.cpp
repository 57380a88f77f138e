#include "phri_learning/displacement_mixture.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "phri_core/check.hpp"
#include "phri_learning/behavior_models.hpp"

namespace phri_learning
{
namespace
{
constexpr double kMemory = 0.5;       // [s] over which an expert is judged
constexpr double kScaleMemory = 1.0;  // [s] over which its scale is
constexpr double kScalePrior = 4.0;   // independent errors that say the scale is 1
constexpr double kPerHorizon = 1.5;   // independent errors per horizon
constexpr double kEvidence = 2.0;     // weight of the demonstrations' say, in independent errors
constexpr double kTails = 6.0;        // degrees of freedom of Student's t
constexpr double kWorst = 100.0;      // most that one error counts, in expected squared errors
constexpr double kIrrelevant = 1e-4;  // state probability
constexpr double kPresent = 1e-6;     // covariance of the present sample, of that one step ahead

std::shared_ptr<const DisplacementRegression> required(std::shared_ptr<const DisplacementRegression> model)
{
  if (!model)
    throw std::invalid_argument("model: none given, expected a trained DisplacementRegression");
  return model;
}
}  // namespace

DisplacementMixture::DisplacementMixture(std::shared_ptr<const DisplacementRegression> model)
  : model_(required(std::move(model))),
    history_(model_->axes, model_->dimension, model_->dt, model_->lags),
    filter_(model_->recogniser),
    phi_(model_->features()),
    motion_(2 * model_->axes),
    local_(model_->dimension),
    deviation_(model_->dimension),
    widening_(model_->dimension),
    block_(model_->axes, model_->axes)
{
  const Eigen::Index d = model_->dimension;
  step_ = { Eigen::VectorXd::Zero(d), Eigen::MatrixXd::Zero(d, d) };
  expert_.fill({ Eigen::VectorXd::Zero(d), Eigen::MatrixXd::Zero(d, d) });
  for (std::size_t j = 0; j < kNodes; ++j)
  {
    nodes_[j] = std::max(1, static_cast<int>(std::lround(model_->steps * (j + 1.0) / kNodes)));
    Pending empty;
    empty.mean.fill(Eigen::VectorXd::Zero(d));
    empty.covariance.fill(Eigen::MatrixXd::Zero(d, d));
    pending_[j].assign(static_cast<std::size_t>(nodes_[j]), empty);
    for (Belief& belief : belief_[j])
      belief.errors = Eigen::VectorXd::Zero(model_->blocks());
  }
}

void DisplacementMixture::reset()
{
  samples_ = 0;
  filter_.reset();
  for (auto& node : belief_)
    for (Belief& belief : node)
    {
      belief.log_weight = 0.0;
      belief.errors.setZero();
      belief.samples = 0.0;
    }
}

void DisplacementMixture::observe(const Eigen::Ref<const Eigen::VectorXd>& y)
{
  take(y, nullptr);
}

void DisplacementMixture::observe(const Eigen::Ref<const Eigen::VectorXd>& y,
                                  const Eigen::Ref<const Eigen::VectorXd>& velocity)
{
  if (velocity.size() != model_->axes || !velocity.allFinite())
  {
    phri_core::requireShape("velocity", velocity, model_->axes, 1);
    phri_core::requireFinite("velocity", velocity);
  }
  take(y, &velocity);
}

void DisplacementMixture::take(const Eigen::Ref<const Eigen::VectorXd>& y,
                               const Eigen::Ref<const Eigen::VectorXd>* velocity)
{
  if (y.size() != model_->dimension || !y.allFinite())
  {
    phri_core::requireShape("sample", y, model_->dimension, 1);
    phri_core::requireFinite("sample", y);
  }
  if (samples_ > 0)
    history_.push(y);
  else if (velocity != nullptr)
    history_.start(y, *velocity);
  else
    history_.start(y);
  history_.motion(motion_);
  filter_.observe(motion_);
  history_.features(phi_);
  phi_ = (phi_ - model_->center).cwiseQuotient(model_->scale);
  settle();
  for (std::size_t j = 0; j < kNodes; ++j)
  {
    predictExperts(nodes_[j]);
    Pending& slot = pending_[j][static_cast<std::size_t>(samples_ % nodes_[j])];
    for (std::size_t m = 0; m < kExperts; ++m)
    {
      slot.mean[m] = expert_[m].mean + history_.now();
      slot.covariance[m] = expert_[m].covariance;
    }
  }
  ++samples_;
}

/// Judges the forecasts whose time has come by the sample just taken.
void DisplacementMixture::settle()
{
  const double forget = std::exp(-model_->dt / kMemory), forget_scale = std::exp(-model_->dt / kScaleMemory);
  const int n = model_->axes;
  for (std::size_t j = 0; j < kNodes; ++j)
  {
    if (samples_ < nodes_[j])
      continue;
    const double share = std::min(1.0, kPerHorizon / nodes_[j]);
    const Pending& due = pending_[j][static_cast<std::size_t>(samples_ % nodes_[j])];
    for (std::size_t m = 0; m < kExperts; ++m)
    {
      Belief& belief = belief_[j][m];
      const double scale_now = scale(static_cast<int>(j), static_cast<int>(m), 0);
      deviation_ = history_.now() - due.mean[m];
      for (int b = 0; b < model_->blocks(); ++b)
      {
        block_ = due.covariance[m].block(b * n, b * n, n, n);
        Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(block_);
        auto e = deviation_.segment(b * n, n);
        factor.matrixL().solveInPlace(e);
        const double square = e.squaredNorm();
        if (b == 0)
        {
          const double log_density = -0.5 * (kTails + n) * std::log1p(square / (scale_now * kTails)) -
                                     block_.diagonal().array().log().sum() - 0.5 * n * std::log(scale_now);
          belief.log_weight = forget * belief.log_weight + share * log_density;
        }
        belief.errors(b) = forget_scale * belief.errors(b) + share * std::min(square / n, kWorst);
      }
      belief.samples = forget_scale * belief.samples + share;
    }
  }
}

/// The change expected k samples ahead by both experts, into expert_.
void DisplacementMixture::predictExperts(int k)
{
  const DisplacementRegression& r = *model_;
  const std::size_t at = static_cast<std::size_t>(k - 1), first = at * static_cast<std::size_t>(r.states());
  const Eigen::VectorXd& probability = filter_.probability();
  Expert &base = expert_[0], &local = expert_[1];
  for (int b = 0; b < r.blocks(); ++b)
    for (int a = 0; a < r.axes; ++a)
    {
      double change = 0.0;
      for (int c = 0; c < (b == 0 ? 3 : 5); ++c)
        change += r.base[at](b, c) * history_.basis(b, a, c);
      base.mean(b * r.axes + a) = change;
    }
  base.covariance.setZero();
  local.mean.setZero();
  local.covariance.setZero();
  double total = 0.0;
  for (Eigen::Index i = 0; i < probability.size(); ++i)
    total += probability(i) > kIrrelevant ? probability(i) : 0.0;
  for (Eigen::Index i = 0; i < probability.size(); ++i)
  {
    if (!(probability(i) > kIrrelevant))
      continue;
    const std::size_t entry = first + static_cast<std::size_t>(i);
    const double p = probability(i) / total;
    local_ = r.local[entry].col(0);
    local_.noalias() += r.local[entry].rightCols(phi_.size()) * phi_;
    local.mean += p * local_;
    local.covariance += p * r.local_covariance[entry];
    local.covariance.noalias() += (p * local_) * local_.transpose();
    base.covariance += p * r.base_covariance[entry];
  }
  local.covariance.noalias() -= local.mean * local.mean.transpose();
  local.mean += base.mean;
}

double DisplacementMixture::scale(int node, int expert, int block) const
{
  const Belief& belief = belief_[static_cast<std::size_t>(node)][static_cast<std::size_t>(expert)];
  return std::max(1.0, (kScalePrior + belief.errors(block)) / (kScalePrior + belief.samples));
}

namespace
{
/// Lower node and the share of the one above for k samples ahead.
template <std::size_t N>
std::pair<std::size_t, double> between(const std::array<int, N>& nodes, double k)
{
  std::size_t j = 0;
  while (j + 2 < N && k > nodes[j + 1])
    ++j;
  const double width = std::max(1, nodes[j + 1] - nodes[j]);
  return { j, std::clamp((k - nodes[j]) / width, 0.0, 1.0) };
}
}  // namespace

std::array<double, DisplacementMixture::kExperts> DisplacementMixture::weightsAt(int k) const
{
  const Eigen::Map<const Eigen::VectorXd> evidence(
      model_->evidence.data() + static_cast<Eigen::Index>(k - 1) * model_->states(), model_->states());
  const auto [j, share] = between(nodes_, k);
  const auto difference = [this](std::size_t node) {
    return belief_[node][1].log_weight - belief_[node][0].log_weight;
  };
  const double odds = (1.0 - share) * difference(j) + share * difference(j + 1) + kEvidence * evidence.dot(states());
  const double local = 1.0 / (1.0 + std::exp(-odds));
  return { 1.0 - local, local };
}

std::array<double, DisplacementMixture::kExperts> DisplacementMixture::weights(double horizon) const
{
  return weightsAt(std::clamp(static_cast<int>(std::lround(horizon / model_->dt)), 1, model_->steps));
}

void DisplacementMixture::mixAt(int k, phri_core::Gaussian* result)
{
  predictExperts(k);
  const std::array<double, kExperts> weight = weightsAt(k);
  const auto [j, share] = between(nodes_, k);
  result->mean = weight[0] * expert_[0].mean + weight[1] * expert_[1].mean;
  result->covariance.setZero(model_->dimension, model_->dimension);
  for (std::size_t m = 0; m < kExperts; ++m)
  {
    const int expert = static_cast<int>(m), node = static_cast<int>(j);
    for (int b = 0; b < model_->blocks(); ++b)
      widening_.segment(b * model_->axes, model_->axes)
          .setConstant(std::sqrt((1.0 - share) * scale(node, expert, b) + share * scale(node + 1, expert, b)));
    deviation_ = expert_[m].mean - result->mean;
    for (Eigen::Index c = 0; c < deviation_.size(); ++c)
      for (Eigen::Index i = 0; i < deviation_.size(); ++i)
        result->covariance(i, c) +=
            weight[m] * (widening_(i) * widening_(c) * expert_[m].covariance(i, c) + deviation_(i) * deviation_(c));
  }
  result->mean += history_.now();
}

void DisplacementMixture::forecast(double horizon, phri_core::Gaussian* result)
{
  if (!started())
    throw std::invalid_argument("forecast: no sample observed yet, expected at least 1");
  const double farthest = model_->steps * model_->dt;
  phri_core::requireRange("horizon", horizon, 0.0, farthest * (1.0 + 1e-9), "s");
  const double k = std::min(horizon / model_->dt, static_cast<double>(model_->steps));
  const int below = std::min(static_cast<int>(k + 1e-9), model_->steps), above = std::min(below + 1, model_->steps);
  const double share = std::max(0.0, k - below);
  mixAt(std::max(below, 1), result);
  if (below == 0)
  {
    result->mean = history_.now();
    result->covariance *= kPresent;
  }
  if (share > 1e-9 && above > below)
  {
    mixAt(above, &step_);
    result->mean += share * (step_.mean - result->mean);
    result->covariance += share * (step_.covariance - result->covariance);
  }
  for (Eigen::Index c = 0; c < result->mean.size(); ++c)
    for (Eigen::Index i = 0; i < c; ++i)
      result->covariance(c, i) = result->covariance(i, c) = 0.5 * (result->covariance(i, c) + result->covariance(c, i));
}

DisplacementModel::DisplacementModel(std::shared_ptr<const DisplacementRegression> model) : mixture_(std::move(model))
{
  const DisplacementRegression& r = mixture_.model();
  if (r.dimension != 3 * r.axes)
    throw std::invalid_argument("model has " + std::to_string(r.dimension) + " dimensions, expected " +
                                std::to_string(3 * r.axes) + " ([x; xdot; u_h] of " + std::to_string(r.axes) +
                                " degrees of freedom)");
}

void DisplacementModel::observe(const phri_core::Observation& observation)
{
  const int dof = mixture_.model().axes;
  const Eigen::VectorXd row = observationVector(observation, dof);
  mixture_.observe(row, row.segment(dof, dof));
  t_ = observation.t;
}

std::optional<phri_core::Prediction> DisplacementModel::predict(double horizon, double dt)
{
  phri_core::requireRange("dt", dt, 1e-6, 1e3, "s");
  phri_core::requireRange("horizon", horizon, 0.0, mixture_.model().steps * mixture_.model().dt * (1.0 + 1e-9), "s");
  if (!mixture_.started())
    return std::nullopt;
  const int steps = static_cast<int>(std::lround(horizon / dt)), dof = mixture_.model().axes;
  phri_core::Prediction prediction;
  prediction.t0 = t_;
  prediction.dt = dt;
  prediction.model = "displacement";
  for (int k = 0; k <= steps; ++k)
  {
    mixture_.forecast(std::min(k * dt, horizon), &joint_);
    prediction.desired_state.push_back(
        { joint_.mean.head(2 * dof), joint_.covariance.topLeftCorner(2 * dof, 2 * dof) });
    prediction.human_wrench.push_back({ joint_.mean.tail(dof), joint_.covariance.bottomRightCorner(dof, dof) });
  }
  return prediction;
}
}  // namespace phri_learning
