#pragma once
// Random problems with multiplicative noise, and oracles that do not recurse. J is of degree 2 in every single w, so
// the sum over all paths whose w are the three Gauss-Hermite nodes (exact to degree 5) is E J and E J^2 without an
// error; the risk-sensitive value of a stage is a quadrature on a grid.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "phri_control/multiplicative_noise.hpp"
#include "risk_oracle.hpp"

namespace multiplicative_oracle
{
using namespace phri_control;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using risk_oracle::randomMatrix;

constexpr double kExact = 1e-10;      // relative: sums over some thousand paths
constexpr double kDifference = 1e-6;  // relative: fourth-order differences of step 1e-2, rounding over the step squared

using Problem = MultiplicativeNoiseProblem<>;
using Gains = std::vector<MatrixXd>;
using Feedforward = std::vector<VectorXd>;

inline NoiseChannel randomChannel(phri_core::Random& random, Eigen::Index n, Eigen::Index m, double dependent,
                                  double constant)
{
  return NoiseChannel::fromMatrices(dependent * randomMatrix(random, n, n), dependent * randomMatrix(random, n, m),
                                    constant * randomMatrix(random, n, 1));
}

/// `additive` sources of lq, then one source of `channels` channels.
inline Problem randomProblem(phri_core::Random& random, Eigen::Index n, Eigen::Index m, int horizon, int additive,
                             int channels, double dependent = 0.2, double constant = 0.3)
{
  Problem problem{ risk_oracle::randomProblem(random, n, m, horizon, additive), { { "hand", {} } } };
  for (int j = 0; j < channels; ++j)
    problem.noise[0].channels.push_back(randomChannel(random, n, m, dependent, constant));
  return problem;
}

struct Moments
{
  double mean, variance;
};

/// Exact E J and Var J from x0 under the channels of all sources of `problem.noise` together with the columns of all
/// additive sources.
inline Moments enumerate(const Problem& problem, const Gains& gains, const Feedforward& feedforward, const VectorXd& x0)
{
  const double nodes[] = { -std::sqrt(3.0), 0.0, std::sqrt(3.0) }, weights[] = { 1.0 / 6, 2.0 / 3, 1.0 / 6 };
  double first = 0.0, second = 0.0;
  std::function<void(std::size_t, const VectorXd&, double, double)> walk = [&](std::size_t k, const VectorXd& xi,
                                                                               double cost, double weight) {
    if (k == problem.lq.horizon())
    {
      const auto& terminal = problem.lq.terminal;
      const double J = cost + 0.5 * xi.dot(terminal.Q * xi) + terminal.q.dot(xi) + terminal.q0;
      first += weight * J;
      second += weight * J * J;
      return;
    }
    const auto& stage = problem.lq.stages[k];
    const VectorXd u = gains[k] * xi + feedforward[k];
    VectorXd z(xi.size() + u.size() + 1);
    z << xi, u, 1.0;
    std::vector<VectorXd> columns;
    for (const NoiseSource& source : problem.lq.noise)
      for (Eigen::Index i = 0; i < source.at(k).cols(); ++i)
        columns.push_back(source.at(k).col(i));
    for (const MultiplicativeSource& source : problem.noise)
      for (const NoiseChannel& channel : source.channels)
        columns.push_back(channel.at(k) * z);
    const VectorXd next = stage.A * xi + stage.B * u + stage.d;
    const double spent =
        cost + 0.5 * xi.dot(stage.Q * xi) + stage.q.dot(xi) + stage.q0 + 0.5 * u.dot(stage.R * u) + stage.r.dot(u);
    std::function<void(std::size_t, const VectorXd&, double)> shake = [&](std::size_t j, const VectorXd& x,
                                                                          double share) {
      if (j == columns.size())
        return walk(k + 1, x, spent, share);
      for (int node = 0; node < 3; ++node)
        shake(j + 1, x + nodes[node] * columns[j], share * weights[node]);
    };
    shake(0, next, weight);
  };
  walk(0, x0, 0.0, 1.0);
  return { first, second - first * first };
}

/// theta^-1 log E exp(theta J) of one stage under two channels, by quadrature on a grid. The trapezoidal rule converges
/// faster than any power of the step for what decays at both ends.
inline double gridRisk(const Problem& problem, double theta, const MatrixXd& L, const VectorXd& l, const VectorXd& xi)
{
  constexpr double kStep = 0.25, kEnd = 12.0;
  const auto& stage = problem.lq.stages[0];
  const VectorXd u = L * xi + l;
  VectorXd z(xi.size() + u.size() + 1);
  z << xi, u, 1.0;
  const VectorXd next = stage.A * xi + stage.B * u + stage.d;
  const VectorXd a = problem.noise[0].channels[0].at(0) * z, b = problem.noise[0].channels[1].at(0) * z;
  const double spent =
      0.5 * xi.dot(stage.Q * xi) + stage.q.dot(xi) + stage.q0 + 0.5 * u.dot(stage.R * u) + stage.r.dot(u);
  const auto& end = problem.lq.terminal;
  const double shift = 0.5 * next.dot(end.Q * next) + end.q.dot(next) + end.q0;
  double sum = 0.0;
  for (double v = -kEnd; v <= kEnd; v += kStep)
    for (double w = -kEnd; w <= kEnd; w += kStep)
    {
      const VectorXd x = next + v * a + w * b;
      const double J = 0.5 * x.dot(end.Q * x) + end.q.dot(x) + end.q0;
      sum += std::exp(theta * (J - shift) - 0.5 * (v * v + w * w)) * kStep * kStep / (2.0 * M_PI);
    }
  return spent + shift + std::log(sum) / theta;
}

/// Compares value, gradient and Hessian at `center` with differences of `exact`, extrapolated to fourth order.
inline void expectTaylor(const QuadraticValue<>& taylor, const std::function<double(const VectorXd&)>& exact,
                         const VectorXd& center)
{
  constexpr double kStep = 1e-2;
  const Eigen::Index n = center.size();
  const VectorXd slope = taylor.W * center + taylor.w;
  const double size = 1.0 + slope.norm() + taylor.W.norm();
  EXPECT_NEAR(taylor(center), exact(center), kExact * (1.0 + std::abs(exact(center))));
  for (Eigen::Index i = 0; i < n; ++i)
  {
    const VectorXd e = VectorXd::Unit(n, i);
    const auto first = [&](double h) { return (exact(center + h * e) - exact(center - h * e)) / (2.0 * h); };
    EXPECT_NEAR(slope[i], (4.0 * first(kStep) - first(2.0 * kStep)) / 3.0, kDifference * size);
    for (Eigen::Index j = 0; j <= i; ++j)
    {
      const VectorXd f = VectorXd::Unit(n, j);
      const auto mixed = [&](double h) {
        return (exact(center + h * (e + f)) + exact(center - h * (e + f)) - exact(center + h * (e - f)) -
                exact(center - h * (e - f))) /
               (4.0 * h * h);
      };
      EXPECT_NEAR(taylor.W(i, j), (4.0 * mixed(kStep) - mixed(2.0 * kStep)) / 3.0, kDifference * size);
    }
  }
}

template <typename Items>
double largestDifference(const Items& a, const Items& b)
{
  double worst = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k)
    worst = std::max(worst, (a[k] - b[k]).cwiseAbs().maxCoeff() / std::max(1.0, b[k].cwiseAbs().maxCoeff()));
  return worst;
}

inline CostCumulants variance(std::size_t sources, double gamma)
{
  return { MatrixXd::Constant(sources, 1, gamma) };
}

inline ExpansionPoints<> randomPoints(phri_core::Random& random, const Problem& problem)
{
  ExpansionPoints<> points;
  for (std::size_t k = 0; k < problem.lq.horizon(); ++k)
  {
    points.states.push_back(randomMatrix(random, problem.lq.stateSize(), 1));
    points.controls.push_back(randomMatrix(random, problem.lq.controlSize(), 1));
  }
  return points;
}
}  // namespace multiplicative_oracle
