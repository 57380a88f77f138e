#pragma once
/// Exact solution of a `LinearQuadraticProblem` for the expected cost (theta = 0 of (4.15)-(4.27)): the policy
/// u_k = L_k xi_k + l_k (the minus sign is inside L) and the value 1/2 xi'W xi + w'xi + c of the first stage.
/// Backward from W = Q_T, w = q_T, c = q0_T; with (W, w, c) of stage k + 1,
///
///   c  = c + 1/2 sum_s tr(W Sigma_s) + w'd + 1/2 d'W d,    wt = w + W d
///   H  = R + B'W B,   G = B'W A,   g = B'wt + r,           L = -H^-1 G,   l = -H^-1 g
///   W <- Q + A'W A + G'L,   w <- q + A'wt + G'l,           c <- q0 + c + 1/2 g'l
///
/// A policy exists if and only if H > 0 at every stage (always for Q >= 0, R > 0): its Cholesky factorisation is the
/// test. Small fixed-size products go through `lazyProduct`: Eigen 3.4 sends them to its blocked kernel otherwise (3 x
/// slower).

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "phri_control/lq_problem.hpp"

namespace phri_control
{
enum class LqFailure
{
  None,
  Hessian,   ///< H is not positive definite: the cost has no minimum over u_k
  NotFinite  ///< a NaN or an infinity in the problem, or overflow
};

/// Must be looked at: the gains of a failed solution are not a policy.
struct LqStatus
{
  bool ok = false;
  LqFailure kind = LqFailure::None;
  int stage = -1;  ///< the first one met going backward without a finite, unique minimum; -1: none

  explicit operator bool() const { return ok; }
};

/// 1/2 xi'W xi + w'xi + c.
template <int N = Eigen::Dynamic>
struct QuadraticValue
{
  Eigen::Matrix<double, N, N> W;
  Eigen::Matrix<double, N, 1> w;
  double c = 0.0;

  double operator()(const Eigen::Ref<const Eigen::VectorXd>& xi) const { return 0.5 * xi.dot(W * xi) + w.dot(xi) + c; }
};

template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct LqSolution
{
  std::vector<Eigen::Matrix<double, M, N>> gains;        ///< L_k (m, n), T of them
  std::vector<Eigen::Matrix<double, M, 1>> feedforward;  ///< l_k (m)
  QuadraticValue<N> value;                               ///< expected cost from a state of stage 0 on
  LqStatus status;
};

namespace detail
{
/// In-place lower Cholesky factor of the lower triangle of `matrix`; false unless positive definite (NaN: false).
template <typename Matrix>
bool factorise(Matrix& matrix)
{
  const Eigen::Index size = matrix.rows();
  for (Eigen::Index j = 0; j < size; ++j)
  {
    double pivot = matrix(j, j);
    for (Eigen::Index i = 0; i < j; ++i)
      pivot -= matrix(j, i) * matrix(j, i);
    if (!(pivot > 0.0) || !std::isfinite(pivot))
      return false;
    const double root = std::sqrt(pivot);
    matrix(j, j) = root;
    for (Eigen::Index row = j + 1; row < size; ++row)
    {
      double sum = matrix(row, j);
      for (Eigen::Index i = 0; i < j; ++i)
        sum -= matrix(row, i) * matrix(j, i);
      matrix(row, j) = sum / root;
    }
  }
  return true;
}

/// rhs <- -(C C')^-1 rhs for the lower factor C of `factorise`.
template <typename Matrix, typename Rhs>
void solveNegative(const Matrix& factor, Rhs& rhs)
{
  const Eigen::Index size = factor.rows();
  for (Eigen::Index j = 0; j < size; ++j)
  {
    const double scale = 1.0 / factor(j, j);
    for (Eigen::Index i = 0; i < j; ++i)
      rhs.row(j) -= factor(j, i) * rhs.row(i);
    rhs.row(j) *= scale;
  }
  for (Eigen::Index j = size - 1; j >= 0; --j)
  {
    const double scale = 1.0 / factor(j, j);
    for (Eigen::Index i = j + 1; i < size; ++i)
      rhs.row(j) -= factor(i, j) * rhs.row(i);
    rhs.row(j) *= scale;
  }
  rhs = -rhs;
}

/// From 8 states on half of a symmetric matrix' off-diagonal part is worth not computing (a fifth of a stage's time).
template <int N>
constexpr bool kByQuarters = N >= 8 && N % 4 == 0;

/// symmetric <- start + A'B, where the sum is known to be symmetric.
template <int N>
void symmetricSum(const Eigen::Matrix<double, N, N>& start, const Eigen::Matrix<double, N, N>& A,
                  const Eigen::Matrix<double, N, N>& B, Eigen::Matrix<double, N, N>& symmetric)
{
  if constexpr (kByQuarters<N>)
  {
    constexpr int H = N / 2;
    Eigen::Matrix<double, N, H> left = start.template leftCols<H>();
    left.noalias() += A.transpose().lazyProduct(B.template leftCols<H>());
    Eigen::Matrix<double, H, H> corner = start.template bottomRightCorner<H, H>();
    corner.noalias() += A.template rightCols<H>().transpose().lazyProduct(B.template rightCols<H>());
    const Eigen::Matrix<double, H, H> top = left.template topRows<H>();
    symmetric.template topLeftCorner<H, H>() = 0.5 * (top + top.transpose());
    symmetric.template bottomLeftCorner<H, H>() = left.template bottomRows<H>();
    symmetric.template topRightCorner<H, H>() = left.template bottomRows<H>().transpose();
    symmetric.template bottomRightCorner<H, H>() = 0.5 * (corner + corner.transpose());
  }
  else
  {
    Eigen::Matrix<double, N, N> sum = start;
    sum.noalias() += A.transpose().lazyProduct(B);
    symmetric = 0.5 * (sum + sum.transpose());
  }
}

/// The best (L, l) of a stage for the value `behind` its noise, and the value `before` the stage under it; both values
/// may be the same object. `before` is untouched unless H is positive definite.
template <int N, int M>
LqFailure optimalStage(const LqStage<N, M>& stage, const QuadraticValue<N>& behind, Eigen::Matrix<double, M, N>& L,
                       Eigen::Matrix<double, M, 1>& l, QuadraticValue<N>& before)
{
  const Eigen::Index n = stage.A.rows(), m = stage.B.cols();
  Eigen::Matrix<double, N, N> WA(n, n), next(n, n);
  Eigen::Matrix<double, N, M> WB(n, m);
  Eigen::Matrix<double, M, M> H(m, m);
  Eigen::Matrix<double, M, N> G(m, n);
  Eigen::Matrix<double, N, 1> wt(n);
  Eigen::Matrix<double, M, 1> g(m);
  wt = behind.w;
  wt.noalias() += behind.W.lazyProduct(stage.d);

  WB.noalias() = behind.W.lazyProduct(stage.B);
  WA.noalias() = behind.W.lazyProduct(stage.A);
  H = stage.R;
  H.noalias() += stage.B.transpose().lazyProduct(WB);
  G.noalias() = stage.B.transpose().lazyProduct(WA);
  g = stage.r;
  g.noalias() += stage.B.transpose().lazyProduct(wt);
  if (!factorise(H))
    return H.allFinite() && behind.W.allFinite() ? LqFailure::Hessian : LqFailure::NotFinite;
  L = G;
  solveNegative(H, L);
  l = g;
  solveNegative(H, l);

  before.c = behind.c + 0.5 * stage.d.dot(behind.w + wt) + stage.q0 + 0.5 * g.dot(l);
  next = stage.Q;
  if constexpr (kByQuarters<N>)
  {
    next.noalias() += G.transpose().lazyProduct(L);
    symmetricSum<N>(next, stage.A, WA, before.W);
  }
  else  // the order that the compiler likes: a fifth of the time of a stage of 4 states
  {
    next.noalias() += stage.A.transpose().lazyProduct(WA);
    next.noalias() += G.transpose().lazyProduct(L);
    before.W = 0.5 * (next + next.transpose());
  }
  before.w = stage.q;
  before.w.noalias() += stage.A.transpose().lazyProduct(wt);
  before.w.noalias() += G.transpose().lazyProduct(l);
  return LqFailure::None;
}

/// tr(W Sigma) = sum over the columns e of the factor of e'W e, without forming Sigma.
template <int N>
double traceProduct(const Eigen::Matrix<double, N, N>& W, const Eigen::MatrixXd& factor)
{
  double trace = 0.0;
  for (Eigen::Index p = 0; p < factor.cols(); ++p)
    for (Eigen::Index j = 0; j < W.cols(); ++j)
      trace += factor(j, p) * W.col(j).dot(factor.col(p));
  return trace;
}
}  // namespace detail

/// Solves into `solution`, whose storage is reused: with fixed N, M and a solution that already has T stages nothing is
/// allocated. Neither validates nor throws (but for memory): a non-finite number or an H that is not positive definite
/// ends in the status, shapes are the caller's promise (see `validate`). Returns solution.status.
template <int N, int M>
LqStatus solve(const LinearQuadraticProblem<N, M>& problem, LqSolution<N, M>& solution)
{
  const int horizon = static_cast<int>(problem.stages.size());
  solution.gains.resize(horizon);
  solution.feedforward.resize(horizon);
  solution.status = { false, LqFailure::None, -1 };

  QuadraticValue<N> value{ problem.terminal.Q, problem.terminal.q, problem.terminal.q0 };
  for (int k = horizon - 1; k >= 0; --k)
  {
    for (const NoiseSource& source : problem.noise)
      value.c += 0.5 * detail::traceProduct<N>(value.W, source.at(k));
    const LqFailure failure =
        detail::optimalStage(problem.stages[k], value, solution.gains[k], solution.feedforward[k], value);
    if (failure != LqFailure::None)
    {
      solution.status = { false, failure, k };
      return solution.status;
    }
  }
  solution.value = value;
  solution.status.ok = true;
  if (!value.W.allFinite() || !value.w.allFinite() || !std::isfinite(value.c))
  {
    int stage = horizon - 1;  // non-finite numbers travel backward: the last stage that has one is where they came in
    while (stage > 0 && solution.gains[stage].allFinite() && solution.feedforward[stage].allFinite())
      --stage;
    solution.status = { false, LqFailure::NotFinite, stage };
  }
  return solution.status;
}

/// Validates (throws std::invalid_argument, see `validate`), then solves; look at `.status` of the result.
template <int N, int M>
LqSolution<N, M> solve(const LinearQuadraticProblem<N, M>& problem)
{
  validate(problem);
  LqSolution<N, M> solution;
  solve(problem, solution);
  return solution;
}

/// Solver-independent judge of a policy: the largest |dE J/du_k| over stages k, relative to the size of the terms that
/// must cancel in it. For each k and for xi_k = 0 and every unit vector (the gradient is affine in xi_k), the policy is
/// rolled out to the end and the adjoint equation brings the gradient of the cost back:
///   p_T = Q_T xi_T + q_T,   p_j = Q xi + q + A'p_{j+1} + L'(R u + r + B'p_{j+1}),   dJ/du_k = R u + r + B'p_{k+1}.
/// Zero for all k makes the policy optimal (additive noise does not change it). Costs O(T^2): for tests.
template <int N, int M>
double residual(const LinearQuadraticProblem<N, M>& problem, const LqSolution<N, M>& solution)
{
  const Eigen::Index n = problem.stateSize();
  const std::size_t horizon = problem.stages.size();
  std::vector<Eigen::VectorXd> xi(horizon + 1), u(horizon);
  double worst = 0.0;
  for (std::size_t k = 0; k < horizon; ++k)
  {
    double gradient = 0.0, scale = 0.0;
    for (Eigen::Index start = -1; start < n; ++start)
    {
      xi[k] = start < 0 ? Eigen::VectorXd::Zero(n) : Eigen::VectorXd(Eigen::VectorXd::Unit(n, start));
      for (std::size_t j = k; j < horizon; ++j)
      {
        const LqStage<N, M>& stage = problem.stages[j];
        u[j] = solution.gains[j] * xi[j] + solution.feedforward[j];
        xi[j + 1] = stage.A * xi[j] + stage.B * u[j] + stage.d;
      }
      Eigen::VectorXd p = problem.terminal.Q * xi[horizon] + problem.terminal.q;
      for (std::size_t j = horizon; j-- > k;)
      {
        const LqStage<N, M>& stage = problem.stages[j];
        const Eigen::VectorXd effort = stage.R * u[j] + stage.r, pull = stage.B.transpose() * p;
        if (j == k)
        {
          gradient = std::max(gradient, (effort + pull).template lpNorm<Eigen::Infinity>());
          scale =
              std::max({ scale, effort.template lpNorm<Eigen::Infinity>(), pull.template lpNorm<Eigen::Infinity>() });
        }
        p = stage.Q * xi[j] + stage.q + stage.A.transpose() * p + solution.gains[j].transpose() * (effort + pull);
      }
    }
    if (gradient > 0.0)
      worst = std::max(worst, gradient / scale);
  }
  return worst;
}
}  // namespace phri_control
