#include "phri_learning/hmm_expectation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace phri_learning
{
namespace
{
constexpr double kNegligible = -36.0;  // log of a probability lost against 1 in double precision
constexpr double kInfinity = std::numeric_limits<double>::infinity();

void expect(const TimeHmm& hmm, const Eigen::MatrixXd& x, Expectation* sums)
{
  const int states = hmm.states(), components = hmm.components();
  const Eigen::Index samples = x.rows();
  const Eigen::MatrixXd component = hmm.logComponents(x);
  Eigen::MatrixXd emission(states, samples), alpha(states, samples), beta(states, samples);
  for (Eigen::Index t = 0; t < samples; ++t)
    for (int i = 0; i < states; ++i)
    {
      double total = component(static_cast<Eigen::Index>(i) * components, t);
      for (int k = 1; k < components; ++k)
        total = logAdd(total, component(static_cast<Eigen::Index>(i) * components + k, t));
      emission(i, t) = total;
    }
  const Eigen::VectorXd &stay = hmm.logStay(), &next = hmm.logNext();
  alpha.col(0) = hmm.logStart(Start::kBeginning) + emission.col(0);
  for (Eigen::Index t = 1; t < samples; ++t)
    for (int i = 0; i < states; ++i)
      alpha(i, t) =
          emission(i, t) + logAdd(alpha(i, t - 1) + stay(i), i > 0 ? alpha(i - 1, t - 1) + next(i - 1) : -kInfinity);
  beta.col(samples - 1).setZero();
  for (Eigen::Index t = samples - 1; t-- > 0;)
    for (int i = 0; i < states; ++i)
      beta(i, t) = logAdd(stay(i) + emission(i, t + 1) + beta(i, t + 1),
                          i + 1 < states ? next(i) + emission(i + 1, t + 1) + beta(i + 1, t + 1) : -kInfinity);
  double likelihood = alpha(0, samples - 1);
  for (int i = 1; i < states; ++i)
    likelihood = logAdd(likelihood, alpha(i, samples - 1));
  sums->log_likelihood += likelihood;

  const Eigen::Index count = component.rows(), d = x.cols();
  Eigen::VectorXd n = Eigen::VectorXd::Zero(count), nt = n, ntt = n;
  Eigen::MatrixXd nx = Eigen::MatrixXd::Zero(count, d), ntx = nx;
  const double middle = 0.5 * static_cast<double>(samples - 1);  // sums of squares about the middle keep more digits
  for (Eigen::Index t = 0; t < samples; ++t)
    for (int i = 0; i < states; ++i)
    {
      const double at = alpha(i, t) - likelihood;
      if (t + 1 < samples && at > -kInfinity)
      {
        sums->stay(i) += std::exp(at + stay(i) + emission(i, t + 1) + beta(i, t + 1));
        if (i + 1 < states)
          sums->next(i) += std::exp(at + next(i) + emission(i + 1, t + 1) + beta(i + 1, t + 1));
      }
      const double log_gamma = at + beta(i, t);
      if (!(log_gamma > kNegligible))
        continue;
      if (t == 0)
        sums->start(i) += std::exp(log_gamma);
      for (int k = 0; k < components; ++k)
      {
        const Eigen::Index c = static_cast<Eigen::Index>(i) * components + k;
        const double gamma = std::exp(log_gamma + component(c, t) - emission(i, t));
        const double time = static_cast<double>(t) - middle;
        n(c) += gamma;
        nt(c) += gamma * time;
        ntt(c) += gamma * time * time;
        nx.row(c) += gamma * x.row(t);
        ntx.row(c) += gamma * time * x.row(t);
        sums->xx[static_cast<std::size_t>(c)].noalias() += gamma * x.row(t).transpose() * x.row(t);
      }
    }
  for (Eigen::Index c = 0; c < count; ++c)
  {
    if (!(n(c) > 0.0))
      continue;
    const double own_mean = nt(c) / n(c);  // mu_t^e about the middle, in samples
    const double dt = hmm.dt(), mean = (own_mean + middle) * dt;
    sums->n(c) += n(c);
    sums->t(c) += n(c) * mean;
    sums->demo_tt(c) += n(c) * mean * mean;
    sums->within_tt(c) += std::max(0.0, ntt(c) - own_mean * nt(c)) * dt * dt;
    sums->x.row(c) += nx.row(c);
    sums->within_tx.row(c) += (ntx.row(c) - own_mean * nx.row(c)) * dt;
  }
}
}  // namespace

Expectation expectation(const TimeHmm& model, const std::vector<Eigen::MatrixXd>& demonstrations)
{
  const Eigen::Index states = model.states(), count = states * model.components(), d = model.dimension();
  Expectation sums;
  sums.stay = sums.next = sums.start = Eigen::VectorXd::Zero(states);
  sums.n = sums.t = sums.within_tt = sums.demo_tt = Eigen::VectorXd::Zero(count);
  sums.x = sums.within_tx = Eigen::MatrixXd::Zero(count, d);
  sums.xx.assign(static_cast<std::size_t>(count), Eigen::MatrixXd::Zero(d, d));
  for (const Eigen::MatrixXd& x : demonstrations)
    expect(model, x, &sums);
  return sums;
}
}  // namespace phri_learning
