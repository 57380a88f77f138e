#pragma once
// Random linear-quadratic problems of all sizes and scales for the soak tests, and what their comparison with the
// stacked forms needs (risk_oracle.hpp, cumulant_oracle.hpp), which no recursion enters.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "lq_fixtures.hpp"
#include "phri_control/attitude.hpp"
#include "phri_core/soak.hpp"

namespace soak_problems
{
using namespace phri_control;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using phri_core::Random;

constexpr int kChecked = 16;           // one in so many is compared with the stacked form,
constexpr Eigen::Index kStacked = 96;  // where that has at most so many dimensions
// The recursion and the stacked form round differently; where they are closer to their limit than this, relative to
// the largest term, they may disagree.
constexpr double kClose = 1e-7;
inline const char* nameOf(BreakdownKind kind)
{
  constexpr const char* kNames[] = { "policy", "expectation", "hessian", "not_finite" };
  return kNames[static_cast<int>(kind)];
}

/// A problem, and the sizes of its cost and of its noise's part of the cost.
template <int N, int M>
struct Case
{
  LinearQuadraticProblem<N, M> problem;
  double unit = 1.0;   ///< [J] of the noise's share of the cost, roughly
  bool grows = false;  ///< fast enough to overflow
};

inline NoiseSource randomNoise(Random& random, Eigen::Index n, int horizon, double size)
{
  switch (soak::number(random, 0, 5))
  {
    case 0:
      return NoiseSource::fromCovariance("none", MatrixXd::Zero(n, n));
    case 1:
      return NoiseSource::fromFactor("singular", MatrixXd(size * lq_fixtures::randomMatrix(random, n, 1)));
    case 2:
      return NoiseSource::fromFactor("wide", MatrixXd(size * lq_fixtures::randomMatrix(random, n, n + 2)));
    case 3: {
      const MatrixXd root = size * lq_fixtures::randomMatrix(random, n, (n + 1) / 2);
      return NoiseSource::fromCovariance("singular covariance", MatrixXd(root * root.transpose()));
    }
    default: {
      std::vector<MatrixXd> factors;
      for (int k = 0; k < horizon; ++k)
        factors.push_back(size * lq_fixtures::randomMatrix(random, n, soak::number(random, 1, n)));
      return NoiseSource::fromFactor("varying", factors);
    }
  }
}

/// Horizons 1 to 50, weights of 1e-8 to 1e8, covariances of 1e-8 to 1e8, some weights indefinite, some plants that
/// overflow.
template <int N, int M>
Case<N, M> randomCase(Random& random, Eigen::Index n, Eigen::Index m, int sources)
{
  Case<N, M> result;
  LinearQuadraticProblem<N, M>& problem = result.problem;
  const int horizon = static_cast<int>(std::pow(51.0, random.uniform()));
  const bool constant = random.uniform() < 0.3;
  for (int k = 0; k < horizon; ++k)
    problem.stages.push_back(constant && k > 0 ? problem.stages[0]
                                               : lq_fixtures::randomStage<N, M>(random, n, m, 0.9, 0.25, 0.3));
  problem.terminal = lq_fixtures::randomTerminal<N>(random, n);
  result.grows = random.uniform() < 0.03;
  const double growth = result.grows ? soak::scale(random, 0.0, 120.0) : 1.0, weight = soak::scale(random, -8.0, 8.0);
  const double less_q = random.uniform() < 0.3 ? random.uniform(0.0, 2.0) : 0.0,
               less_r = random.uniform() < 0.05 ? random.uniform(0.0, 1.0) : 0.0,
               less_end = random.uniform() < 0.1 ? random.uniform(0.0, 3.0) : 0.0;
  for (LqStage<N, M>& stage : problem.stages)
  {
    stage.A *= growth;
    stage.Q.diagonal().array() -= less_q;
    stage.R.diagonal().array() -= less_r;
  }
  problem.terminal.Q.diagonal().array() -= less_end;
  lq_fixtures::scaleCost(problem, weight);
  const double size = soak::scale(random, -4.0, 4.0);
  for (int s = 0; s < sources; ++s)
    problem.noise.push_back(randomNoise(random, n, horizon, size * soak::scale(random, -1.0, 1.0)));
  result.unit = weight * size * size;
  return result;
}

/// The problem from stage `first` on, without affine terms; a problem without noise gets a source of zero noise.
template <int N, int M>
LinearQuadraticProblem<N, M> tail(const LinearQuadraticProblem<N, M>& problem, int first)
{
  LinearQuadraticProblem<N, M> rest = problem;
  rest.stages.erase(rest.stages.begin(), rest.stages.begin() + first);
  for (LqStage<N, M>& stage : rest.stages)
  {
    stage.d.setZero();
    stage.q.setZero();
    stage.r.setZero();
    stage.q0 = 0.0;
  }
  rest.terminal.q.setZero();
  rest.terminal.q0 = 0.0;
  for (NoiseSource& source : rest.noise)
    if (source.factor.size() > 1)
      source.factor.erase(source.factor.begin(), source.factor.begin() + first);
  if (rest.noise.empty())
    rest.noise.push_back(NoiseSource::fromCovariance("none", MatrixXd::Zero(rest.stateSize(), rest.stateSize())));
  return rest;
}

/// The policy of a solution from stage `first` on, with another one at its first stage.
template <typename Solution>
Solution tailPolicy(const Solution& solution, int first, Eigen::Index n, const VectorXd& u)
{
  Solution rest;
  rest.gains.assign(solution.gains.begin() + first, solution.gains.end());
  rest.feedforward.assign(solution.feedforward.begin() + first, solution.feedforward.end());
  for (auto& l : rest.feedforward)
    l.setZero(u.size());
  rest.gains.front().setZero(u.size(), n);  // what a failed solve left there has any size
  rest.feedforward.front() = u;
  return rest;
}

template <int N, int M>
Eigen::Index stackedSize(const LinearQuadraticProblem<N, M>& problem)
{
  Eigen::Index most = 0;
  for (const NoiseSource& source : problem.noise)
  {
    Eigen::Index size = 0;
    for (std::size_t k = 0; k < problem.horizon(); ++k)
      size += source.at(k).cols();
    most = std::max(most, size);
  }
  return most;
}

/// The smallest eigenvalue of the Hessian of a quadratic function of u, with f(u) = f(-u), over the largest magnitude
/// of an eigenvalue or of the function, whose rounding the differences contain.
template <typename Function>
double curvature(const Function& function, Eigen::Index m)
{
  const double zero = function(VectorXd(VectorXd::Zero(m)));
  VectorXd diagonal(m);
  MatrixXd H(m, m);
  const auto unit = [&](Eigen::Index i) { return VectorXd(VectorXd::Unit(m, i)); };
  for (Eigen::Index i = 0; i < m; ++i)
    diagonal(i) = function(unit(i)) - zero;
  for (Eigen::Index i = 0; i < m; ++i)
    for (Eigen::Index j = 0; j < m; ++j)
      H(i, j) = i == j ? 2.0 * diagonal(i) : function(unit(i) + unit(j)) - zero - diagonal(i) - diagonal(j);
  const VectorXd values = Eigen::SelfAdjointEigenSolver<MatrixXd>(H, Eigen::EigenvaluesOnly).eigenvalues();
  return values.minCoeff() / std::max({ 1e-300, std::abs(zero), values.cwiseAbs().maxCoeff() });
}

}  // namespace soak_problems
