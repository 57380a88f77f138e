#pragma once
// Random problems with every field in use, and the oracle for their cumulants: under a policy J is a quadratic form in
// all noise together, J = c + b'n + 1/2 n'M n with n ~ N(0, I), whose cumulant generating function
//   log E exp(theta J) = theta c + theta^2/2 b'(I - theta M)^-1 b - 1/2 log det(I - theta M)
// gives kappa_1 = c + 1/2 tr M,  kappa_r = r!/2 b'M^(r-2) b + (r-1)!/2 tr M^r.
#include <Eigen/Dense>
#include <cmath>

#include "lq_fixtures.hpp"
#include "phri_control/cost_cumulants.hpp"
#include "phri_core/random.hpp"

namespace phri_control_test
{
using namespace phri_control;
using Eigen::MatrixXd;
using Eigen::VectorXd;

using lq_fixtures::randomMatrix;

/// Time-varying, affine, with drift; three sources: singular and time-varying, wider than the state, zero.
template <int N, int M>
LinearQuadraticProblem<N, M> randomProblem(std::uint64_t seed, Eigen::Index n, Eigen::Index m, int horizon = 12)
{
  phri_core::Random random(seed);
  LinearQuadraticProblem<N, M> problem;
  std::vector<MatrixXd> factors;
  for (int k = 0; k < horizon; ++k)
  {
    problem.stages.push_back(lq_fixtures::randomStage<N, M>(random, n, m, 0.8, 0.15, 0.3));
    factors.push_back(0.2 * randomMatrix(random, n, 1));
  }
  problem.terminal = lq_fixtures::randomTerminal<N>(random, n);
  problem.noise = { NoiseSource::fromFactor("varying", factors),
                    NoiseSource::fromFactor("wide", MatrixXd(0.1 * randomMatrix(random, n, n + 2))),
                    NoiseSource::fromCovariance("none", MatrixXd::Zero(n, n)) };
  return problem;
}

/// The quadratic form of J in the noise of source s, from xi at stage `first` under a policy.
struct Form
{
  double c = 0.0;
  VectorXd b;
  MatrixXd M;

  double cumulant(int r) const
  {
    if (r == 1)
      return c + 0.5 * M.trace();
    MatrixXd power = MatrixXd::Identity(M.rows(), M.rows());
    for (int i = 0; i < r - 2; ++i)
      power = MatrixXd(power * M);
    return std::tgamma(r + 1.0) / 2.0 * b.dot(power * b) + std::tgamma(double(r)) / 2.0 * (power * M * M).trace();
  }
};

template <int N, int M>
Form stackedForm(const LinearQuadraticProblem<N, M>& problem, const CumulantSolution<N, M>& solution, std::size_t s,
                 const VectorXd& xi, std::size_t first = 0)
{
  Eigen::Index size = 0;
  for (std::size_t k = first; k < problem.horizon(); ++k)
    size += problem.noise[s].at(k).cols();
  Form form{ 0.0, VectorXd::Zero(size), MatrixXd::Zero(size, size) };
  VectorXd h = xi;  // state = S n + h
  MatrixXd S = MatrixXd::Zero(problem.stateSize(), size);
  const auto add = [&form](const MatrixXd& gradient, const MatrixXd& weight, const VectorXd& linear,
                           const VectorXd& at) {
    form.M += gradient.transpose() * weight * gradient;
    form.b += gradient.transpose() * (weight * at + linear);
    form.c += 0.5 * at.dot(weight * at) + linear.dot(at);
  };
  Eigen::Index column = 0;
  for (std::size_t k = first; k < problem.horizon(); ++k)
  {
    const LqStage<N, M>& stage = problem.stages[k];
    const MatrixXd U = solution.gains[k] * S, E = problem.noise[s].at(k);
    const VectorXd u = solution.gains[k] * h + solution.feedforward[k];
    add(S, stage.Q, stage.q, h);
    add(U, stage.R, stage.r, u);
    form.c += stage.q0;
    S = MatrixXd(stage.A * S + stage.B * U);
    S.middleCols(column, E.cols()) += E;
    column += E.cols();
    h = VectorXd(stage.A * h + stage.B * u + stage.d);
  }
  add(S, problem.terminal.Q, problem.terminal.q, h);
  form.c += problem.terminal.q0;
  return form;
}

/// Largest relative difference of a gain or a feedforward.
template <int N, int M>
double gainDifference(const CumulantSolution<N, M>& solution, const std::vector<Eigen::Matrix<double, M, N>>& gains,
                      const std::vector<Eigen::Matrix<double, M, 1>>& feedforward)
{
  double worst = 0.0;
  for (std::size_t k = 0; k < gains.size(); ++k)
    worst = std::max({ worst, (solution.gains[k] - gains[k]).norm() / (1.0 + gains[k].norm()),
                       (solution.feedforward[k] - feedforward[k]).norm() / (1.0 + feedforward[k].norm()) });
  return worst;
}
}  // namespace phri_control_test
