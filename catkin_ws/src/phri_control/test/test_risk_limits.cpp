// Where risk-sensitive policies exist, and what happens where they do not: against the eigenvalues of the stacked form,
// which no recursion enters. Stationary gains against the numbers of the figures of 4.6.1.
#include <gtest/gtest.h>

#include "phri_control/stationary_gain.hpp"
#include "risk_oracle.hpp"

using namespace risk_oracle;

namespace
{
constexpr double kSharp = 1e-8;  // relative, of a limit by eigenvalues: rounding times their condition

VectorXd start(Eigen::Index n)
{
  return VectorXd::LinSpaced(n, -1.0, 2.0);
}

template <int N, int M>
bool exists(const LinearQuadraticProblem<N, M>& problem, double theta)
{
  RiskSolution<N, M> solution;
  return static_cast<bool>(solve(problem, RiskSensitive{ { theta } }, solution));
}
}  // namespace

// A policy's expectation is finite exactly while I - theta M of the stacked form is positive definite.
TEST(RiskLimits, givenPoliciesBreakDownAtTheStackedEigenvalue)
{
  phri_core::Random random(1);
  for (int trial = 0; trial < 30; ++trial)
  {
    const auto problem = randomProblem(random, 4, 2, 8, 1);
    const auto policy = solve(problem);
    const double limit = StackedCost(problem, 0, policy.gains, policy.feedforward, start(4)).limit();
    RiskEvaluation<> evaluation;
    const auto status = [&](double share) {
      return evaluate(problem, RiskSensitive{ { share * limit } }, policy.gains, policy.feedforward, evaluation);
    };
    EXPECT_TRUE(status(1.0 - kSharp));
    const RiskStatus beyond = status(1.0 + kSharp);
    EXPECT_EQ(beyond.kind, BreakdownKind::Expectation);
    EXPECT_EQ(beyond.source, 0);
    EXPECT_LE(beyond.limit, beyond.theta);
  }
}

// theta_max is the largest limit of any policy: the optimal one reaches it, no other one goes beyond.
TEST(RiskLimits, thetaMaxIsTheBestOfTheStackedLimits)
{
  phri_core::Random random(2);
  for (int trial = 0; trial < 20; ++trial)
  {
    const auto problem = randomProblem(random, 3, 2, 8, 1);
    const double limit = thetaMax(problem, 0);
    EXPECT_TRUE(exists(problem, limit));
    EXPECT_FALSE(exists(problem, limit * (1.0 + 3.0 * kThetaTolerance)));
    auto policy = solve(problem, RiskSensitive{ { limit * (1.0 - kSharp) } });
    const auto stacked = [&] { return StackedCost(problem, 0, policy.gains, policy.feedforward, start(3)).limit(); };
    EXPECT_GT(stacked(), limit * (1.0 - kSharp));
    EXPECT_LT(stacked(), limit * (1.0 + kSharp));
    for (int other = 0; other < 20; ++other)
    {
      auto changed = policy;
      for (auto& gain : changed.gains)
        gain += std::pow(10.0, -other % 4) * randomMatrix(random, 2, 3);
      EXPECT_LT(StackedCost(problem, 0, changed.gains, changed.feedforward, start(3)).limit(), limit * (1.0 + kSharp));
    }
  }
}

TEST(RiskLimits, statusNamesStageSourceThetaAndLimit)
{
  phri_core::Random random(3);
  for (const double sign : { 1.0, -1.0 })
  {
    auto problem = randomProblem<4, 2>(random, 4, 2, 9, 3);
    const MatrixXd E = problem.noise[2].at(8);
    problem.terminal.Q = sign * MatrixXd::Identity(4, 4) + 0.3 * problem.terminal.Q;  // indefinite for seeking
    for (auto& stage : problem.stages)
      stage.R += 100.0 * MatrixXd::Identity(2, 2);  // so that H > 0 nevertheless
    const VectorXd eigenvalues =
        Eigen::SelfAdjointEigenSolver<MatrixXd>(E.transpose() * problem.terminal.Q * E).eigenvalues();
    const double limit = 1.0 / (sign > 0.0 ? eigenvalues.maxCoeff() : eigenvalues.minCoeff());
    ASSERT_GT(limit * sign, 0.0);
    RiskSolution<4, 2> solution;
    const auto status = solve(problem, RiskSensitive{ { 0.0, 0.0, limit * (1.0 + kSharp) } }, solution);
    EXPECT_EQ(status.kind, BreakdownKind::Expectation);
    EXPECT_EQ(status.stage, 8);
    EXPECT_EQ(status.source, 2);
    EXPECT_EQ(status.theta, limit * (1.0 + kSharp));
    EXPECT_NEAR(status.limit, limit, 1e-12 * std::abs(limit));
    solve(problem, RiskSensitive{ { 0.0, 0.0, limit * (1.0 - kSharp) } }, solution);
    EXPECT_FALSE(solution.status.kind == BreakdownKind::Expectation && solution.status.stage == 8);
    try
    {
      solve(problem, RiskSensitive{ { 0.0, 0.0, 2.0 * limit } });
      FAIL() << "no exception";
    }
    catch (const RiskBreakdown& error)
    {
      EXPECT_EQ(error.status().stage, 8);
      EXPECT_NE(std::string(error.what()).find("source 2"), std::string::npos);
    }
  }
}

TEST(RiskLimits, hessianAndNonFiniteAreTyped)
{
  phri_core::Random random(4);
  auto problem = randomProblem<4, 2>(random, 4, 2, 9, 2), bad = problem;
  problem.stages[3].R -= 1e6 * Eigen::Matrix2d::Identity();
  RiskSolution<4, 2> solution;
  const RiskSensitive attitude{ { 1e-3, -1e-3 } };
  EXPECT_EQ(solve(problem, attitude, solution).kind, BreakdownKind::Hessian);
  EXPECT_EQ(solution.status.stage, 3);
  for (const double value : { std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity() })
  {
    for (int where = 0; where < 4; ++where)
    {
      auto copy = bad;
      (where == 0   ? copy.stages[6].Q(2, 2)
       : where == 1 ? copy.stages[6].q(2)
       : where == 2 ? copy.noise[0].factor[5](0, 0)
                    : copy.stages[6].q0) = value;
      EXPECT_EQ(solve(copy, attitude, solution).kind, BreakdownKind::NotFinite) << "where " << where;
      if (where < 3)  // the first stage whose future holds it; a constant is in no stage's policy
      {
        EXPECT_EQ(solution.status.stage, 5) << "where " << where;
      }
      EXPECT_THROW(solve(copy, attitude), std::invalid_argument);
    }
    EXPECT_EQ(solve(bad, RiskSensitive{ { 1e-3, value } }, solution).kind, BreakdownKind::NotFinite);
    EXPECT_THROW(solve(bad, RiskSensitive{ { 1e-3, value } }), std::invalid_argument);
  }
  EXPECT_THROW(solve(bad, RiskSensitive{ { 1e-3 } }), std::invalid_argument);
  EXPECT_THROW(thetaMax(bad, 2), std::invalid_argument);
  EXPECT_THROW(thetaMax(problem, 0), RiskBreakdown);
}

TEST(RiskLimits, noiseThatCannotReachTheCostHasNoLimit)
{
  phri_core::Random random(5);
  auto problem = randomProblem(random, 3, 1, 6, 2);
  for (MatrixXd& factor : problem.noise[0].factor)
    factor.setZero();
  EXPECT_EQ(thetaMax(problem, 0), std::numeric_limits<double>::infinity());
  EXPECT_LT(thetaMax(problem, 1), std::numeric_limits<double>::infinity());
  RiskSolution<> room;
  const RiskSensitive attitude{ { 1.0, 2.0 * thetaMax(problem, 1) } };
  EXPECT_NEAR(admissibleScale(problem, attitude, room), 0.5, 1e-9);  // the second source alone decides
}

TEST(RiskLimits, fallbackGivesWayInOrder)
{
  phri_core::Random random(6);
  auto problem = randomProblem<4, 2>(random, 4, 2, 20, 2);
  const double limit = thetaMax(problem, 0);
  RiskSolution<4, 2> solution, direct;
  EXPECT_EQ(solveWithFallback(problem, RiskSensitive{ { 0.5 * limit, -0.1 } }, solution).used, RiskFallback::None);
  for (const double excess : { 1.001, 3.0, 1e6 })
  {
    const FallbackReport report = solveWithFallback(problem, RiskSensitive{ { excess * limit, 0.0 } }, solution);
    EXPECT_EQ(report.used, RiskFallback::Reduced);
    EXPECT_EQ(report.asked.kind, BreakdownKind::Expectation);
    EXPECT_NEAR(report.scale * excess, 0.9, 1e-3);
    solve(problem, RiskSensitive{ { report.scale * excess * limit, 0.0 } }, direct);
    EXPECT_TRUE(solution.status);
    EXPECT_LT((solution.gains[0] - direct.gains[0]).norm(), 1e-9 * direct.gains[0].norm());
  }
  problem.terminal.Q =
      -0.1 * Eigen::Matrix4d::Identity();  // only the seeking source breaks down: scaling the averse one does not help
  for (auto& stage : problem.stages)
    stage.R += 100.0 * Eigen::Matrix2d::Identity();
  const FallbackReport neutral = solveWithFallback(problem, RiskSensitive{ { 1e-6, -1e3 } }, solution);
  EXPECT_EQ(neutral.used, RiskFallback::Neutral);
  EXPECT_EQ(neutral.asked.source, 1);
  EXPECT_LT((solution.gains[0] - solve(problem).gains[0]).norm(), 1e-9);
  problem.stages[4].R.setIdentity();
  problem.stages[4].R *= -1e9;
  EXPECT_EQ(solveWithFallback(problem, RiskSensitive{ { limit, 0.0 } }, solution).used, RiskFallback::NoPolicy);
  EXPECT_FALSE(solution.status);
}

// 4.6.1, m = 1 kg, d = 1 Ns/m, R = 1: printed are Delta = 1e-3, Q = I; the "0.998 N/m" of the figures needs
// Delta = 5e-3 and Q = diag(1, 0).
TEST(RiskLimits, stationaryGainsOfTheMassDamper)
{
  constexpr double kDigits = 5e-6;  // the numbers are given to so many
  const auto gain = [](double dt, const Eigen::Matrix2d& Q, const std::vector<MatrixXd>& factors, RiskSensitive theta) {
    const Eigen::Matrix2d A = (Eigen::Matrix2d() << 1.0, dt, 0.0, 1.0 - dt).finished();
    return stationaryGain(A, Eigen::Vector2d(0.0, dt), Q, MatrixXd::Identity(1, 1), factors, theta);
  };
  const Eigen::Matrix2d printed = Eigen::Matrix2d::Identity(), script = Eigen::Vector2d(1.0, 0.0).asDiagonal();
  EXPECT_NEAR(-gain(1e-3, printed, {}, {}).gain(0, 0), 0.99950, kDigits);
  EXPECT_NEAR(-gain(5e-3, script, {}, {}).gain(0, 0), 0.99817, kDigits);
  // figure 4.3: equal noise with opposite thetas does not balance out
  const std::vector<MatrixXd> equal(2, 2e-3 * Eigen::Matrix2d::Identity());
  EXPECT_NEAR(-gain(1e-3, printed, equal, { { 0.005, -0.005 } }).gain(0, 0), 1.00352, kDigits);
  // figure 4.1 at its right edge: with the printed setting no averse policy exists, with the other one all do
  const std::vector<MatrixXd> edge(1, 1.2e-2 * Eigen::Matrix2d::Identity());
  for (const double theta : { 0.005, 0.01, 0.02 })
  {
    const StationaryPolicy broken = gain(1e-3, printed, edge, { { theta } });
    EXPECT_FALSE(broken);
    EXPECT_EQ(broken.status.kind, BreakdownKind::Expectation);
    EXPECT_EQ(broken.gain.size(), 0);
    const StationaryPolicy averse = gain(5e-3, script, edge, { { theta } }),
                           seeking = gain(5e-3, script, edge, { { -theta } });
    EXPECT_GT(-averse.gain(0, 0), 1.0);
    EXPECT_LT(-seeking.gain(0, 0), 0.95);
  }
}

TEST(RiskLimits, stationaryGainThatDoesNotExistIsSaid)
{
  const MatrixXd one = MatrixXd::Identity(1, 1), none = MatrixXd::Zero(1, 1);
  const StationaryPolicy drift = stationaryGain(one, none, one, one, {}, {}, { 1e-13, 1000 });  // W grows by Q
  EXPECT_FALSE(drift);
  EXPECT_TRUE(drift.status);
  EXPECT_EQ(drift.iterations, 1000);
  const StationaryPolicy unstable = stationaryGain(2.0 * one, none, one, one, {}, {});
  EXPECT_EQ(unstable.status.kind, BreakdownKind::NotFinite);
  EXPECT_THROW(stationaryGain(one, none, one, one, { one }, {}), std::invalid_argument);
  // E J per stage in the limit is 1/2 tr(P Sigma)
  const StationaryPolicy neutral = stationaryGain(0.9 * one, one, one, one, { 0.3 * one }, { { 0.0 } });
  EXPECT_NEAR(neutral.rate, 0.5 * 0.09 * neutral.W[0](0, 0), 1e-12);
}
