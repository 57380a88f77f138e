#pragma once
/// Solution of a `LinearQuadraticProblem` for a weighted sum of K cost cumulants per source of noise (Lemma 4.2). Stage
/// by stage (time-consistent), u_k = L_k xi_k + l_k minimises
///
///   1/S sum_s sum_r gamma_{r,s} kappa_r^s,   r = 1 .. K,   gamma_1 = 1,   kappa_r^s: of J under the noise of s alone
///
/// With (Wt_j, wt_j) the quadratic and linear part of the Taylor coefficients of cumulant_evaluation.hpp behind the
/// noise of the stage, kappa_{j+1} = (j+1)! V_j,
///
///   Wbar = 1/S sum_s sum_r r! gamma_{r,s} Wt_{r-1}^s,   wbar = 1/S sum_s sum_r r! gamma_{r,s} wt_{r-1}^s       (4.36)
///   H = R + B'Wbar B,   L = -H^-1 B'Wbar A,   l = -H^-1 (B'(wbar + Wbar d) + r)
///
/// after which every source goes on with its own coefficients under the common policy. A policy exists if and only if
/// H > 0 at every stage: its Cholesky factorisation is the test. gamma >= 0, Q >= 0, R > 0 suffice: every Wt_j is then
/// positive semi-definite. gamma_r = theta^(r-1)/r! for all r is the risk-sensitive attitude theta, gamma_2 = theta/2
/// its first order.
///
/// Traps: gamma_r has units 1/[J]^(r-1): J -> cJ needs gamma_r -> gamma_r / c^(r-1). With several sources or finite K
/// the stagewise solution is not the global minimum of the criterion at stage 0. lq_solver's value has the noise of all
/// sources together, the criterion the mean of each alone: for K = 1 the same gains and another constant.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "phri_control/cumulant_evaluation.hpp"

namespace phri_control
{
/// What multiplies d^(r-1) Wt / d theta^(r-1) = (r-1)! Wt_{r-1} in Wbar.
enum class CumulantWeighting
{
  Optimal,  ///< r gamma_r: the minimiser (4.36)
  Printed   ///< gamma_r, without the factor r (4.37): for comparison with the figures of the thesis only
};

template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct CumulantSolution
{
  std::vector<Eigen::Matrix<double, M, N>> gains;        ///< L_k (m, n), T of them
  std::vector<Eigen::Matrix<double, M, 1>> feedforward;  ///< l_k (m)
  QuadraticValue<N> value;                               ///< the criterion from a state of stage 0 on
  CumulantValues<N> values;                              ///< kappa_1 .. kappa_K; more of them: `evaluateCumulants`
  RiskStatus status;                                     ///< must be looked at

  /// (S, K), see CumulantValues.
  Eigen::MatrixXd cumulants(const Eigen::Ref<const Eigen::VectorXd>& xi) const { return values.cumulants(xi); }
};

namespace detail
{
/// r! gamma_r / S of every source, r = 1 .. K; the Printed weighting leaves out the factor r.
inline void cumulantWeights(const CostCumulants& attitude, int sources, CumulantWeighting weighting,
                            Eigen::MatrixXd& weights)
{
  const int count = static_cast<int>(attitude.gamma.cols()) + 1;
  weights.setZero(sources, count);
  weights.col(0).setConstant(1.0 / sources);
  for (int s = 0; s < std::min<int>(sources, attitude.gamma.rows()); ++s)
  {
    double factorial = 1.0;
    for (int r = 2; r <= count; ++r)
    {
      factorial *= r;
      weights(s, r - 1) =
          attitude.gamma(s, r - 2) * (weighting == CumulantWeighting::Printed ? factorial / r : factorial) / sources;
    }
  }
}
}  // namespace detail

/// Throws std::invalid_argument unless gamma is finite and has one row per source of noise; any if it has no columns.
template <int N, int M>
void validate(const LinearQuadraticProblem<N, M>& problem, const CostCumulants& attitude)
{
  validate(problem);
  if (attitude.gamma.cols() == 0)
    return;
  if (attitude.gamma.rows() != static_cast<Eigen::Index>(problem.noise.size()))
    throw std::invalid_argument("CostCumulants.gamma has " + std::to_string(attitude.gamma.rows()) +
                                " rows, expected " + std::to_string(problem.noise.size()) +
                                ", one per source of noise");
  phri_core::requireFinite("CostCumulants.gamma", attitude.gamma);
}

/// Into `solution`, whose storage and scratch are reused: with fixed N, M and a solution that already served a problem
/// of the same T, S, K nothing is allocated. Neither validates nor throws (but for memory): shapes and one row of gamma
/// per source are the caller's promise (see `validate`). Returns solution.status.
template <int N, int M>
RiskStatus solve(const LinearQuadraticProblem<N, M>& problem, const CostCumulants& attitude,
                 CumulantSolution<N, M>& solution, CumulantWeighting weighting = CumulantWeighting::Optimal)
{
  const Eigen::Index n = problem.stateSize(), m = problem.controlSize();
  const int count = static_cast<int>(attitude.gamma.cols()) + 1;
  const int sources = std::max(1, static_cast<int>(problem.noise.size()));
  CumulantValues<N>& values = solution.values;
  Eigen::MatrixXd& weights = values.scratch.weights;
  solution.gains.resize(problem.horizon());
  solution.feedforward.resize(problem.horizon());
  solution.status = {};
  detail::cumulantWeights(attitude, sources, weighting, weights);

  QuadraticValue<N>& mean = solution.value;  // of the weighted coefficients
  Eigen::Matrix<double, N, M> WB(n, m);
  Eigen::Matrix<double, M, M> H(m, m);
  const auto average = [&]() {
    mean.W.setZero(n, n);
    mean.w.setZero(n);
    mean.c = 0.0;
    for (int s = 0; s < sources; ++s)
      for (int j = 0; j < count; ++j)
      {
        const QuadraticValue<N>& V = values.series[s * count + j];
        mean.W += weights(s, j) * V.W;
        mean.w += weights(s, j) * V.w;
        mean.c += weights(s, j) * V.c;
      }
  };
  const auto policy = [&](int k) {
    const LqStage<N, M>& stage = problem.stages[k];
    Eigen::Matrix<double, M, N>& L = solution.gains[k];
    Eigen::Matrix<double, M, 1>& l = solution.feedforward[k];
    average();
    mean.w.noalias() += mean.W.lazyProduct(stage.d);
    WB.noalias() = mean.W.lazyProduct(stage.B);
    H = stage.R;
    H.noalias() += stage.B.transpose().lazyProduct(WB);
    L.noalias() = WB.transpose().lazyProduct(stage.A);
    l = stage.r;
    l.noalias() += stage.B.transpose().lazyProduct(mean.w);
    if (!detail::factorise(H))
    {
      const bool finite = H.allFinite() && mean.W.allFinite();
      solution.status = { finite ? BreakdownKind::Hessian : BreakdownKind::NotFinite, k, -1, 0.0, 0.0 };
      return false;
    }
    detail::solveNegative(H, L);
    detail::solveNegative(H, l);
    return true;
  };
  if (detail::sweepCumulants(problem, count, solution.gains, solution.feedforward, values, policy) >= 0)
    return solution.status;
  if (!detail::allFinite(values.series))
  {
    const int stage = detail::firstNonFinite(solution.gains, solution.feedforward);
    solution.status = { BreakdownKind::NotFinite, stage, -1, 0.0, 0.0 };
    return solution.status;
  }
  detail::cumulantWeights(attitude, sources, CumulantWeighting::Optimal, weights);
  average();
  if (!mean.W.allFinite() || !mean.w.allFinite() || !std::isfinite(mean.c))
    solution.status = { BreakdownKind::NotFinite, 0, -1, 0.0, 0.0 };  // the weighted sum alone overflows
  return solution.status;
}

/// Throws std::invalid_argument (see `validate`), and RiskBreakdown where there is no policy.
template <int N, int M>
CumulantSolution<N, M> solve(const LinearQuadraticProblem<N, M>& problem, const CostCumulants& attitude,
                             CumulantWeighting weighting = CumulantWeighting::Optimal)
{
  validate(problem, attitude);
  CumulantSolution<N, M> solution;
  if (!solve(problem, attitude, solution, weighting))
    throw RiskBreakdown(solution.status);
  return solution;
}
}  // namespace phri_control
