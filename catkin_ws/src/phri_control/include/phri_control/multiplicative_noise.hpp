#pragma once
/// Linear-quadratic control under noise whose size depends on the state and on the control. To the problem of
/// lq_problem.hpp, its additive sources included, come sources s of channels j with w_j ~ N(0, 1), all independent:
///
///   xi+ = A xi + B u + d + sum_j (C_j xi + D_j u + e_j) w_j,         J and policies u = L xi + l as in lq_problem.hpp
///
/// so Sigma_s(xi, u) = sum_j c_j c_j', c_j = C_j xi + D_j u + e_j. Three criteria, minimised stage by stage:
///
/// `solve(problem)`: E J with the noise of all sources acting together. Exact: V_k is quadratic, with
///   H = R + B'W B + sum_j D_j'W D_j and so on, and the policy is the best of all policies.
/// `CostCumulants` with K = 2 (no columns: gamma = 0): mean over the sources of E_s J + gamma_s Var_s J. E_s J is
///   exact. Var_k(xi) = E[Var_{k+1}(x+)] + Var[V_{k+1}(x+)] is quartic in xi; it is kept as its Taylor polynomial of
///   second order in (xi, u), with exact coefficients, at an expansion point per stage. Hence: exact for additive
///   noise; over one stage exact at the point with an error of third order in the distance from it; over several
///   stages an error of third order in the distance and the standard deviation of the state together (the cubic and
///   quartic terms left out act through the noise of the earlier stages too).
/// `RiskSensitive`: mean over the sources of theta_s^-1 log E_s exp(theta_s J), the same expansion of the exact
///   one-stage value. It must exist at the expansion points: I - theta E'WE > 0, else BreakdownKind::Expectation. To
///   first order in theta it is the mean-variance criterion with gamma = theta/2.
///
/// Traps. For theta > 0 and noise that depends on the state, the true E exp(theta J) is infinite over two stages or
/// more, however small theta: a Gaussian state reaches any noise level. What is solved for is the expansion. Noise that
/// is purely multiplicative (c_j = 0 at the points) with no gradient of the cost there has no variance to second order:
/// mean-variance then is risk-neutral. `CostCumulants` and `RiskSensitive` see every source alone and weigh it by 1/S,
/// which for multiplicative noise changes the gains: channels that act together belong into one source. A policy exists
/// only if H > 0 at every stage; the second-order variance may be indefinite, so gamma > 0 does not ensure it.
///
/// Sources are counted with the additive ones of `lq` first. multiplicative_stage.hpp has the derivation.

#include <Eigen/Core>
#include <algorithm>
#include <vector>

#include "phri_control/multiplicative_evaluation.hpp"

namespace phri_control
{
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct MultiplicativeSolution : MultiplicativeEvaluation<N, M>
{
  std::vector<Eigen::Matrix<double, M, N>> gains;        ///< L_k (m, n), T of them
  std::vector<Eigen::Matrix<double, M, 1>> feedforward;  ///< l_k (m)
};

namespace detail
{
template <int N, int M>
RiskStatus solveMultiplicative(const MultiplicativeNoiseProblem<N, M>& problem, const Criterion& criterion,
                               const ExpansionPoints<N, M>& points, MultiplicativeSolution<N, M>& solution)
{
  const Eigen::Index n = problem.lq.stateSize(), m = problem.lq.controlSize();
  solution.gains.resize(problem.lq.horizon());
  solution.feedforward.resize(problem.lq.horizon());
  MultiplicativeScratch<N, M>& scratch = solution.scratch;
  const auto policy = [&](int k) {
    auto& mean = scratch.mean;
    const double share = 1.0 / static_cast<double>(solution.values.size());
    mean.H.setZero(n + m, n + m);
    mean.h.setZero(n + m);
    for (std::size_t s = 0; s < solution.values.size(); ++s)
    {
      mean.H += share * scratch.values[s].H;
      mean.h += share * scratch.values[s].h;
      if (criterion.cumulants)
      {
        mean.H += share * solution.gamma[s] * scratch.variances[s].H;
        mean.h += share * solution.gamma[s] * scratch.variances[s].h;
      }
    }
    Eigen::Matrix<double, M, N>& L = solution.gains[k];
    Eigen::Matrix<double, M, 1>& l = solution.feedforward[k];
    scratch.H = mean.H.template bottomRightCorner<M, M>(m, m);
    L = mean.H.template bottomLeftCorner<M, N>(m, n);
    l = mean.h.tail(Eigen::fix<M>(m));
    if (!factorise(scratch.H))
      return false;
    solveNegative(scratch.H, L);
    solveNegative(scratch.H, l);
    return true;
  };
  return sweepMultiplicative(problem, criterion, points, solution.gains, solution.feedforward, solution, policy);
}

template <int N, int M>
MultiplicativeSolution<N, M> solveOrThrow(const MultiplicativeNoiseProblem<N, M>& problem, const Criterion& criterion,
                                          const ExpansionPoints<N, M>& points)
{
  MultiplicativeSolution<N, M> solution;
  if (!solveMultiplicative(problem, criterion, points, solution))
    throw RiskBreakdown(solution.status);
  return solution;
}
}  // namespace detail

/// Into `solution`, whose storage is reused: with fixed N, M and a solution that already served a problem of the same
/// horizon, sources and channels nothing is allocated, after a breakdown either. Neither validates nor throws (but for
/// memory): shapes, one theta or one row of one or no gamma per source are the caller's promise.
template <int N, int M>
RiskStatus solve(const MultiplicativeNoiseProblem<N, M>& problem, MultiplicativeSolution<N, M>& solution)
{
  return detail::solveMultiplicative(problem, {}, {}, solution);
}
template <int N, int M>
RiskStatus solve(const MultiplicativeNoiseProblem<N, M>& problem, const RiskSensitive& attitude,
                 MultiplicativeSolution<N, M>& solution, const ExpansionPoints<N, M>& points = {})
{
  return detail::solveMultiplicative(problem, { &attitude, nullptr }, points, solution);
}
template <int N, int M>
RiskStatus solve(const MultiplicativeNoiseProblem<N, M>& problem, const CostCumulants& attitude,
                 MultiplicativeSolution<N, M>& solution, const ExpansionPoints<N, M>& points = {})
{
  return detail::solveMultiplicative(problem, { nullptr, &attitude }, points, solution);
}

/// Throw std::invalid_argument (see `validate`; K > 2 too), and RiskBreakdown where there is no policy.
template <int N, int M>
MultiplicativeSolution<N, M> solve(const MultiplicativeNoiseProblem<N, M>& problem)
{
  validate(problem);
  return detail::solveOrThrow<N, M>(problem, {}, {});
}
template <int N, int M>
MultiplicativeSolution<N, M> solve(const MultiplicativeNoiseProblem<N, M>& problem, const RiskSensitive& attitude,
                                   const ExpansionPoints<N, M>& points = {})
{
  validate(problem, points);
  detail::requireAttitude(attitude, problem.sources());
  return detail::solveOrThrow<N, M>(problem, { &attitude, nullptr }, points);
}
template <int N, int M>
MultiplicativeSolution<N, M> solve(const MultiplicativeNoiseProblem<N, M>& problem, const CostCumulants& attitude,
                                   const ExpansionPoints<N, M>& points = {})
{
  validate(problem, points);
  detail::requireAttitude(attitude, problem.sources());
  return detail::solveOrThrow<N, M>(problem, { nullptr, &attitude }, points);
}
}  // namespace phri_control
