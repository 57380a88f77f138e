#pragma once
/// Mean, variance and risk-sensitive value of a given policy u_k = L_k xi_k + l_k under multiplicative noise, and the
/// backward pass that its optimisation shares. What is exact and what is an expansion is said in
/// multiplicative_noise.hpp, how in multiplicative_stage.hpp.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "phri_control/attitude.hpp"
#include "phri_control/multiplicative_problem.hpp"
#include "phri_control/multiplicative_stage.hpp"

namespace phri_control
{
namespace detail
{
template <int N, int M>
struct MultiplicativeScratch
{
  std::vector<ChannelScratch<N, M>> channels;                   // per source
  std::vector<StageQuadratic<kJoint<N, M>>> values, variances;  // of the stage, per source
  std::vector<QuadraticValue<N>> ahead;                         // behind the additive noise: value, variance
  StageQuadratic<kJoint<N, M>> mean;                            // of the criterion over the sources
  Eigen::Matrix<double, M, M> H;
};
}  // namespace detail

/// Of a policy, as functions of the state of stage 0.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct MultiplicativeEvaluation
{
  std::vector<QuadraticValue<N>> values;     ///< per source: E_s J, or the risk-sensitive value; E J has one
  std::vector<QuadraticValue<N>> variances;  ///< per source: Var_s J to second order; of CostCumulants only
  std::vector<double> gamma;                 ///< per variance
  RiskStatus status;                         ///< must be looked at
  detail::MultiplicativeScratch<N, M> scratch;

  /// The criterion from state x0 of stage 0 on.
  double value(const Eigen::Ref<const Eigen::VectorXd>& x0) const
  {
    double sum = 0.0;
    for (const QuadraticValue<N>& marginal : values)
      sum += marginal(x0);
    for (std::size_t s = 0; s < variances.size(); ++s)
      sum += gamma[s] * variances[s](x0);
    return sum / static_cast<double>(values.size());
  }
};

namespace detail
{
void requireAttitude(const CostCumulants& attitude, std::size_t sources);
void requireAttitude(const RiskSensitive& attitude, std::size_t sources);

/// What a sweep is about: the expected cost if neither is given.
struct Criterion
{
  const RiskSensitive* risk = nullptr;
  const CostCumulants* cumulants = nullptr;

  bool together() const { return !risk && !cumulants; }
  double theta(std::size_t s) const { return risk ? risk->theta[s] : 0.0; }
  double gamma(std::size_t s) const { return cumulants && cumulants->gamma.cols() ? cumulants->gamma(s, 0) : 0.0; }
};

/// Channels of the sources first .. last - 1, at the expansion point of stage k.
template <int N, int M>
void loadStage(const MultiplicativeNoiseProblem<N, M>& problem, const ExpansionPoints<N, M>& points, int k,
               std::size_t first, std::size_t last, ChannelScratch<N, M>& s)
{
  const LqStage<N, M>& stage = problem.lq.stages[k];
  const Eigen::Index n = stage.A.rows(), m = stage.B.cols();
  const std::size_t additive = problem.lq.noise.size();
  Eigen::Index count = 0;
  for (std::size_t i = std::max(first, additive); i < last; ++i)
    count += problem.noise[i - additive].channels.size();
  s.resize(n, m, count);
  s.center.setZero();
  if (!points.states.empty())
  {
    s.center.head(Eigen::fix<N>(n)) = points.states[k];
    s.center.tail(Eigen::fix<M>(m)) = points.controls[k];
  }
  s.joint.template leftCols<N>(n) = stage.A;
  s.joint.template rightCols<M>(m) = stage.B;
  s.y = stage.d;
  s.y.noalias() += s.joint.lazyProduct(s.center);
  Eigen::Index j = 0;
  for (std::size_t i = std::max(first, additive); i < last; ++i)
    for (const NoiseChannel& channel : problem.noise[i - additive].channels)
    {
      s.G[j] = channel.at(k).leftCols(n + m);
      s.c.col(j) = channel.at(k).col(n + m);
      s.c.col(j).noalias() += s.G[j].lazyProduct(s.center);
      ++j;
    }
}

/// Value and variance of one group of sources, first .. last - 1, before stage k and as functions of (xi, u).
template <int N, int M>
RiskStatus throughStage(const MultiplicativeNoiseProblem<N, M>& problem, const Criterion& criterion,
                        const ExpansionPoints<N, M>& points, int k, std::size_t group, std::size_t first,
                        std::size_t last, MultiplicativeEvaluation<N, M>& evaluation)
{
  MultiplicativeScratch<N, M>& scratch = evaluation.scratch;
  ChannelScratch<N, M>& channels = scratch.channels[group];
  QuadraticValue<N>&value = scratch.ahead[0], &variance = scratch.ahead[1];
  const double theta = criterion.theta(group);
  const auto breakdown = [&](const Eigen::MatrixXd& factor) {
    return expectationStatus(evaluation.values[group].W, factor, theta, k, static_cast<int>(group));
  };
  value = evaluation.values[group];
  if (criterion.cumulants)
    variance = evaluation.variances[group];
  for (std::size_t i = first; i < std::min(last, problem.lq.noise.size()); ++i)
  {
    const Eigen::MatrixXd& factor = problem.lq.noise[i].at(k);
    if (criterion.cumulants)
      throughAdditiveNoise<N>(factor, value, variance);
    else if (!throughNoise<N>(theta, factor, value, value))
      return breakdown(factor);
  }
  loadStage(problem, points, k, first, last, channels);
  if (criterion.cumulants)
    expect(0.0, variance, channels, scratch.variances[group]);
  if (!expect(theta, value, channels, scratch.values[group]))
    return breakdown(channels.c);
  if (criterion.cumulants)
  {
    addVariance(channels, scratch.variances[group]);
    scratch.variances[group].recenter(channels.center);
  }
  StageQuadratic<kJoint<N, M>>& cost = scratch.values[group];
  cost.recenter(channels.center);
  const LqStage<N, M>& stage = problem.lq.stages[k];
  const Eigen::Index n = stage.A.rows(), m = stage.B.cols();
  cost.H.template topLeftCorner<N, N>(n, n) += stage.Q;
  cost.H.template bottomRightCorner<M, M>(m, m) += stage.R;
  cost.h.head(Eigen::fix<N>(n)) += stage.q;
  cost.h.tail(Eigen::fix<M>(m)) += stage.r;
  cost.c += stage.q0;
  return {};
}

/// Backward pass; `policy(k)` fills gains[k] and feedforward[k] from scratch.mean, or returns false.
template <int N, int M, typename Gains, typename Feedforward, typename Policy>
RiskStatus sweepMultiplicative(const MultiplicativeNoiseProblem<N, M>& problem, const Criterion& criterion,
                               const ExpansionPoints<N, M>& points, const Gains& gains, const Feedforward& feedforward,
                               MultiplicativeEvaluation<N, M>& evaluation, const Policy& policy)
{
  const std::size_t sources = problem.sources();
  const std::size_t groups = criterion.together() ? 1 : std::max<std::size_t>(1, sources);
  const Eigen::Index n = problem.lq.stateSize();
  MultiplicativeScratch<N, M>& scratch = evaluation.scratch;
  evaluation.values.resize(groups);
  evaluation.variances.resize(criterion.cumulants ? groups : 0);
  evaluation.gamma.resize(evaluation.variances.size());
  scratch.channels.resize(groups);
  scratch.values.resize(groups);
  scratch.variances.resize(groups);
  scratch.ahead.resize(2);
  for (QuadraticValue<N>& value : evaluation.values)
    value = { problem.lq.terminal.Q, problem.lq.terminal.q, problem.lq.terminal.q0 };
  for (std::size_t s = 0; s < evaluation.variances.size(); ++s)
  {
    evaluation.variances[s].W.setZero(n, n);
    evaluation.variances[s].w.setZero(n);
    evaluation.variances[s].c = 0.0;
    evaluation.gamma[s] = sources ? criterion.gamma(s) : 0.0;
  }
  for (int k = static_cast<int>(problem.lq.horizon()) - 1; k >= 0; --k)
  {
    for (std::size_t s = 0; s < groups; ++s)
    {
      const std::size_t last = criterion.together() ? sources : std::min(s + 1, sources);
      evaluation.status = throughStage(problem, criterion, points, k, s, s, last, evaluation);
      if (!evaluation.status)
        return evaluation.status;
    }
    if (!policy(k))
    {
      const bool finite = scratch.mean.H.allFinite();
      return evaluation.status = { finite ? BreakdownKind::Hessian : BreakdownKind::NotFinite, k, -1, 0.0, 0.0 };
    }
    for (std::size_t s = 0; s < groups; ++s)
    {
      close<N, M>(scratch.values[s], gains[k], feedforward[k], evaluation.values[s]);
      if (criterion.cumulants)
        close<N, M>(scratch.variances[s], gains[k], feedforward[k], evaluation.variances[s]);
    }
  }
  if (!allFinite(evaluation.values) || !allFinite(evaluation.variances))
    evaluation.status = { BreakdownKind::NotFinite, firstNonFinite(gains, feedforward), -1, 0.0, 0.0 };
  return evaluation.status;
}

template <int N, int M>
MultiplicativeEvaluation<N, M> evaluateOrThrow(const MultiplicativeNoiseProblem<N, M>& problem,
                                               const Criterion& criterion, const ExpansionPoints<N, M>& points,
                                               const std::vector<Eigen::Matrix<double, M, N>>& gains,
                                               const std::vector<Eigen::Matrix<double, M, 1>>& feedforward)
{
  requirePolicy(problem.lq, gains, feedforward);
  MultiplicativeEvaluation<N, M> evaluation;
  const auto keep = [](int) { return true; };
  if (!sweepMultiplicative(problem, criterion, points, gains, feedforward, evaluation, keep))
    throw RiskBreakdown(evaluation.status);
  return evaluation;
}
}  // namespace detail

/// Any affine policy; throw as `solve` does. The expected cost is exact, the others are as documented above.
template <int N, int M>
MultiplicativeEvaluation<N, M> evaluate(const MultiplicativeNoiseProblem<N, M>& problem,
                                        const std::vector<Eigen::Matrix<double, M, N>>& gains,
                                        const std::vector<Eigen::Matrix<double, M, 1>>& feedforward)
{
  validate(problem);
  return detail::evaluateOrThrow<N, M>(problem, {}, {}, gains, feedforward);
}
template <int N, int M>
MultiplicativeEvaluation<N, M> evaluate(const MultiplicativeNoiseProblem<N, M>& problem, const RiskSensitive& attitude,
                                        const std::vector<Eigen::Matrix<double, M, N>>& gains,
                                        const std::vector<Eigen::Matrix<double, M, 1>>& feedforward,
                                        const ExpansionPoints<N, M>& points = {})
{
  validate(problem, points);
  detail::requireAttitude(attitude, problem.sources());
  return detail::evaluateOrThrow<N, M>(problem, { &attitude, nullptr }, points, gains, feedforward);
}
template <int N, int M>
MultiplicativeEvaluation<N, M> evaluate(const MultiplicativeNoiseProblem<N, M>& problem, const CostCumulants& attitude,
                                        const std::vector<Eigen::Matrix<double, M, N>>& gains,
                                        const std::vector<Eigen::Matrix<double, M, 1>>& feedforward,
                                        const ExpansionPoints<N, M>& points = {})
{
  validate(problem, points);
  detail::requireAttitude(attitude, problem.sources());
  return detail::evaluateOrThrow<N, M>(problem, { nullptr, &attitude }, points, gains, feedforward);
}

/// The mean trajectory of a policy from x0: where its variance is best expanded. Solving again about it, a few times,
/// makes the linear part of the policy consistent with the noise that its own feedforward makes.
template <int N, int M>
ExpansionPoints<N, M> expandAlong(const MultiplicativeNoiseProblem<N, M>& problem,
                                  const std::vector<Eigen::Matrix<double, M, N>>& gains,
                                  const std::vector<Eigen::Matrix<double, M, 1>>& feedforward,
                                  const Eigen::Matrix<double, N, 1>& x0)
{
  detail::requirePolicy(problem.lq, gains, feedforward);
  phri_core::requireShape("x0", x0, problem.lq.stateSize(), 1);
  ExpansionPoints<N, M> points;
  Eigen::Matrix<double, N, 1> xi = x0;
  for (std::size_t k = 0; k < problem.lq.horizon(); ++k)
  {
    const LqStage<N, M>& stage = problem.lq.stages[k];
    points.states.push_back(xi);
    points.controls.push_back(gains[k] * xi + feedforward[k]);
    xi = (stage.A * xi + stage.B * points.controls[k] + stage.d).eval();
  }
  return points;
}
}  // namespace phri_control
