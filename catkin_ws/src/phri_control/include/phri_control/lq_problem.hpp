#pragma once
/// The linear-quadratic problem as a value, in the letters of (4.15)-(4.17). With deviations xi = x - x_nominal,
///
///   xi_{k+1} = A_k xi_k + B_k u_k + d_k + sum_s eps_{s,k},    eps_{s,k} ~ N(0, Sigma_{s,k}),     k = 0 .. T-1
///   J = 1/2 xi_T' Q_T xi_T + q_T' xi_T + q0_T
///       + sum_k 1/2 xi_k' Q_k xi_k + q_k' xi_k + q0_k + 1/2 u_k' R_k u_k + r_k' u_k
///
/// A (n, n), B (n, m), d (n), Q (n, n) symmetric, q (n), R (m, m) symmetric, r (m). Weights are per sample: they are
/// not multiplied by the time step. Trap: the factors 1/2 belong to J; a cost written without them has Q, R twice as
/// large.
///
/// The attitude towards the noise (`Attitude`: RiskSensitive{theta per source} or CostCumulants{gamma}) is kept apart
/// from this problem, so that a study can sweep it over one problem; without an attitude `solve` minimises E J.
///
/// N, M are the sizes where they are known at compile time (a several times faster solve), else Eigen::Dynamic.

#include <Eigen/Core>
#include <stdexcept>
#include <string>
#include <vector>

#include "phri_core/check.hpp"

namespace phri_control
{
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct LqStage
{
  Eigen::Matrix<double, N, N> A;
  Eigen::Matrix<double, N, M> B;
  Eigen::Matrix<double, N, 1> d;  ///< known drift
  Eigen::Matrix<double, N, N> Q;
  Eigen::Matrix<double, N, 1> q;
  double q0 = 0.0;
  Eigen::Matrix<double, M, M> R;
  Eigen::Matrix<double, M, 1> r;

  /// A stage of `n` states and `m` controls with every element 0.
  static LqStage zero(Eigen::Index n = N, Eigen::Index m = M)
  {
    LqStage stage;
    stage.A.setZero(n, n);
    stage.B.setZero(n, m);
    stage.d.setZero(n);
    stage.Q.setZero(n, n);
    stage.q.setZero(n);
    stage.R.setZero(m, m);
    stage.r.setZero(m);
    return stage;
  }
};

/// A quadratic function 1/2 xi'Q xi + q'xi + q0 of the state: the terminal cost.
template <int N = Eigen::Dynamic>
struct LqTerminal
{
  Eigen::Matrix<double, N, N> Q;
  Eigen::Matrix<double, N, 1> q;
  double q0 = 0.0;

  static LqTerminal zero(Eigen::Index n = N)
  {
    LqTerminal terminal;
    terminal.Q.setZero(n, n);
    terminal.q.setZero(n);
    return terminal;
  }
};

/// The physics of one source of noise: eps_k = factor_k n, n ~ N(0, I_p), hence Sigma_k = factor_k factor_k', the
/// covariance ADDED TO THE STATE per stage. It may be singular or zero. Force noise of covariance Su entering through B
/// has the factor B chol(Su); a diffusion G sqrt(dt) has the factor sqrt(dt) G.
struct NoiseSource
{
  std::string name;
  std::vector<Eigen::MatrixXd> factor;  ///< (n, p) each: one for all stages, or one per stage

  const Eigen::MatrixXd& at(std::size_t k) const { return factor.size() == 1 ? factor.front() : factor[k]; }

  /// From covariances (n, n), one for all stages or one per stage. The factor is the eigenvectors times the roots of
  /// the eigenvalues, so singular ones are fine. Throws std::invalid_argument unless symmetric positive semi-definite.
  static NoiseSource fromCovariance(const std::string& name, const std::vector<Eigen::MatrixXd>& covariance);
  static NoiseSource fromCovariance(const std::string& name, const Eigen::MatrixXd& covariance);
  /// From factors (n, p). Throws std::invalid_argument unless finite.
  static NoiseSource fromFactor(const std::string& name, std::vector<Eigen::MatrixXd> factor);
  static NoiseSource fromFactor(const std::string& name, const Eigen::MatrixXd& factor);
};

template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct LinearQuadraticProblem
{
  std::vector<LqStage<N, M>> stages;  ///< T of them
  LqTerminal<N> terminal;
  std::vector<NoiseSource> noise;

  std::size_t horizon() const { return stages.size(); }
  Eigen::Index stateSize() const { return stages.empty() ? terminal.Q.rows() : stages.front().A.rows(); }
  Eigen::Index controlSize() const { return stages.empty() ? 0 : stages.front().B.cols(); }
};

namespace detail
{
/// Throws unless `value` is n x n, finite and symmetric to 1e-9 of its largest element. Weights may be indefinite.
void requireSymmetric(const std::string& name, const Eigen::Ref<const Eigen::MatrixXd>& value, Eigen::Index size);
/// Throws unless `source` has one or `horizon` factors of n rows each.
void requireNoise(const NoiseSource& source, Eigen::Index state_size, std::size_t horizon);

/// Throws unless there are finite gains (m, n) and feedforwards (m), one of each per stage.
template <int N, int M>
void requirePolicy(const LinearQuadraticProblem<N, M>& problem, const std::vector<Eigen::Matrix<double, M, N>>& gains,
                   const std::vector<Eigen::Matrix<double, M, 1>>& feedforward)
{
  if (gains.size() != problem.horizon() || feedforward.size() != problem.horizon())
    throw std::invalid_argument("policy: " + std::to_string(gains.size()) + " gains and " +
                                std::to_string(feedforward.size()) + " feedforwards, expected " +
                                std::to_string(problem.horizon()) + " of each (one per stage)");
  for (std::size_t k = 0; k < gains.size(); ++k)
  {
    const std::string index = "[" + std::to_string(k) + "]";
    phri_core::requireShape("gains" + index, gains[k], problem.controlSize(), problem.stateSize());
    phri_core::requireShape("feedforward" + index, feedforward[k], problem.controlSize(), 1);
    phri_core::requireFinite("gains" + index, gains[k]);
    phri_core::requireFinite("feedforward" + index, feedforward[k]);
  }
}
}  // namespace detail

/// Throws std::invalid_argument naming the field (such as "stages[3].B"), its value or shape, and what was expected: at
/// least one stage, matching shapes, every element finite, Q and R symmetric. Positive definiteness is found by
/// `solve`.
template <int N, int M>
void validate(const LinearQuadraticProblem<N, M>& problem)
{
  using phri_core::requireFinite;
  using phri_core::requireShape;
  if (problem.stages.empty())
    throw std::invalid_argument("LinearQuadraticProblem: stages is empty, expected at least one");
  const Eigen::Index n = problem.stateSize(), m = problem.controlSize();
  if (n == 0 || m == 0)
    throw std::invalid_argument("LinearQuadraticProblem: stages[0].A has " + std::to_string(n) +
                                " rows and stages[0].B " + std::to_string(m) + " columns, expected at least 1");
  const auto require = [](const std::string& name, const Eigen::Ref<const Eigen::MatrixXd>& value, Eigen::Index rows,
                          Eigen::Index cols) {
    requireShape(name, value, rows, cols);
    requireFinite(name, value);
  };
  for (std::size_t k = 0; k < problem.stages.size(); ++k)
  {
    const LqStage<N, M>& stage = problem.stages[k];
    const std::string name = "stages[" + std::to_string(k) + "].";
    require(name + "A", stage.A, n, n);
    require(name + "B", stage.B, n, m);
    require(name + "d", stage.d, n, 1);
    require(name + "q", stage.q, n, 1);
    require(name + "r", stage.r, m, 1);
    detail::requireSymmetric(name + "Q", stage.Q, n);
    detail::requireSymmetric(name + "R", stage.R, m);
    require(name + "q0", Eigen::Matrix<double, 1, 1>::Constant(stage.q0), 1, 1);
  }
  detail::requireSymmetric("terminal.Q", problem.terminal.Q, n);
  require("terminal.q", problem.terminal.q, n, 1);
  require("terminal.q0", Eigen::Matrix<double, 1, 1>::Constant(problem.terminal.q0), 1, 1);
  for (const NoiseSource& source : problem.noise)
    detail::requireNoise(source, n, problem.stages.size());
}
}  // namespace phri_control
