// Cumulants and their optimal policies against oracles that do not recurse over theta: the stacked quadratic form of
// cumulant_oracle.hpp, numerical derivatives, the expected-cost and the risk-sensitive solver.
#include <gtest/gtest.h>

#include <limits>

#include "cumulant_oracle.hpp"
#include "phri_control/risk_sensitive.hpp"

using namespace phri_control_test;

namespace
{
constexpr double kExact = 1e-10;  // products of some 50 unknowns, relative to the largest term

template <int N, int M>
double stackedCriterion(const LinearQuadraticProblem<N, M>& problem, const CumulantSolution<N, M>& policy,
                        const MatrixXd& gamma, const VectorXd& xi, std::size_t first)
{
  double sum = 0.0;
  for (std::size_t s = 0; s < problem.noise.size(); ++s)
  {
    const Form form = stackedForm(problem, policy, s, xi, first);
    sum += form.cumulant(1);
    for (int r = 2; r <= gamma.cols() + 1; ++r)
      sum += gamma(s, r - 2) * form.cumulant(r);
  }
  return sum / double(problem.noise.size());
}

/// Weights of kappa_2 .. kappa_4 of three sources, averse and seeking.
MatrixXd someWeights()
{
  MatrixXd gamma(3, 3);
  gamma << 0.1, 0.01, 0.001, -0.02, 0.03, 0.0, 0.5, 0.5, 0.5;
  return gamma;
}

template <int N, int M>
void expectStackedCumulants(std::uint64_t seed, Eigen::Index n, Eigen::Index m)
{
  constexpr int kCount = 6;
  const auto problem = randomProblem<N, M>(seed, n, m);
  const auto solution = solve(problem, CostCumulants{ someWeights() });
  const auto values = evaluateCumulants(problem, kCount, solution.gains, solution.feedforward);
  for (const VectorXd& xi : { VectorXd(VectorXd::Zero(n)), VectorXd(VectorXd::LinSpaced(n, -1.0, 2.0)) })
  {
    const MatrixXd kappa = values.cumulants(xi), own = solution.cumulants(xi);
    ASSERT_EQ(own.cols(), 4);
    EXPECT_LT((own - kappa.leftCols(4)).norm(), kExact * own.norm());
    for (int s = 0; s < 3; ++s)
      for (int r = 1; r <= kCount; ++r)
      {
        const double expected = stackedForm(problem, solution, s, xi).cumulant(r);
        EXPECT_NEAR(kappa(s, r - 1), expected, kExact * std::abs(expected)) << "source " << s << " kappa " << r;
      }
    const double criterion = stackedCriterion(problem, solution, someWeights(), xi, 0);
    EXPECT_NEAR(solution.value(xi), criterion, kExact * (1.0 + std::abs(criterion)));
  }
}

/// The largest gradient of the criterion from stage k on in u_k, relative to u_k = 1 away from there, by central
/// differences, which are exact because the criterion is quadratic in u_k.
template <int N, int M>
double stagewiseGradient(const LinearQuadraticProblem<N, M>& problem, const CumulantSolution<N, M>& solution,
                         const MatrixXd& gamma)
{
  double worst = 0.0;
  const Eigen::Index n = problem.stateSize(), m = problem.controlSize();
  for (std::size_t k = 0; k < problem.horizon(); ++k)
  {
    const VectorXd xi = VectorXd::LinSpaced(n, 1.0 + double(k), -2.0);
    for (Eigen::Index i = 0; i < m; ++i)
    {
      const auto at = [&](double shift) {
        auto other = solution;
        other.gains[k].setZero();
        other.feedforward[k] = solution.gains[k] * xi + solution.feedforward[k] + shift * VectorXd::Unit(m, i);
        return stackedCriterion(problem, other, gamma, xi, k);
      };
      const double up = at(1.0), middle = at(0.0), down = at(-1.0);
      EXPECT_GT(up + down, 2.0 * middle);
      worst = std::max(worst, std::abs(up - down) / (up + down - 2.0 * middle));
    }
  }
  return worst;
}

/// gamma_r = theta^(r-1)/r! for r = 2 .. count: the first terms of theta^-1 log E exp(theta J).
MatrixXd exponentialWeights(const std::vector<double>& theta, int count)
{
  MatrixXd gamma(theta.size(), count - 1);
  for (std::size_t s = 0; s < theta.size(); ++s)
    for (int r = 2; r <= count; ++r)
      gamma(s, r - 2) = std::pow(theta[s], r - 1) / std::tgamma(r + 1.0);
  return gamma;
}

}  // namespace

TEST(CostCumulants, equalThoseOfTheStackedQuadraticForm)
{
  for (std::uint64_t seed = 1; seed <= 4; ++seed)
  {
    expectStackedCumulants<4, 2>(seed, 4, 2);
    expectStackedCumulants<Eigen::Dynamic, Eigen::Dynamic>(seed, 3, 1);
    expectStackedCumulants<Eigen::Dynamic, Eigen::Dynamic>(seed, 6, 3);
  }
}

// The definition of the stagewise optimum, with the criterion of the stacked form; the weighting printed in the thesis
// misses it.
TEST(CostCumulants, everyControlMinimisesTheCriterionOfItsCostToGo)
{
  constexpr double kDifferences = 1e-8;  // rounding of a criterion of some 1e3 over a curvature of some 1
  for (std::uint64_t seed = 1; seed <= 3; ++seed)
  {
    const auto problem = randomProblem<4, 2>(seed, 4, 2);
    const CostCumulants attitude{ someWeights() };
    EXPECT_LT(stagewiseGradient(problem, solve(problem, attitude), attitude.gamma), kDifferences);
    const auto printed = solve(problem, attitude, CumulantWeighting::Printed);
    EXPECT_GT(stagewiseGradient(problem, printed, attitude.gamma), 1e3 * kDifferences);
  }
}

TEST(CostCumulants, firstCumulantAloneIsTheExpectedCost)
{
  auto problem = randomProblem<4, 2>(5, 4, 2, 40);
  problem.noise.resize(1);
  const LqSolution<4, 2> expected = solve(problem);
  const auto solution = solve(problem, CostCumulants{});
  constexpr double kRounding = 1e-12;  // the closed-loop form adds in another order
  EXPECT_LT(gainDifference(solution, expected.gains, expected.feedforward), kRounding);
  const VectorXd xi = VectorXd::LinSpaced(4, -3.0, 2.0);
  EXPECT_NEAR(solution.value(xi), expected.value(xi), kRounding * std::abs(expected.value(xi)));
  EXPECT_NEAR(solution.cumulants(xi)(0, 0), expected.value(xi), kRounding * std::abs(expected.value(xi)));
}

// Certainty equivalence: without noise J is certain, kappa_2 .. vanish and no weight on them changes anything.
TEST(CostCumulants, withoutNoiseWeightsDoNotMatter)
{
  auto problem = randomProblem<4, 2>(6, 4, 2);
  problem.noise = { problem.noise[2] };
  auto bare = problem;
  bare.noise.clear();
  const LqSolution<4, 2> expected = solve(bare);
  for (const auto& [some, gamma] : { std::pair{ problem, MatrixXd(MatrixXd::Constant(1, 4, -7.0)) },
                                     std::pair{ bare, MatrixXd(MatrixXd::Zero(0, 4)) } })
  {
    const auto solution = solve(some, CostCumulants{ gamma });
    EXPECT_LT(gainDifference(solution, expected.gains, expected.feedforward), 1e-12);
    const MatrixXd kappa = solution.cumulants(VectorXd::Ones(4));
    ASSERT_EQ(kappa.rows(), 1);
    EXPECT_NEAR(kappa(0, 0), expected.value(VectorXd::Ones(4)), 1e-12 * std::abs(kappa(0, 0)));
    EXPECT_EQ(kappa.rightCols(4).norm(), 0.0);
  }
}

// The cumulants are the derivatives of the exact risk-sensitive value of the same policy: V(theta) interpolated at
// Chebyshev nodes well inside the radius of convergence 1/lambda_max(M).
TEST(CostCumulants, areTheThetaDerivativesOfTheRiskSensitiveValue)
{
  constexpr int kNodes = 13, kCount = 4;
  auto problem = randomProblem<4, 2>(7, 4, 2);
  problem.noise.resize(1);
  const auto solution = solve(problem, CostCumulants{ MatrixXd::Constant(1, 1, 0.05) });
  const VectorXd xi = VectorXd::LinSpaced(4, -1.0, 1.0);
  const Form form = stackedForm(problem, solution, 0, xi);
  const double radius = 0.1 / form.M.selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff();
  MatrixXd powers(kNodes, kNodes);
  VectorXd value(kNodes);
  for (int i = 0; i < kNodes; ++i)
  {
    const double node = std::cos(M_PI * (i + 0.5) / kNodes);
    value(i) = evaluate(problem, RiskSensitive{ { radius * node } }, solution.gains, solution.feedforward).value(xi);
    for (int j = 0; j < kNodes; ++j)
      powers(i, j) = std::pow(node, j);
  }
  const VectorXd series = powers.fullPivLu().solve(value);
  const MatrixXd kappa = evaluateCumulants(problem, kCount, solution.gains, solution.feedforward).cumulants(xi);
  for (int r = 1; r <= kCount; ++r)
  {
    const double expected = std::tgamma(r + 1.0) * series(r - 1) / std::pow(radius, r - 1);
    // rounding of V, 1e-16, over the share of the term in V, about 0.1^(r-1), times what the interpolation adds
    EXPECT_NEAR(kappa(0, r - 1), expected, 1e-12 * std::pow(100.0, r - 1) * std::abs(expected)) << "kappa " << r;
  }
}

TEST(CostCumulants, exponentialWeightsGiveTheRiskSensitivePolicy)
{
  const auto problem = randomProblem<4, 2>(8, 4, 2);
  const std::vector<double> theta{ 0.05, -0.08, 0.3 };
  const auto expected = solve(problem, RiskSensitive{ theta });
  double previous = std::numeric_limits<double>::infinity();
  for (const int count : { 2, 4, 6, 10 })
  {
    const auto solution = solve(problem, CostCumulants{ exponentialWeights(theta, count) });
    const double difference = gainDifference(solution, expected.gains, expected.feedforward);
    EXPECT_LT(difference, 0.2 * previous) << "K = " << count;
    previous = difference;
  }
  EXPECT_LT(previous, 1e-7);  // what is left of the series after ten terms; mean-variance misses by 1e-3 or so
}

// gamma_2 = theta/2 agrees with LEQR to first order: halving theta divides what is left by four, not by two.
TEST(CostCumulants, meanVarianceIsTheFirstOrderOfRiskSensitivity)
{
  auto problem = randomProblem<4, 2>(9, 4, 2);
  problem.noise.resize(2);
  const auto remainder = [&](double theta, double share) {
    const auto expected = solve(problem, RiskSensitive{ { theta, -theta } });
    const MatrixXd gamma = share * theta * Eigen::Vector2d(1.0, -1.0);
    return gainDifference(solve(problem, CostCumulants{ gamma }), expected.gains, expected.feedforward);
  };
  EXPECT_NEAR(remainder(2e-3, 0.5) / remainder(1e-3, 0.5), 4.0, 0.2);
  EXPECT_NEAR(remainder(2e-3, 1.0) / remainder(1e-3, 1.0), 2.0, 0.1);
}
