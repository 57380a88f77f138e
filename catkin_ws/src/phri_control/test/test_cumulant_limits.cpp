// Limits, invariances and failures of the cumulant solver.
#include <gtest/gtest.h>

#include <limits>

#include "cumulant_oracle.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control_test;

namespace
{
/// x+ = x + u + eps, variance s2, one stage, J = 1/2 R u^2 + 1/2 Q x_1^2: with v = gamma_2 the criterion in u is
/// 1/2 R u^2 + 1/2 Q (x + u)^2 + v Q^2 s2 (x + u)^2 + const.
LinearQuadraticProblem<1, 1> oneStage(double weight, double effort, double variance)
{
  LqStage<1, 1> stage = LqStage<1, 1>::zero();
  stage.A(0, 0) = stage.B(0, 0) = 1.0;
  stage.R(0, 0) = effort;
  LinearQuadraticProblem<1, 1> problem{ { stage }, LqTerminal<1>::zero(), {} };
  problem.terminal.Q(0, 0) = weight;
  problem.noise = { NoiseSource::fromCovariance("noise", MatrixXd::Constant(1, 1, variance)) };
  return problem;
}

CostCumulants variance(double gamma)
{
  return CostCumulants{ MatrixXd::Constant(1, 1, gamma) };
}

/// What `solve` complains about.
template <typename Problem>
std::string complaint(const Problem& problem, const CostCumulants& attitude)
{
  try
  {
    solve(problem, attitude);
  }
  catch (const std::exception& error)
  {
    return error.what();
  }
  return "";
}
}  // namespace

TEST(CumulantLimits, oneStageByHandAndItsLimit)
{
  constexpr double kQ = 2.0, kR = 0.7, kS2 = 0.3, kGamma = 0.4, kX = 1.5;
  const auto problem = oneStage(kQ, kR, kS2);
  const auto solution = solve(problem, variance(kGamma));
  const double slope = kQ + 2.0 * kGamma * kQ * kQ * kS2;
  EXPECT_NEAR(solution.gains[0](0, 0), -slope / (kR + slope), 1e-14);
  const double mean = kX * kR / (kR + slope);  // of x_1
  const MatrixXd kappa = solution.cumulants(VectorXd::Constant(1, kX));
  EXPECT_NEAR(kappa(0, 1), kQ * kQ * (kS2 * mean * mean + 0.5 * kS2 * kS2), 1e-14);  // Var of Q/2 x_1^2

  const double limit = -(kR + kQ) / (2.0 * kQ * kQ * kS2);
  CumulantSolution<1, 1> any;
  EXPECT_TRUE(solve(problem, variance(limit * (1.0 - 1e-9)), any));
  EXPECT_FALSE(solve(problem, variance(limit * (1.0 + 1e-9)), any));
  EXPECT_EQ(any.status.kind, BreakdownKind::Hessian);
  EXPECT_EQ(any.status.stage, 0);
  EXPECT_THROW(solve(problem, variance(limit * (1.0 + 1e-9))), RiskBreakdown);
  // without the factor r of (4.36) the limit is twice as far
  EXPECT_TRUE(solve(problem, variance(2.0 * limit * (1.0 - 1e-9)), any, CumulantWeighting::Printed));
  EXPECT_FALSE(solve(problem, variance(2.0 * limit * (1.0 + 1e-9)), any, CumulantWeighting::Printed));
}

TEST(CumulantLimits, hessianBreakdownNamesTheFirstStageGoingBackward)
{
  auto problem = randomProblem<4, 2>(10, 4, 2);
  problem.stages[3].R -= 1e6 * Eigen::Matrix2d::Identity();
  problem.stages[1].R -= 1e6 * Eigen::Matrix2d::Identity();
  CumulantSolution<4, 2> solution;
  EXPECT_FALSE(solve(problem, CostCumulants{ MatrixXd::Constant(3, 2, 0.01) }, solution));
  EXPECT_EQ(solution.status.kind, BreakdownKind::Hessian);
  EXPECT_EQ(solution.status.stage, 3);
}

// J -> cJ: kappa_r -> c^r kappa_r, and the policy stays if gamma_r -> gamma_r / c^(r-1).
TEST(CumulantLimits, scaleOfTheCost)
{
  constexpr double kScale = 3.7;
  const auto problem = randomProblem<4, 2>(11, 4, 2);
  auto scaled = problem;
  lq_fixtures::scaleCost(scaled, kScale);
  const MatrixXd gamma = MatrixXd::Constant(3, 3, 0.05);
  const MatrixXd divided =
      gamma * Eigen::Vector3d(1.0 / kScale, std::pow(kScale, -2), std::pow(kScale, -3)).asDiagonal();
  const auto expected = solve(problem, CostCumulants{ gamma });
  const auto solution = solve(scaled, CostCumulants{ divided });
  EXPECT_LT(gainDifference(solution, expected.gains, expected.feedforward), 1e-11);
  const VectorXd xi = VectorXd::Ones(4);
  for (int s = 0; s < 3; ++s)
    for (int j = 0; j < 4; ++j)
    {
      const double value = std::pow(kScale, j + 1) * expected.cumulants(xi)(s, j);
      EXPECT_NEAR(solution.cumulants(xi)(s, j), value, 1e-11 * std::abs(value));
    }
}

// In infinite horizon every cumulant grows by the same amount per stage, for ever, and the gain has a limit.
TEST(CumulantLimits, longHorizonGainsConvergeWhileCumulantsGrow)
{
  auto problem = randomProblem<4, 2>(12, 4, 2, 1);
  problem.noise.resize(1);
  const CostCumulants attitude{ Eigen::RowVector3d(0.1, 0.01, 0.001) };
  std::vector<CumulantSolution<4, 2>> solutions;
  for (const int horizon : { 200, 400, 800 })
  {
    problem.stages.assign(horizon, problem.stages.front());
    solutions.push_back(solve(problem, attitude));
  }
  EXPECT_LT((solutions[1].gains[0] - solutions[0].gains[0]).norm(), 1e-12);
  EXPECT_GT((solutions[1].gains[399] - solutions[1].gains[0]).norm(), 1e-3);  // the end of the horizon matters
  const VectorXd xi = VectorXd::Zero(4);
  for (int j = 0; j < 4; ++j)
  {
    const double early = solutions[1].cumulants(xi)(0, j) - solutions[0].cumulants(xi)(0, j);
    const double late = solutions[2].cumulants(xi)(0, j) - solutions[1].cumulants(xi)(0, j);
    EXPECT_NEAR(late / early, 2.0, 1e-9) << "kappa " << j + 1;
    EXPECT_GT(std::abs(early), 0.1 * std::abs(solutions[0].cumulants(xi)(0, j)));
  }
}

TEST(CumulantLimits, fixedAndDynamicSizesAgree)
{
  const CostCumulants attitude{ MatrixXd::Constant(3, 3, 0.02) };
  const auto fixed = solve(randomProblem<4, 2>(13, 4, 2), attitude);
  const auto dynamic = solve(randomProblem<Eigen::Dynamic, Eigen::Dynamic>(13, 4, 2), attitude);
  for (std::size_t k = 0; k < fixed.gains.size(); ++k)
    EXPECT_LT((fixed.gains[k] - dynamic.gains[k]).norm(), 1e-12 * (1.0 + fixed.gains[k].norm()));
  EXPECT_NEAR(fixed.value.c, dynamic.value.c, 1e-12 * std::abs(fixed.value.c));
}

TEST(CumulantLimits, refusesNonFiniteProblemsByStatusOnTheFastPathAndByNameOnTheOther)
{
  const CostCumulants attitude{ MatrixXd::Constant(3, 2, 0.01) };
  for (const double bad : { std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity() })
  {
    auto weight = randomProblem<4, 2>(14, 4, 2), linear = weight, constant = weight;
    weight.stages[6].Q(2, 2) = bad;
    linear.stages[6].q(2) = bad;
    constant.terminal.q0 = bad;
    CumulantSolution<4, 2> solution;
    for (const auto* problem : { &weight, &linear, &constant })
    {
      EXPECT_FALSE(solve(*problem, attitude, solution));
      EXPECT_EQ(solution.status.kind, BreakdownKind::NotFinite);
      EXPECT_EQ(solution.status.stage, problem == &constant ? 0 : 5);  // the first whose future shows it
      EXPECT_THROW(solve(*problem, attitude), std::invalid_argument);
    }
  }
}

TEST(CumulantLimits, badArgumentsAreNamed)
{
  const auto problem = randomProblem<4, 2>(15, 4, 2);
  EXPECT_NE(complaint(problem, CostCumulants{ MatrixXd::Zero(2, 1) }).find("2 rows, expected 3"), std::string::npos);
  const MatrixXd nan = MatrixXd::Constant(3, 1, std::numeric_limits<double>::quiet_NaN());
  EXPECT_NE(complaint(problem, CostCumulants{ nan }).find("gamma"), std::string::npos);
  EXPECT_EQ(complaint(problem, CostCumulants{ MatrixXd(7, 0) }), "");  // the expected cost needs no rows
  auto policy = solve(problem, CostCumulants{});
  EXPECT_THROW(evaluateCumulants(problem, 0, policy.gains, policy.feedforward), std::invalid_argument);
  policy.gains.pop_back();
  EXPECT_THROW(evaluateCumulants(problem, 2, policy.gains, policy.feedforward), std::invalid_argument);
}

TEST(CumulantLimits, fixedSizesAllocateNothingOnceSolved)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations are not counted under AddressSanitizer";
  auto problem = randomProblem<4, 2>(16, 4, 2, 50);
  const CostCumulants attitude{ MatrixXd::Constant(3, 3, 0.01) };
  auto solution = solve(problem, attitude);
  CumulantValues<4> values;
  evaluateCumulants(problem, 4, solution.gains, solution.feedforward, values);
  EXPECT_EQ(phri_core::testing::countAllocations([&] { solve(problem, attitude, solution); }), 0);
  EXPECT_EQ(phri_core::testing::countAllocations(
                [&] { evaluateCumulants(problem, 4, solution.gains, solution.feedforward, values); }),
            0);
  problem.stages[3].R -= 1e6 * Eigen::Matrix2d::Identity();
  EXPECT_EQ(phri_core::testing::countAllocations([&] { solve(problem, attitude, solution); }), 0);
  EXPECT_FALSE(solution.status);
}
