// Emissions, likelihood and Viterbi of TimeHmm: the inner loops of everything that recognises or trains.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "phri_core/check.hpp"
#include "phri_learning/time_hmm.hpp"

namespace phri_learning
{
namespace
{
using Lanes = Eigen::Array<double, TimeHmm::kLanes, 1>;

double logSumExp(const double* values, int count)
{
  const double top = *std::max_element(values, values + count);
  if (!std::isfinite(top))
    return top;
  double sum = 0.0;
  for (int k = 0; k < count; ++k)
    sum += std::exp(values[k] - top);
  return top + std::log(sum);
}

/// out(c) = log_norm(c) - |W_c x - m_c|^2 / 2 of all components, kLanes of them at once; `packed` as
/// TimeHmm::whitening_. D: dimension, 0 if known at run time only.
template <int D>
void logDensities(const Eigen::MatrixXd& packed, const Eigen::VectorXd& log_norm, const double* x, Eigen::Index d,
                  double* out)
{
  const Eigen::Index dimension = D > 0 ? D : d, count = log_norm.size();
  for (Eigen::Index c = 0; c < count; c += TimeHmm::kLanes)
  {
    const double* w = packed.col(c / TimeHmm::kLanes).data();
    Lanes sum = Lanes::Zero();
    for (Eigen::Index i = 0; i < dimension; ++i)
    {
      Lanes y = Eigen::Map<const Lanes>(w);
      w += TimeHmm::kLanes;
      for (Eigen::Index j = 0; j <= i; ++j, w += TimeHmm::kLanes)
        y += Eigen::Map<const Lanes>(w) * x[j];
      sum += y * y;
    }
    if (c + TimeHmm::kLanes <= count)
      Eigen::Map<Lanes>(out + c) = Eigen::Map<const Lanes>(log_norm.data() + c) - 0.5 * sum;
    else
      for (Eigen::Index k = c; k < count; ++k)
        out[k] = log_norm(k) - 0.5 * sum(k - c);
  }
}

void logDensities(const Eigen::MatrixXd& packed, const Eigen::VectorXd& log_norm, const double* x, Eigen::Index d,
                  double* out)
{
  switch (d)  // position, motion, and motion with force in up to three axes, and what the recordings have
  {
    case 2:
      return logDensities<2>(packed, log_norm, x, d, out);
    case 3:
      return logDensities<3>(packed, log_norm, x, d, out);
    case 4:
      return logDensities<4>(packed, log_norm, x, d, out);
    case 6:
      return logDensities<6>(packed, log_norm, x, d, out);
    case 7:
      return logDensities<7>(packed, log_norm, x, d, out);
    default:
      return logDensities<0>(packed, log_norm, x, d, out);
  }
}
}  // namespace

void TimeHmm::logComponent(const Eigen::Ref<const Eigen::VectorXd>& x, Scratch* scratch) const
{
  scratch->other = x - center_;
  logDensities(whitening_, log_norm_, scratch->other.data(), dimension_, scratch->component.data());
}

void TimeHmm::logEmission(const Eigen::Ref<const Eigen::VectorXd>& x, Scratch* scratch,
                          Eigen::Ref<Eigen::VectorXd> out) const
{
  logComponent(x, scratch);
  const double* component = scratch->component.data();
  for (int i = 0; i < states_; ++i, component += components_)
    out(i) = components_ == 1 ? *component : logSumExp(component, components_);
}

Eigen::MatrixXd TimeHmm::logComponents(const Eigen::Ref<const Eigen::MatrixXd>& x) const
{
  requireSamples(x);
  Eigen::MatrixXd result(log_norm_.size(), x.rows());
  Eigen::VectorXd centered(dimension_);
  for (Eigen::Index t = 0; t < x.rows(); ++t)
  {
    centered = x.row(t).transpose() - center_;
    logDensities(whitening_, log_norm_, centered.data(), dimension_, result.col(t).data());
  }
  return result;
}

Eigen::VectorXd TimeHmm::logStart(Start start) const
{
  if (start == Start::kAnywhere)
    return Eigen::VectorXd::Constant(states_, -std::log(static_cast<double>(states_)));
  return parameters_.initial.array().log();
}

double TimeHmm::score(const Eigen::Ref<const Eigen::MatrixXd>& x, Start start) const
{
  requireSamples(x);
  Scratch work = scratch();
  Eigen::VectorXd sample(dimension_), emission(states_), alpha = logStart(start);
  for (Eigen::Index t = 0; t < x.rows(); ++t)
  {
    sample = x.row(t).transpose();
    logEmission(sample, &work, emission);
    if (t > 0)
      for (int i = states_ - 1; i >= 0; --i)
        alpha(i) = i > 0 ? logAdd(alpha(i) + log_stay_(i), alpha(i - 1) + log_next_(i - 1)) : alpha(i) + log_stay_(i);
    alpha += emission;
  }
  return logSumExp(alpha.data(), states_);
}

std::vector<int> TimeHmm::viterbi(const Eigen::Ref<const Eigen::MatrixXd>& x, Start start) const
{
  requireSamples(x);
  Scratch work = scratch();
  Eigen::VectorXd sample(dimension_), emission(states_), best = logStart(start);
  std::vector<char> entered(static_cast<std::size_t>(x.rows()) * states_, 0);
  for (Eigen::Index t = 0; t < x.rows(); ++t)
  {
    sample = x.row(t).transpose();
    logEmission(sample, &work, emission);
    if (t > 0)
      for (int i = states_ - 1; i >= 0; --i)
      {
        const double stay = best(i) + log_stay_(i);
        const double next = i > 0 ? best(i - 1) + log_next_(i - 1) : -std::numeric_limits<double>::infinity();
        entered[static_cast<std::size_t>(t) * states_ + i] = next > stay;
        best(i) = std::max(stay, next);
      }
    best += emission;
  }
  std::vector<int> path(static_cast<std::size_t>(x.rows()));
  Eigen::Index last = 0;
  best.maxCoeff(&last);
  int state = static_cast<int>(last);
  for (std::size_t t = path.size(); t-- > 0;)
  {
    path[t] = state;
    state -= entered[t * states_ + state];
  }
  return path;
}

void TimeHmm::requireSamples(const Eigen::Ref<const Eigen::MatrixXd>& x) const
{
  if (x.rows() < 1 || x.cols() != dimension_)
    throw std::invalid_argument("samples have the shape (" + std::to_string(x.rows()) + ", " +
                                std::to_string(x.cols()) + "), expected (at least 1, " + std::to_string(dimension_) +
                                ")");
  phri_core::requireFinite("samples", x);
}

Eigen::MatrixXd sample(const TimeHmm& model, int samples, phri_core::Random* random)
{
  phri_core::requireRange("samples", samples, 1, 1e7, "");
  const TimeHmmParameters& p = model.parameters();
  const auto draw = [random](const Eigen::VectorXd& probabilities) {
    double rest = random->uniform();
    Eigen::Index i = 0;
    while (i + 1 < probabilities.size() && rest >= probabilities(i))
      rest -= probabilities(i++);
    return i;
  };
  Eigen::MatrixXd x(samples, model.dimension());
  Eigen::VectorXd noise(model.dimension());
  Eigen::Index state = draw(p.initial);
  for (Eigen::Index t = 0; t < samples; ++t)
  {
    if (t > 0 && state + 1 < model.states())
      state += random->uniform() < p.transition(state, state + 1);
    const Eigen::Index c = state * model.components() + draw(p.weights.row(state));
    for (Eigen::Index j = 0; j < noise.size(); ++j)
      noise(j) = random->normal();
    const Eigen::MatrixXd factor = p.ss[static_cast<std::size_t>(c)].llt().matrixL();
    x.row(t) = p.mean_s.row(c) + (factor * noise).transpose();
  }
  return x;
}
}  // namespace phri_learning
