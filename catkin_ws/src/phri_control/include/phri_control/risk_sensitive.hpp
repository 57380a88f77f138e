#pragma once
/// Risk-sensitive linear-quadratic control with S marginal sources of noise, each with its own theta, under one policy
/// u_k = L_k xi_k + l_k (4.14)-(4.31). Backward; what every source does with its own W_s, w_s, c_s is in
/// risk_evaluation.hpp, and the policy is the one that minimises the mean of the sources' criteria stage by stage:
///
///   Wbar = 1/S sum_s Wt_s,   wbar = 1/S sum_s (wt_s + Wt_s d)                                  (4.31)
///   H = R + B'Wbar B,   L = -H^-1 B'Wbar A,   l = -H^-1 (B'wbar + r)                            (4.30)
///
/// A policy exists if and only if I - theta_s E_s'W_s E_s > 0 for every source and H > 0 at every stage. A source with
/// theta = 0 counts in 1/S; a problem without noise is solved for its cost. For one source this is the global minimum
/// over all policies; for several it is the time-consistent one, which a policy that is allowed to regret may beat.
///
/// Trap: theta is tied to the weights, J -> cJ needs theta -> theta/c; weights are per sample, so theta depends on the
/// sample time too.

#include <Eigen/Core>
#include <vector>

#include "phri_control/risk_evaluation.hpp"

namespace phri_control
{
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct RiskSolution : RiskEvaluation<N>  ///< its values are those of the policy
{
  std::vector<Eigen::Matrix<double, M, N>> gains;        ///< L_k (m, n), T of them
  std::vector<Eigen::Matrix<double, M, 1>> feedforward;  ///< l_k (m)
};

namespace detail
{
/// Mean over the sources of their values behind the noise of a stage, and room for the policy's system of equations.
template <int N, int M>
struct Mean
{
  Eigen::Matrix<double, N, N> W;
  Eigen::Matrix<double, N, 1> w;
  Eigen::Matrix<double, N, M> WB;
  Eigen::Matrix<double, M, M> H;
};

/// The policy that minimises the mean of the values behind the noise; false unless H is positive definite.
template <int N, int M>
bool improve(const LqStage<N, M>& stage, const std::vector<QuadraticValue<N>>& values, Mean<N, M>& mean,
             Eigen::Matrix<double, M, N>& L, Eigen::Matrix<double, M, 1>& l)
{
  const double share = 1.0 / static_cast<double>(values.size());
  mean.W = share * values[0].W;
  mean.w = share * values[0].w;
  for (std::size_t s = 1; s < values.size(); ++s)
  {
    mean.W += share * values[s].W;
    mean.w += share * values[s].w;
  }
  mean.w.noalias() += mean.W.lazyProduct(stage.d);
  mean.WB = mean.W.lazyProduct(stage.B);
  mean.H = stage.R;
  mean.H.noalias() += stage.B.transpose().lazyProduct(mean.WB);
  L = mean.WB.transpose().lazyProduct(stage.A);
  l = stage.r;
  l.noalias() += stage.B.transpose().lazyProduct(mean.w);
  if (!factorise(mean.H))
    return false;
  solveNegative(mean.H, L);
  solveNegative(mean.H, l);
  return true;
}

/// Backward pass for one source: behind its noise the problem is an ordinary one.
template <int N, int M>
RiskStatus solveOneSource(const LinearQuadraticProblem<N, M>& problem, double theta, RiskSolution<N, M>& solution)
{
  QuadraticValue<N> value = solution.values[0], behind = value;
  for (int k = static_cast<int>(problem.horizon()) - 1; k >= 0; --k)
  {
    const Eigen::MatrixXd& factor = problem.noise[0].at(k);
    if (!throughNoise<N>(theta, factor, value, behind))
      return expectationStatus(value.W, factor, theta, k, 0);
    const LqFailure failure =
        optimalStage(problem.stages[k], behind, solution.gains[k], solution.feedforward[k], value);
    if (failure != LqFailure::None)
      return { failure == LqFailure::Hessian ? BreakdownKind::Hessian : BreakdownKind::NotFinite, k, -1, 0.0, 0.0 };
  }
  solution.values[0] = value;
  return {};
}

template <int N, int M, typename Theta>
RiskStatus solveSources(const LinearQuadraticProblem<N, M>& problem, const Theta& theta, RiskSolution<N, M>& solution)
{
  Mean<N, M> mean;
  ClosedLoop<N> loop;
  for (int k = static_cast<int>(problem.horizon()) - 1; k >= 0; --k)
  {
    if (const RiskStatus status = throughNoise(problem, theta, k, solution.values); !status)
      return status;
    if (!improve(problem.stages[k], solution.values, mean, solution.gains[k], solution.feedforward[k]))
    {
      const bool finite = mean.H.allFinite() && mean.W.allFinite();
      return { finite ? BreakdownKind::Hessian : BreakdownKind::NotFinite, k, -1, 0.0, 0.0 };
    }
    close<N, M>(problem.stages[k], solution.gains[k], solution.feedforward[k], loop);
    for (QuadraticValue<N>& value : solution.values)
      throughLoop<N>(loop, value);
  }
  return {};
}

/// Backward pass; `theta(s)` is the attitude to source s.
template <int N, int M, typename Theta>
RiskStatus solveRisk(const LinearQuadraticProblem<N, M>& problem, const Theta& theta, RiskSolution<N, M>& solution)
{
  solution.gains.resize(problem.horizon());
  solution.feedforward.resize(problem.horizon());
  startValues(problem, solution.values);
  solution.status =
      problem.noise.size() == 1 ? solveOneSource(problem, theta(0), solution) : solveSources(problem, theta, solution);
  if (solution.status && !allFinite(solution.values))
    solution.status = { BreakdownKind::NotFinite, firstNonFinite(solution.gains, solution.feedforward), -1, 0.0, 0.0 };
  return solution.status;
}
}  // namespace detail

/// Into `solution`, whose storage is reused: with fixed N, M and a solution that already has T stages nothing is
/// allocated, after a breakdown either. Neither validates nor throws (but for memory): shapes and one theta per source
/// are the caller's promise (see `validate`). Returns solution.status.
template <int N, int M>
RiskStatus solve(const LinearQuadraticProblem<N, M>& problem, const RiskSensitive& attitude,
                 RiskSolution<N, M>& solution)
{
  return detail::solveRisk(
      problem, [&](std::size_t s) { return attitude.theta[s]; }, solution);
}

/// Throws std::invalid_argument (see `validate`), and RiskBreakdown where there is no policy.
template <int N, int M>
RiskSolution<N, M> solve(const LinearQuadraticProblem<N, M>& problem, const RiskSensitive& attitude)
{
  validate(problem, attitude);
  RiskSolution<N, M> solution;
  if (!solve(problem, attitude, solution))
    throw RiskBreakdown(solution.status);
  return solution;
}
}  // namespace phri_control
