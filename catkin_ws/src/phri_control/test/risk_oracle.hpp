#pragma once
// Random risk-sensitive problems, and the oracle that does not recurse: with the noise of all stages stacked into one
// standard normal vector z, the cost of an affine policy is the quadratic form J = 1/2 z'M z + g'z + j, whose
// expectations are closed: theta^-1 log E exp(theta J) = j + theta/2 g'F^-1 g - 1/(2 theta) log det F with
// F = I - theta M, finite if and only if F > 0.
#include <Eigen/Eigenvalues>
#include <limits>
#include <vector>

#include "lq_fixtures.hpp"
#include "phri_control/risk_limits.hpp"
#include "phri_core/random.hpp"

namespace risk_oracle
{
using namespace phri_control;
using Eigen::MatrixXd;
using Eigen::VectorXd;

using lq_fixtures::randomDefinite;
using lq_fixtures::randomMatrix;

/// Time-varying, affine, with drift and constants. Odd sources have one constant singular factor, even ones a full
/// factor per stage.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
LinearQuadraticProblem<N, M> randomProblem(phri_core::Random& random, Eigen::Index n, Eigen::Index m, int horizon,
                                           int sources)
{
  LinearQuadraticProblem<N, M> problem;
  for (int k = 0; k < horizon; ++k)
  {
    problem.stages.push_back(lq_fixtures::randomStage<N, M>(random, n, m, 1.0, 0.3, 0.3));
  }
  problem.terminal = lq_fixtures::randomTerminal<N>(random, n);
  for (int s = 0; s < sources; ++s)
  {
    std::vector<MatrixXd> factors;
    for (int k = 0; k < (s % 2 ? 1 : horizon); ++k)
      factors.push_back(0.4 * randomMatrix(random, n, s % 2 ? 1 : n));
    problem.noise.push_back(NoiseSource::fromFactor(std::to_string(s), factors));
  }
  return problem;
}

/// J = 1/2 z'M z + g'z + j of a policy from x0 under one source.
struct StackedCost
{
  MatrixXd M;
  VectorXd g;
  double j = 0.0;

  template <int N, int K, typename Gains, typename Feedforward>
  StackedCost(const LinearQuadraticProblem<N, K>& problem, std::size_t source, const Gains& gains,
              const Feedforward& feedforward, const VectorXd& x0)
  {
    Eigen::Index size = 0;
    for (std::size_t k = 0; k < problem.horizon(); ++k)
      size += problem.noise[source].at(k).cols();
    M.setZero(size, size);
    g.setZero(size);
    MatrixXd S = MatrixXd::Zero(x0.size(), size);  // state = S z + h
    VectorXd h = x0;
    Eigen::Index column = 0;
    const auto add = [&](const MatrixXd& map, const VectorXd& offset, const MatrixXd& quadratic,
                         const VectorXd& linear) {
      M += map.transpose() * quadratic * map;
      g += map.transpose() * (quadratic * offset + linear);
      j += 0.5 * offset.dot(quadratic * offset) + linear.dot(offset);
    };
    for (std::size_t k = 0; k < problem.horizon(); ++k)
    {
      const auto& stage = problem.stages[k];
      const MatrixXd& factor = problem.noise[source].at(k);
      const MatrixXd U = gains[k] * S;
      const VectorXd u = gains[k] * h + feedforward[k];
      add(S, h, stage.Q, stage.q);
      add(U, u, stage.R, stage.r);
      j += stage.q0;
      S = MatrixXd(stage.A * S + stage.B * U);
      S.middleCols(column, factor.cols()) += factor;
      h = VectorXd(stage.A * h + stage.B * u + stage.d);
      column += factor.cols();
    }
    add(S, h, problem.terminal.Q, problem.terminal.q);
    j += problem.terminal.q0;
  }

  VectorXd spectrum() const { return Eigen::SelfAdjointEigenSolver<MatrixXd>(M, Eigen::EigenvaluesOnly).eigenvalues(); }
  /// The supremum of theta for which the expectation of exp(theta J) is finite.
  double limit() const { return 1.0 / spectrum().maxCoeff(); }
  double criterion(double theta) const
  {
    if (theta == 0.0)
      return j + 0.5 * M.trace();
    const Eigen::ArrayXd loss = theta * spectrum().array();
    if (loss.maxCoeff() >= 1.0)
      return std::numeric_limits<double>::infinity();
    const MatrixXd F = MatrixXd::Identity(M.rows(), M.cols()) - theta * M;
    return j + 0.5 * theta * g.dot(F.ldlt().solve(g)) - (-loss).log1p().sum() / (2.0 * theta);
  }
};

/// Mean over the sources.
template <int N, int M, typename Gains, typename Feedforward>
double criterion(const LinearQuadraticProblem<N, M>& problem, const RiskSensitive& attitude, const Gains& gains,
                 const Feedforward& feedforward, const VectorXd& x0)
{
  double sum = 0.0;
  for (std::size_t s = 0; s < problem.noise.size(); ++s)
    sum += StackedCost(problem, s, gains, feedforward, x0).criterion(attitude.theta[s]);
  return sum / double(problem.noise.size());
}
}  // namespace risk_oracle
