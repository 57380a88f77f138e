#pragma once
/// Value of a given policy u_k = L_k xi_k + l_k under risk-sensitive attitudes, and the steps that its optimisation
/// (risk_sensitive.hpp) is made of. Per source s, with noise eps ~ N(0, E E') of that source alone, backward from
/// W = Q_T, w = q_T, c = q0_T:
///
///   V_k(xi) = u-cost + theta^-1 log E exp(theta V_{k+1}(A xi + B u + d + eps)) = 1/2 xi'W xi + w'xi + c
///   Wt = W + theta W E F^-1 E'W,     F = I - theta E'WE                                        (4.25)
///   wt = w + theta W E F^-1 E'w                                                                 (4.26)
///   ct = c + theta/2 w'E F^-1 E'w - 1/(2 theta) log det F;   theta = 0: c + 1/2 tr(E'WE)        (4.27, corrected)
///   with A_L = A + B L and b = B l + d:
///   W <- Q + L'R L + A_L'Wt A_L,   w <- q + L'(R l + r) + A_L'(wt + Wt b)
///   c <- q0 + 1/2 l'R l + r'l + ct + wt'b + 1/2 b'Wt b
///
/// The expectation exists if and only if F is positive definite at every stage ("neurotic breakdown" otherwise), for
/// theta < 0 too, where it fails only if W is indefinite. F is factorised column by column of E, F = C diag(p) C' with
/// unit lower C (Cholesky without roots): for every column e, with what W and w have become,
///   v = W e,   p = 1 - theta e'v > 0,   W += theta/p v v',   w += theta/p (e'w) v,   c += theta/(2 p) (e'w)^2
/// which is the noise taken in one independent component at a time. Nothing of size p x p is stored and no inverse of
/// Sigma is formed, so Sigma may be singular or zero; theta = 0 is the same code without the updates.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "phri_control/attitude.hpp"
#include "phri_control/lq_problem.hpp"
#include "phri_control/lq_solver.hpp"

namespace phri_control
{
template <int N = Eigen::Dynamic>
struct RiskEvaluation
{
  std::vector<QuadraticValue<N>> values;  ///< V of stage 0, one per source; a problem without noise has one, its cost
  RiskStatus status;                      ///< must be looked at: after a breakdown the values mean nothing

  /// The criterion from state x0 of stage 0 on: the mean over the sources.
  double value(const Eigen::Ref<const Eigen::VectorXd>& x0) const
  {
    double sum = 0.0;
    for (const QuadraticValue<N>& marginal : values)
      sum += marginal(x0);
    return sum / static_cast<double>(values.size());
  }
};

namespace detail
{
/// det F over any number of columns as determinant = 1 - theta deficit, which keeps the digits where theta is small.
struct NoiseDeterminant
{
  double value = 1.0, deficit = 0.0;

  void take(double pivot, double variance)
  {
    deficit += value * variance;
    value *= pivot;
  }
  /// -1/(2 theta) log det F; 1/2 tr(E'WE) for theta = 0.
  double constant(double theta) const
  {
    const double x = theta * deficit;
    if (x == 0.0)
      return 0.5 * deficit;
    return -0.5 * deficit * ((std::abs(x) < 0.5 ? std::log1p(-x) : std::log(value)) / x);
  }
};

/// `behind`, of the right size, <- theta^-1 log E exp(theta ahead(. + factor n)), n ~ N(0, I); both may be the same
/// object. False, and `behind` spoiled, unless it exists. Two columns at a time: W is then read and written half as
/// often.
template <int N>
bool throughNoise(double theta, const Eigen::MatrixXd& factor, const QuadraticValue<N>& ahead,
                  QuadraticValue<N>& behind)
{
  using Vector = Eigen::Matrix<double, N, 1>;
  using Column = Eigen::Map<const Vector>;
  const Eigen::Index n = factor.rows(), columns = factor.cols();
  NoiseDeterminant determinant;
  double c = ahead.c;
  Vector v(n), v2(n);
  const QuadraticValue<N>* from = &ahead;
  if (columns == 0 || theta == 0.0)
    behind = ahead;
  for (Eigen::Index column = 0; column < columns; column += 2)
  {
    const Column e(factor.data() + column * n, n);
    v.noalias() = from->W.lazyProduct(e);
    const double variance = e.dot(v), slope = e.dot(from->w), pivot = 1.0 - theta * variance;
    if (!(pivot > 0.0))
      return false;
    determinant.take(pivot, variance);
    const double scale = theta / pivot;
    c += 0.5 * scale * slope * slope;
    if (column + 1 == columns)
    {
      if (theta != 0.0)
      {
        behind.W.noalias() = from->W + v.lazyProduct((scale * v).transpose());
        behind.w = from->w + (scale * slope) * v;
      }
      break;
    }
    const Column e2(factor.data() + (column + 1) * n, n);
    const double shared = scale * e2.dot(v);  // what the first column has made of W and w, seen along the second
    v2.noalias() = from->W.lazyProduct(e2);
    v2 += shared * v;
    const double variance2 = e2.dot(v2), slope2 = e2.dot(from->w) + shared * slope, pivot2 = 1.0 - theta * variance2;
    if (!(pivot2 > 0.0))
      return false;
    determinant.take(pivot2, variance2);
    const double scale2 = theta / pivot2;
    c += 0.5 * scale2 * slope2 * slope2;
    if (theta != 0.0)
    {
      for (Eigen::Index j = 0; j < n; ++j)
        behind.W.col(j) = from->W.col(j) + (scale * v(j)) * v + (scale2 * v2(j)) * v2;
      behind.w = from->w + (scale * slope) * v + (scale2 * slope2) * v2;
      from = &behind;
    }
  }
  behind.c = c + determinant.constant(theta);
  return true;
}

/// The theta at which I - theta E'WE stops being positive definite: 1/lambda_max(E'WE), for a negative theta
/// 1/lambda_min. Allocates for more than 16 states only.
double thetaLimit(const Eigen::Ref<const Eigen::MatrixXd>& W, const Eigen::MatrixXd& factor, bool averse);

/// Why the expectation over the noise of stage k does not exist for the value 1/2 xi'W xi + ..
RiskStatus expectationStatus(const Eigen::Ref<const Eigen::MatrixXd>& W, const Eigen::MatrixXd& factor, double theta,
                             int stage, int source);

/// All `values`, of stage k + 1, through the noise of stage k. `theta(s)` is the attitude to source s.
template <int N, int M, typename Theta>
RiskStatus throughNoise(const LinearQuadraticProblem<N, M>& problem, const Theta& theta, int k,
                        std::vector<QuadraticValue<N>>& values)
{
  for (std::size_t s = 0; s < problem.noise.size(); ++s)
  {
    const Eigen::MatrixXd& factor = problem.noise[s].at(k);
    const Eigen::Matrix<double, N, N> W = values[s].W;
    if (!throughNoise<N>(theta(s), factor, values[s], values[s]))
      return expectationStatus(W, factor, theta(s), k, static_cast<int>(s));
  }
  return {};
}

/// The part of a stage's update that all sources have in common: the policy's closed loop xi+ = A_L xi + b + eps and
/// the cost of the stage under it.
template <int N>
struct ClosedLoop
{
  Eigen::Matrix<double, N, N> A, Q;
  Eigen::Matrix<double, N, 1> b, q;
  double c = 0.0;
};

template <int N, int M>
void close(const LqStage<N, M>& stage, const Eigen::Matrix<double, M, N>& L, const Eigen::Matrix<double, M, 1>& l,
           ClosedLoop<N>& loop)
{
  const Eigen::Matrix<double, M, N> RL = stage.R.lazyProduct(L);
  Eigen::Matrix<double, M, 1> effort = stage.r;
  loop.c = stage.q0 + stage.r.dot(l);
  effort.noalias() += stage.R.lazyProduct(l);
  loop.c += 0.5 * l.dot(effort - stage.r);
  loop.A = stage.A;
  loop.A.noalias() += stage.B.lazyProduct(L);
  loop.b = stage.d;
  loop.b.noalias() += stage.B.lazyProduct(l);
  loop.Q = stage.Q;
  loop.Q.noalias() += L.transpose().lazyProduct(RL);
  loop.q = stage.q;
  loop.q.noalias() += L.transpose().lazyProduct(effort);
}

/// From `value` behind the noise of a stage to the value before the stage.
template <int N>
void throughLoop(const ClosedLoop<N>& loop, QuadraticValue<N>& value)
{
  Eigen::Matrix<double, N, 1> wt = value.w;
  wt.noalias() += value.W.lazyProduct(loop.b);
  value.c += loop.c + 0.5 * loop.b.dot(value.w + wt);
  const Eigen::Matrix<double, N, N> WA = value.W.lazyProduct(loop.A);
  symmetricSum<N>(loop.Q, loop.A, WA, value.W);
  value.w = loop.q;
  value.w.noalias() += loop.A.transpose().lazyProduct(wt);
}

/// The terminal cost as the value of every source; storage is reused.
template <int N, int M>
void startValues(const LinearQuadraticProblem<N, M>& problem, std::vector<QuadraticValue<N>>& values)
{
  values.resize(std::max<std::size_t>(problem.noise.size(), 1));
  for (QuadraticValue<N>& value : values)
  {
    value.W = problem.terminal.Q;
    value.w = problem.terminal.q;
    value.c = problem.terminal.q0;
  }
}

/// Non-finite numbers travel backward: the last stage whose policy has one is where they came in.
template <typename Gains, typename Feedforward>
int firstNonFinite(const Gains& gains, const Feedforward& feedforward)
{
  int stage = static_cast<int>(gains.size()) - 1;
  while (stage > 0 && gains[stage].allFinite() && feedforward[stage].allFinite())
    --stage;
  return stage;
}

template <int N>
bool allFinite(const std::vector<QuadraticValue<N>>& values)
{
  for (const QuadraticValue<N>& value : values)
    if (!value.W.allFinite() || !value.w.allFinite() || !std::isfinite(value.c))
      return false;
  return true;
}
}  // namespace detail

/// Throws std::invalid_argument unless there is one finite theta per source of noise.
template <int N, int M>
void validate(const LinearQuadraticProblem<N, M>& problem, const RiskSensitive& attitude)
{
  validate(problem);
  const std::size_t count = attitude.theta.size();
  if (count != problem.noise.size())
    throw std::invalid_argument("RiskSensitive has " + std::to_string(count) + " thetas, expected " +
                                std::to_string(problem.noise.size()) + ", one per source of noise");
  phri_core::requireFinite("RiskSensitive.theta", Eigen::Map<const Eigen::VectorXd>(attitude.theta.data(), count));
}

/// Into `evaluation`, whose storage is reused: with fixed N, M nothing is allocated. Neither validates nor throws:
/// shapes are the caller's promise. Returns evaluation.status.
template <int N, int M>
RiskStatus evaluate(const LinearQuadraticProblem<N, M>& problem, const RiskSensitive& attitude,
                    const std::vector<Eigen::Matrix<double, M, N>>& gains,
                    const std::vector<Eigen::Matrix<double, M, 1>>& feedforward, RiskEvaluation<N>& evaluation)
{
  const auto theta = [&](std::size_t s) { return attitude.theta[s]; };
  detail::ClosedLoop<N> loop;
  detail::startValues(problem, evaluation.values);
  for (int k = static_cast<int>(problem.horizon()) - 1; k >= 0; --k)
  {
    evaluation.status = detail::throughNoise(problem, theta, k, evaluation.values);
    if (!evaluation.status)
      return evaluation.status;
    detail::close<N, M>(problem.stages[k], gains[k], feedforward[k], loop);
    for (QuadraticValue<N>& value : evaluation.values)
      detail::throughLoop<N>(loop, value);
  }
  if (!detail::allFinite(evaluation.values))
    evaluation.status = { BreakdownKind::NotFinite, detail::firstNonFinite(gains, feedforward), -1, 0.0, 0.0 };
  return evaluation.status;
}

/// Throws std::invalid_argument for shapes and non-finite numbers, RiskBreakdown where the value does not exist.
template <int N, int M>
RiskEvaluation<N> evaluate(const LinearQuadraticProblem<N, M>& problem, const RiskSensitive& attitude,
                           const std::vector<Eigen::Matrix<double, M, N>>& gains,
                           const std::vector<Eigen::Matrix<double, M, 1>>& feedforward)
{
  validate(problem, attitude);
  detail::requirePolicy(problem, gains, feedforward);
  RiskEvaluation<N> evaluation;
  if (!evaluate(problem, attitude, gains, feedforward, evaluation))
    throw RiskBreakdown(evaluation.status);
  return evaluation;
}
}  // namespace phri_control
