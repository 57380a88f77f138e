#pragma once
/// Cumulants kappa_r of the cost J under a given policy u_k = L_k xi_k + l_k, per source of noise, and the steps that
/// their optimisation (cost_cumulants.hpp) is made of. They are the theta-derivatives of the risk-sensitive value,
/// V(theta) = sum_r theta^(r-1)/r! kappa_r, so a source carries the Taylor coefficients of V at theta = 0,
///
///   V_j(xi) = 1/2 xi'W_j xi + w_j'xi + c_j,   j = 0 .. K-1,   kappa_r = r! V_{r-1}
///
/// (the thesis writes derivatives, W^[j] = j! W_j, with binomials in the sums). Backward from the terminal cost in V_0
/// and 0 in the others; the noise of stage k is taken in one column e of its factor after the other, as independent
/// components; sums over i = 0 .. j-1, empty for j = 0:
///
///   v_j = W_j e,   y_j = e'v_j,   g_j = e'w_j
///   u_j = v_j + sum u_i y_{j-1-i},   a_j = g_j + sum a_i y_{j-1-i},   h_j = (j+1) y_j + sum h_i y_{j-1-i}
///   W_j += sum u_i v_{j-1-i}',   w_j += sum u_i g_{j-1-i},   c_j += 1/2 sum a_i g_{j-1-i} + h_j / (2 (j+1))
///
/// which is (4.32)-(4.34), the latter corrected, for Sigma = sum e e'. Then, with F = A + B L and b = B l + d,
///
///   W_j <- F'W_j F,   w_j <- F'(w_j + W_j b),   c_j <- c_j + w_j'b + 1/2 b'W_j b,   + the stage's cost if j = 0
///
/// The cumulants always exist. They are those of J under the noise of one source alone; a problem without noise counts
/// as one source of zero noise.

#include <Eigen/Core>
#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "phri_control/risk_evaluation.hpp"

namespace phri_control
{
namespace detail
{
/// What the recursion needs within one column of noise, kept so that the next solve allocates nothing.
template <int N>
struct CumulantScratch
{
  Eigen::Matrix<double, N, Eigen::Dynamic> v, u;
  Eigen::VectorXd y, g, a, h;
  Eigen::MatrixXd weights;  // (S, K) of Wt_j in Wbar
};
}  // namespace detail

/// Cumulants of J under one policy as functions of the state of stage 0.
template <int N = Eigen::Dynamic>
struct CumulantValues
{
  int sources = 0;                        ///< S, at least 1
  int count = 0;                          ///< K
  std::vector<QuadraticValue<N>> series;  ///< Taylor coefficient V_j of source s at [s K + j]
  detail::CumulantScratch<N> scratch = {};

  /// (S, K): kappa_1 [J], kappa_2 [J^2], .. of every source from state xi.
  Eigen::MatrixXd cumulants(const Eigen::Ref<const Eigen::VectorXd>& xi) const
  {
    Eigen::MatrixXd kappa(sources, count);
    for (int s = 0; s < sources; ++s)
    {
      double factorial = 1.0;
      for (int j = 0; j < count; ++j)
      {
        factorial *= j + 1;
        kappa(s, j) = factorial * series[s * count + j](xi);
      }
    }
    return kappa;
  }
};

namespace detail
{
/// Taylor coefficients V[0] .. V[count-1] of theta -> theta^-1 log E exp(theta V(. + factor n)), n ~ N(0, I), in place.
template <int N>
void seriesThroughNoise(const Eigen::MatrixXd& factor, QuadraticValue<N>* V, int count, CumulantScratch<N>& scratch)
{
  const Eigen::Index n = factor.rows();
  auto& [v, u, y, g, a, h, weights] = scratch;
  for (Eigen::Index column = 0; column < factor.cols(); ++column)
  {
    const Eigen::Map<const Eigen::Matrix<double, N, 1>> e(factor.data() + column * n, n);
    for (int j = 0; j < count; ++j)
    {
      v.col(j).noalias() = V[j].W.lazyProduct(e);
      u.col(j) = v.col(j);
      y(j) = e.dot(v.col(j));
      a(j) = g(j) = e.dot(V[j].w);
      h(j) = (j + 1) * y(j);
      for (int i = 0; i < j; ++i)
      {
        u.col(j) += y(j - 1 - i) * u.col(i);
        a(j) += y(j - 1 - i) * a(i);
        h(j) += y(j - 1 - i) * h(i);
      }
      V[j].c += h(j) / (2.0 * (j + 1));
    }
    for (int j = 1; j < count; ++j)
    {
      for (Eigen::Index col = 0; col < n; ++col)
      {
        Eigen::Matrix<double, N, 1> sum = V[j].W.col(col);
        for (int i = 0; i < j; ++i)
          sum += v(col, j - 1 - i) * u.col(i);
        V[j].W.col(col) = sum;
      }
      for (int i = 0; i < j; ++i)
      {
        V[j].w += g(j - 1 - i) * u.col(i);
        V[j].c += 0.5 * a(i) * g(j - 1 - i);
      }
    }
  }
}

/// Brings the values of `count` cumulants per source backward over all stages. `policy(k)` sets L and l of stage k from
/// the values behind the noise of stage k, or returns false to end the sweep there. Returns that stage, -1 at the end.
template <int N, int M, typename Policy>
int sweepCumulants(const LinearQuadraticProblem<N, M>& problem, int count,
                   const std::vector<Eigen::Matrix<double, M, N>>& gains,
                   const std::vector<Eigen::Matrix<double, M, 1>>& feedforward, CumulantValues<N>& values,
                   const Policy& policy)
{
  const Eigen::Index n = problem.stateSize();
  values.sources = std::max(1, static_cast<int>(problem.noise.size()));
  values.count = count;
  values.series.resize(values.sources * count);
  CumulantScratch<N>& scratch = values.scratch;
  scratch.v.resize(n, count);
  scratch.u.resize(n, count);
  for (Eigen::VectorXd* vector : { &scratch.y, &scratch.g, &scratch.a, &scratch.h })
    vector->resize(count);

  ClosedLoop<N> loop, costless;  // V_1 .. V_{K-1} have no cost of their own
  costless.Q.setZero(n, n);
  costless.q.setZero(n);
  for (std::size_t i = 0; i < values.series.size(); ++i)
  {
    const bool first = i % count == 0;
    values.series[i].W = first ? problem.terminal.Q : costless.Q;
    values.series[i].w = first ? problem.terminal.q : costless.q;
    values.series[i].c = first ? problem.terminal.q0 : 0.0;
  }
  for (int k = static_cast<int>(problem.horizon()) - 1; k >= 0; --k)
  {
    for (std::size_t s = 0; s < problem.noise.size(); ++s)
      seriesThroughNoise<N>(problem.noise[s].at(k), &values.series[s * count], count, scratch);
    if (!policy(k))
      return k;
    close<N, M>(problem.stages[k], gains[k], feedforward[k], loop);
    costless.A = loop.A;
    costless.b = loop.b;
    for (std::size_t i = 0; i < values.series.size(); ++i)
      throughLoop<N>(i % count == 0 ? loop : costless, values.series[i]);
  }
  return -1;
}
}  // namespace detail

/// The first `count` cumulants of any policy, into `values`, whose storage and scratch are reused. Neither validates
/// nor throws (but for memory); fails on non-finite numbers only.
template <int N, int M>
RiskStatus evaluateCumulants(const LinearQuadraticProblem<N, M>& problem, int count,
                             const std::vector<Eigen::Matrix<double, M, N>>& gains,
                             const std::vector<Eigen::Matrix<double, M, 1>>& feedforward, CumulantValues<N>& values)
{
  detail::sweepCumulants(problem, count, gains, feedforward, values, [](int) { return true; });
  RiskStatus status;
  if (!detail::allFinite(values.series))
    status = { BreakdownKind::NotFinite, detail::firstNonFinite(gains, feedforward), -1, 0.0, 0.0 };
  return status;
}

/// Validates (std::invalid_argument), then evaluates; throws RiskBreakdown when a cumulant is not finite.
template <int N, int M>
CumulantValues<N> evaluateCumulants(const LinearQuadraticProblem<N, M>& problem, int count,
                                    const std::vector<Eigen::Matrix<double, M, N>>& gains,
                                    const std::vector<Eigen::Matrix<double, M, 1>>& feedforward)
{
  validate(problem);
  if (count < 1)
    throw std::invalid_argument("evaluateCumulants: count = " + std::to_string(count) + ", expected at least 1");
  detail::requirePolicy(problem, gains, feedforward);
  CumulantValues<N> values;
  if (const RiskStatus status = evaluateCumulants(problem, count, gains, feedforward, values); !status)
    throw RiskBreakdown(status);
  return values;
}
}  // namespace phri_control
