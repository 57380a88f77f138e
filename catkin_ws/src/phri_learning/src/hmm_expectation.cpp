#include "phri_learning/hmm_expectation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace phri_learning
{
namespace
{
constexpr double kNegligible = -36.0;  // log of a probability lost against 1 in double precision
constexpr double kSmallest = -700.0;   // log of what counts as 0: e^-708 is the smallest normal number
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kLeastTransition = 1e-6;  // keeps every state reachable and every state leavable
constexpr double kEmpty = 1e-12;           // [samples] of responsibility that count as none

struct Posterior
{
  Eigen::MatrixXd gamma;       // (S, T)
  Eigen::VectorXd stay, next;  // (S) expected transitions; the last of `next` stays 0
  double log_likelihood = 0.0;
};

/// One step of the forward recursion (S), not yet divided by its sum.
inline void forward(const double* before, const double* stay, const double* next, const double* b, Eigen::Index states,
                    double* now)
{
  now[0] = before[0] * stay[0] * b[0];
  for (Eigen::Index i = 1; i < states; ++i)
    now[i] = (before[i] * stay[i] + before[i - 1] * next[i - 1]) * b[i];
}

/// Forward-backward in probabilities, those of every sample divided by their sum. What is lost because it is smaller
/// than e^-700 of the rest could grow again, at most by what the remaining sums amount to; false if that could matter.
bool scaledPosterior(const TimeHmm& hmm, const Eigen::MatrixXd& emission, Posterior* result)
{
  constexpr double kLargestLoss = 550.0;   // less than -kSmallest: e^-100 of the likelihood is lost
  constexpr double kLogarithmDue = 1e-20;  // of the product of sums: one logarithm for many samples, e^-46 at most late
  const Eigen::Index states = hmm.states(), samples = emission.cols(), moves = states - 1;
  const Eigen::RowVectorXd top = emission.colwise().maxCoeff();
  if (!top.allFinite())
    return false;
  Eigen::ArrayXXd b = emission.rowwise() - top;
  b = (b < kSmallest).select(0.0, b.exp());  // one by one: most are far below, and no exp is computed for them
  const Eigen::ArrayXd stay = hmm.parameters().transition.diagonal();
  const Eigen::ArrayXd next = hmm.parameters().transition.diagonal(1);
  Eigen::ArrayXXd alpha(states, samples);
  Eigen::ArrayXd scale(samples), beta = Eigen::ArrayXd::Ones(states), ahead(states);
  alpha.col(0) = hmm.parameters().initial.array() * b.col(0);
  double loss = 0.0, product = 1.0;
  for (Eigen::Index t = 0; t < samples; ++t)
  {
    double* now = alpha.col(t).data();
    if (t > 0)
      forward(alpha.col(t - 1).data(), stay.data(), next.data(), b.col(t).data(), states, now);
    const double sum = alpha.col(t).sum();
    product *= sum;
    if (!(product > kLogarithmDue && product < 1.0 / kLogarithmDue) || t + 1 == samples)
    {
      loss -= std::log(product);
      product = 1.0;
    }
    if (!(sum > 0.0) || !(loss < kLargestLoss))
      return false;
    scale(t) = 1.0 / sum;
    alpha.col(t) *= scale(t);
  }
  result->log_likelihood = top.sum() - loss;
  result->stay = result->next = Eigen::VectorXd::Zero(states);
  result->gamma.resize(states, samples);
  result->gamma.col(samples - 1) = alpha.col(samples - 1);
  for (Eigen::Index t = samples - 1; t-- > 0;)
  {
    ahead = b.col(t + 1) * beta * scale(t + 1);
    const double *now = alpha.col(t).data(), *then = ahead.data();
    double *stayed = result->stay.data(), *left = result->next.data(), *gamma = result->gamma.col(t).data();
    for (Eigen::Index i = 0; i < moves; ++i)
    {
      stayed[i] += now[i] * then[i];
      left[i] += now[i] * then[i + 1];
      beta[i] = stay[i] * then[i] + next[i] * then[i + 1];
      gamma[i] = now[i] * beta[i];
    }
    stayed[moves] += now[moves] * then[moves];
    beta[moves] = stay[moves] * then[moves];
    gamma[moves] = now[moves] * beta[moves];
  }
  result->stay.array() *= stay;
  result->next.head(moves).array() *= next;
  return true;
}

/// The same in logarithms: several times slower, but one sample may favour a state by e^1000.
void logPosterior(const TimeHmm& hmm, const Eigen::MatrixXd& emission, Posterior* result)
{
  const Eigen::Index states = hmm.states(), samples = emission.cols();
  const Eigen::VectorXd &stay = hmm.logStay(), &next = hmm.logNext();
  Eigen::MatrixXd alpha(states, samples), beta(states, samples);
  alpha.col(0) = hmm.logStart(Start::kBeginning) + emission.col(0);
  for (Eigen::Index t = 1; t < samples; ++t)
    for (Eigen::Index i = 0; i < states; ++i)
      alpha(i, t) =
          emission(i, t) + logAdd(alpha(i, t - 1) + stay(i), i > 0 ? alpha(i - 1, t - 1) + next(i - 1) : -kInfinity);
  beta.col(samples - 1).setZero();
  for (Eigen::Index t = samples - 1; t-- > 0;)
    for (Eigen::Index i = 0; i < states; ++i)
      beta(i, t) = logAdd(stay(i) + emission(i, t + 1) + beta(i, t + 1),
                          i + 1 < states ? next(i) + emission(i + 1, t + 1) + beta(i + 1, t + 1) : -kInfinity);
  double likelihood = alpha(0, samples - 1);
  for (Eigen::Index i = 1; i < states; ++i)
    likelihood = logAdd(likelihood, alpha(i, samples - 1));
  result->log_likelihood = likelihood;
  const Eigen::ArrayXXd log_gamma = (alpha + beta).array() - likelihood;
  result->gamma = (log_gamma > kSmallest).select(log_gamma.exp(), 0.0);  // Eigen's exp(-inf) is e^-708, not 0
  result->stay = result->next = Eigen::VectorXd::Zero(states);
  for (Eigen::Index t = 0; t + 1 < samples; ++t)
    for (Eigen::Index i = 0; i < states; ++i)
    {
      const double at = alpha(i, t) - likelihood;
      if (!(at > -kInfinity))
        continue;
      result->stay(i) += std::exp(at + stay(i) + emission(i, t + 1) + beta(i, t + 1));
      if (i + 1 < states)
        result->next(i) += std::exp(at + next(i) + emission(i + 1, t + 1) + beta(i + 1, t + 1));
    }
}

/// Log-density of every state from those of its components (S K, T).
Eigen::MatrixXd stateEmissions(const Eigen::MatrixXd& component, int components)
{
  if (components == 1)
    return component;
  Eigen::MatrixXd emission(component.rows() / components, component.cols());
  for (Eigen::Index t = 0; t < emission.cols(); ++t)
    for (Eigen::Index i = 0; i < emission.rows(); ++i)
    {
      double total = component(i * components, t);
      for (int k = 1; k < components; ++k)
        total = logAdd(total, component(i * components + k, t));
      emission(i, t) = total;
    }
  return emission;
}

void expect(const TimeHmm& hmm, const Eigen::MatrixXd& x, Numerics numerics, Expectation* sums)
{
  const int components = hmm.components();
  const Eigen::Index samples = x.rows(), d = x.cols();
  const Eigen::MatrixXd component = hmm.logComponents(x);
  const Eigen::MatrixXd emission = stateEmissions(component, components);
  Posterior posterior;
  if (numerics == Numerics::kLogarithms || !scaledPosterior(hmm, emission, &posterior))
    logPosterior(hmm, emission, &posterior);
  sums->log_likelihood += posterior.log_likelihood;
  sums->stay += posterior.stay;
  sums->next += posterior.next;
  sums->start += posterior.gamma.col(0);

  // per component the sums of 1, t, t^2, x, t x and the lower half of x x', with t about the middle: more digits
  const Eigen::Index first_x = 3, first_tx = 3 + d, first_xx = 3 + 2 * d;
  const double middle = 0.5 * static_cast<double>(samples - 1), negligible = std::exp(kNegligible);
  Eigen::VectorXd moment(first_xx + d * (d + 1) / 2);
  Eigen::MatrixXd moments = Eigen::MatrixXd::Zero(moment.size(), component.rows());
  for (Eigen::Index t = 0; t < samples; ++t)
  {
    const double time = static_cast<double>(t) - middle;
    moment.head(3) << 1.0, time, time * time;
    moment.segment(first_x, d) = x.row(t);
    moment.segment(first_tx, d) = time * moment.segment(first_x, d);
    double* product = moment.data() + first_xx;  // plain loops: pieces this short cost Eigen more to set up
    for (const double* first = moment.data() + first_x; first < moment.data() + first_tx; ++first)
      for (const double* second = first; second < moment.data() + first_tx; ++second)
        *product++ = *first * *second;
    for (Eigen::Index i = 0; i < emission.rows(); ++i)
    {
      const double gamma = posterior.gamma(i, t);
      if (!(gamma > negligible))
        continue;
      for (Eigen::Index c = i * components; c < (i + 1) * components; ++c)
        moments.col(c) +=
            components == 1 ? gamma * moment : gamma * std::exp(component(c, t) - emission(i, t)) * moment;
    }
  }
  for (Eigen::Index c = 0; c < component.rows(); ++c)
  {
    const auto sum = moments.col(c);
    const double n = sum(0);
    if (!(n > 0.0))
      continue;
    const double own_mean = sum(1) / n;  // mu_t^e about the middle, in samples
    const double dt = hmm.dt(), mean = (own_mean + middle) * dt;
    sums->n(c) += n;
    sums->t(c) += n * mean;
    sums->demo_tt(c) += n * mean * mean;
    sums->within_tt(c) += std::max(0.0, sum(2) - own_mean * sum(1)) * dt * dt;
    sums->x.row(c) += sum.segment(first_x, d);
    sums->within_tx.row(c) += (sum.segment(first_tx, d) - own_mean * sum.segment(first_x, d)) * dt;
    Eigen::MatrixXd& xx = sums->xx[static_cast<std::size_t>(c)];
    for (Eigen::Index j = 0, at = first_xx; j < d; at += d - j, ++j)
    {
      xx.col(j).tail(d - j) += sum.segment(at, d - j);
      xx.row(j).tail(d - j - 1) += sum.segment(at + 1, d - j - 1).transpose();
    }
  }
}
}  // namespace

Expectation expectation(const TimeHmm& model, const std::vector<Eigen::MatrixXd>& demonstrations, Numerics numerics)
{
  const Eigen::Index states = model.states(), count = states * model.components(), d = model.dimension();
  Expectation sums;
  sums.stay = sums.next = sums.start = Eigen::VectorXd::Zero(states);
  sums.n = sums.t = sums.within_tt = sums.demo_tt = Eigen::VectorXd::Zero(count);
  sums.x = sums.within_tx = Eigen::MatrixXd::Zero(count, d);
  sums.xx.assign(static_cast<std::size_t>(count), Eigen::MatrixXd::Zero(d, d));
  for (const Eigen::MatrixXd& x : demonstrations)
    expect(model, x, numerics, &sums);
  return sums;
}

void maximize(const Expectation& sums, const Eigen::MatrixXd& pooled, double strength, TimeHmmParameters* p)
{
  const Eigen::Index states = p->transition.rows(), components = p->weights.cols();
  p->initial = sums.start / sums.start.sum();
  for (Eigen::Index i = 0; i < states; ++i)
  {
    const double left = sums.stay(i) + sums.next(i);
    if (i + 1 < states && left > 0.0)
    {
      const double next = std::min(std::max(sums.next(i) / left, kLeastTransition), 1.0 - kLeastTransition);
      p->transition(i, i) = 1.0 - next;
      p->transition(i, i + 1) = next;
    }
    const double occupancy = sums.n.segment(i * components, components).sum();
    for (Eigen::Index k = 0; k < components; ++k)
    {
      const Eigen::Index c = i * components + k;
      const double n = sums.n(c);
      if (!(n > kEmpty))
        continue;
      p->weights(i, k) = n / occupancy;
      p->mean_s.row(c) = sums.x.row(c) / n;
      const Eigen::MatrixXd own =
          sums.xx[static_cast<std::size_t>(c)] / n - p->mean_s.row(c).transpose() * p->mean_s.row(c);
      p->ss[static_cast<std::size_t>(c)] =
          withEigenvalueFloor(strength > 0.0 ? ((n * own + strength * pooled) / (n + strength)).eval() : own, p->scale,
                              p->covariance_floor);
    }
    if (occupancy > kEmpty)
      p->weights.row(i) /= p->weights.row(i).sum();
  }
}

}  // namespace phri_learning
