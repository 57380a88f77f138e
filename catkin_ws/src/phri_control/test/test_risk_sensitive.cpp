// The risk-sensitive recursion against the stacked closed form of E exp(theta J), which does not recurse, against Monte
// Carlo, and in its limiting cases. test_risk_limits.cpp has the existence of policies.
#include <gtest/gtest.h>

#include "phri_core/testing.hpp"
#include "risk_oracle.hpp"

using namespace risk_oracle;

namespace
{
constexpr double kExact = 1e-10;  // relative: dense factorisations of well-conditioned matrices of some 50 rows
constexpr double kSame = 1e-12;   // relative: the same sums in another order

double scaled(double value)
{
  return std::max(1.0, std::abs(value));
}

template <typename Gains>
double largestDifference(const Gains& a, const Gains& b)
{
  double worst = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k)
    worst = std::max(worst, (a[k] - b[k]).cwiseAbs().maxCoeff() / scaled(a[k].cwiseAbs().maxCoeff()));
  return worst;
}

template <typename Items>
void withoutFirst(Items& items)
{
  items = Items(items.begin() + 1, items.end());
}

VectorXd start(Eigen::Index n)
{
  return VectorXd::LinSpaced(n, -1.0, 2.0);
}
}  // namespace

TEST(RiskSensitive, valueOfAnyPolicyIsTheStackedClosedForm)
{
  phri_core::Random random(1);
  for (int trial = 0; trial < 20; ++trial)
  {
    const auto problem = randomProblem(random, 4, 2, 10, 2);
    auto policy = solve(problem);
    for (auto& gain : policy.gains)
      gain += 0.05 * randomMatrix(random, 2, 4);
    const VectorXd x0 = start(4);
    std::vector<StackedCost> costs;
    for (std::size_t s = 0; s < 2; ++s)
      costs.emplace_back(problem, s, policy.gains, policy.feedforward, x0);
    for (const double share : { -5.0, -0.5, -1e-9, 0.0, 1e-12, 1e-7, 0.3, 0.9 })
    {
      const RiskSensitive attitude{ { share * costs[0].limit(), 0.5 * share * costs[1].limit() } };
      const auto evaluation = evaluate(problem, attitude, policy.gains, policy.feedforward);
      for (std::size_t s = 0; s < 2; ++s)
      {
        const double expected = costs[s].criterion(attitude.theta[s]);
        EXPECT_NEAR(evaluation.values[s](x0), expected, kExact * scaled(expected)) << "share " << share;
      }
    }
  }
}

// The oracle is asked, not the recursion: no element of any gain or feedforward improves the criterion.
TEST(RiskSensitive, policyOfOneSourceIsStationaryInAllGains)
{
  constexpr double kStep = 1e-5, kGradient = 1e-6;  // curvature times step squared, and rounding over step
  phri_core::Random random(2);
  for (const double share : { -3.0, 0.0, 0.5 })
  {
    const auto problem = randomProblem(random, 3, 2, 6, 1);
    const RiskSensitive attitude{ { share * thetaMax(problem, 0) } };
    auto policy = solve(problem, attitude);
    const VectorXd x0 = start(3);
    const auto oracle = [&] { return criterion(problem, attitude, policy.gains, policy.feedforward, x0); };
    const double best = oracle();
    EXPECT_NEAR(policy.value(x0), best, kExact * scaled(best));
    const auto probe = [&](double& element) {
      const double kept = element;
      const auto at = [&](double offset) {
        element = kept + offset;
        return oracle();
      };
      EXPECT_LT(std::abs(at(kStep) - at(-kStep)) / (2.0 * kStep), kGradient * scaled(best)) << "share " << share;
      EXPECT_GT(at(0.1), best);
      EXPECT_GT(at(-0.1), best);
      element = kept;
    };
    for (std::size_t k = 0; k < problem.horizon(); ++k)
    {
      for (Eigen::Index i = 0; i < policy.gains[k].size(); ++i)
        probe(policy.gains[k].data()[i]);
      for (Eigen::Index i = 0; i < policy.feedforward[k].size(); ++i)
        probe(policy.feedforward[k].data()[i]);
    }
  }
}

// (4.14) with time consistency: at every stage, from every state, given the later policy, no other control is better.
TEST(RiskSensitive, policyOfSeveralSourcesIsStationaryStageByStage)
{
  constexpr double kStep = 1e-4, kGradient = 1e-7;
  phri_core::Random random(3);
  auto problem = randomProblem(random, 3, 2, 6, 3);
  const RiskSensitive attitude{ { 0.3 * thetaMax(problem, 0), -0.5, 0.4 * thetaMax(problem, 2) } };
  auto policy = solve(problem, attitude);
  for (auto& source : problem.noise)  // one factor per stage, so that stages can be cut off
    source.factor.resize(problem.horizon(), source.factor.front());
  while (!problem.stages.empty())
  {
    const VectorXd xi = 2.0 * randomMatrix(random, 3, 1);
    const double best = criterion(problem, attitude, policy.gains, policy.feedforward, xi);
    for (Eigen::Index i = 0; i < 2; ++i)
    {
      const auto at = [&](double offset) {
        policy.feedforward[0](i) += offset;
        const double value = criterion(problem, attitude, policy.gains, policy.feedforward, xi);
        policy.feedforward[0](i) -= offset;
        return value;
      };
      EXPECT_LT(std::abs(at(kStep) - at(-kStep)) / (2.0 * kStep), kGradient * scaled(best));
      EXPECT_GT(at(0.5), best);
      EXPECT_GT(at(-0.5), best);
    }
    withoutFirst(problem.stages);
    withoutFirst(policy.gains);
    withoutFirst(policy.feedforward);
    for (auto& source : problem.noise)
      withoutFirst(source.factor);
  }
}

TEST(RiskSensitive, monteCarloAgrees)
{
  constexpr int kTrials = 200000;
  phri_core::Random random(4);
  const auto problem = randomProblem<3, 1>(random, 3, 1, 8, 1);
  for (const double share : { -1.0, 0.2 })
  {
    const RiskSensitive attitude{ { share * thetaMax(problem, 0) } };
    const double theta = attitude.theta[0];
    const auto policy = solve(problem, attitude);
    const double value = policy.value(start(3));
    double sum = 0.0, squares = 0.0;
    for (int trial = 0; trial < kTrials; ++trial)
    {
      Eigen::Vector3d xi = start(3);
      double cost = 0.0;
      for (std::size_t k = 0; k < problem.horizon(); ++k)
      {
        const auto& stage = problem.stages[k];
        const Eigen::Matrix<double, 1, 1> u = policy.gains[k] * xi + policy.feedforward[k];
        cost += 0.5 * xi.dot(stage.Q * xi) + stage.q.dot(xi) + stage.q0 + 0.5 * u.dot(stage.R * u) + stage.r.dot(u);
        const Eigen::Vector3d z = Eigen::Vector3d::NullaryExpr([&]() { return random.normal(); });
        xi = Eigen::Vector3d(stage.A * xi + stage.B * u + stage.d + Eigen::Matrix3d(problem.noise[0].at(k)) * z);
      }
      cost += 0.5 * xi.dot(problem.terminal.Q * xi) + problem.terminal.q.dot(xi) + problem.terminal.q0;
      const double weight = std::exp(theta * (cost - value));  // its expectation is 1
      sum += weight;
      squares += weight * weight;
    }
    const double mean = sum / kTrials;
    const double error = std::sqrt((squares / kTrials - mean * mean) / kTrials);
    EXPECT_LT(error, 0.01);
    EXPECT_LT(std::abs(mean - 1.0), 4.0 * error) << "share " << share;  // one seed in 16 000 would miss by chance
  }
}

TEST(RiskSensitive, withoutAttitudeOrNoiseItIsTheExpectedCost)
{
  phri_core::Random random(5);
  auto problem = randomProblem<4, 2>(random, 4, 2, 30, 1);
  const VectorXd x0 = start(4);
  const auto neutral = solve(problem);
  for (const double theta : { 0.0, 1e-300, -1e-16, 5e-324 })
  {
    const auto risk = solve(problem, RiskSensitive{ { theta } });
    EXPECT_LT(largestDifference(neutral.gains, risk.gains), kSame);
    EXPECT_LT(largestDifference(neutral.feedforward, risk.feedforward), kSame);
    EXPECT_NEAR(risk.value(x0), neutral.value(x0), kSame * scaled(neutral.value(x0)));
  }
  // V = kappa_1 + theta/2 kappa_2 + ...: halving theta halves the distance
  const double theta = 1e-3 * thetaMax(problem, 0), full = solve(problem, RiskSensitive{ { theta } }).value(x0),
               half = solve(problem, RiskSensitive{ { 0.5 * theta } }).value(x0);
  EXPECT_GT(full, neutral.value(x0));
  EXPECT_NEAR((full - neutral.value(x0)) / (half - neutral.value(x0)), 2.0, 0.01);

  problem.noise.clear();
  const auto silent = solve(problem), none = LqSolution<4, 2>(silent);
  EXPECT_NEAR(solve(problem, RiskSensitive{}).value(x0), none.value(x0), kSame * scaled(none.value(x0)));
  problem.noise.push_back(NoiseSource::fromFactor("zero", MatrixXd::Zero(4, 2)));
  for (const double any : { -1e6, 1e6 })
  {
    const auto risk = solve(problem, RiskSensitive{ { any } });
    EXPECT_LT(largestDifference(silent.gains, risk.gains), kSame);
    EXPECT_NEAR(risk.value(x0), silent.value(x0), kSame * scaled(silent.value(x0)));
  }
}

// Sigma is all that counts of a factor: E and [E, 0] O with O orthogonal are the same noise.
TEST(RiskSensitive, anyFactorOfTheCovarianceGivesTheSame)
{
  phri_core::Random random(6);
  auto problem = randomProblem(random, 4, 2, 12, 1), wide = problem;
  for (MatrixXd& factor : wide.noise[0].factor)
  {
    MatrixXd padded = MatrixXd::Zero(4, 7);
    padded.leftCols(4) = factor;
    factor = padded * randomMatrix(random, 7, 7).householderQr().householderQ().operator*(MatrixXd::Identity(7, 7));
  }
  for (const double share : { -2.0, 0.95 })
  {
    const RiskSensitive attitude{ { share * thetaMax(problem, 0) } };
    const auto a = solve(problem, attitude), b = solve(wide, attitude);
    EXPECT_LT(largestDifference(a.gains, b.gains), kExact);
    EXPECT_NEAR(a.value(start(4)), b.value(start(4)), kExact * scaled(a.value(start(4))));
  }
}

TEST(RiskSensitive, costsTimesCNeedThetaByC)
{
  phri_core::Random random(7);
  const auto problem = randomProblem(random, 4, 2, 12, 2);
  const RiskSensitive attitude{ { 0.6 * thetaMax(problem, 0), -1.0 } };
  const auto plain = solve(problem, attitude);
  constexpr double kFactor = 37.0;
  auto costly = problem;
  lq_fixtures::scaleCost(costly, kFactor);
  const auto other = solve(costly, RiskSensitive{ { attitude.theta[0] / kFactor, attitude.theta[1] / kFactor } });
  EXPECT_LT(largestDifference(plain.gains, other.gains), kSame);
  EXPECT_NEAR(other.value(start(4)), kFactor * plain.value(start(4)), kSame * kFactor * scaled(plain.value(start(4))));
  EXPECT_NEAR(thetaMax(costly, 0) * kFactor, thetaMax(problem, 0), 3.0 * kThetaTolerance * thetaMax(problem, 0));
}

// log E exp(theta J) / theta is a generalised mean, so it does not decrease in theta, nor does its minimum.
TEST(RiskSensitive, valueDoesNotDecreaseInTheta)
{
  phri_core::Random random(8);
  for (int trial = 0; trial < 20; ++trial)
  {
    const auto problem = randomProblem<3, 2>(random, 3, 2, 10, 1);
    const double limit = thetaMax(problem, 0);
    double last = -std::numeric_limits<double>::infinity();
    for (const double share : { -1e3, -10.0, -1.0, -0.1, 0.0, 1e-6, 0.1, 0.5, 0.9, 0.999 })
    {
      const double value = solve(problem, RiskSensitive{ { share * limit } }).value(start(3));
      EXPECT_GT(value, last) << "share " << share;
      last = value;
    }
  }
}

TEST(RiskSensitive, fixedAndDynamicSizesAgree)
{
  phri_core::Random one(9), two(9);
  const auto fixed = randomProblem<4, 2>(one, 4, 2, 20, 3);
  const auto dynamic = randomProblem(two, 4, 2, 20, 3);
  const RiskSensitive attitude{ { 0.01, -0.5, 0.0 } };
  const auto a = solve(fixed, attitude);
  const auto b = solve(dynamic, attitude);
  for (std::size_t k = 0; k < 20; ++k)
    EXPECT_LT((a.gains[k] - b.gains[k]).cwiseAbs().maxCoeff(), kSame * scaled(a.gains[k].cwiseAbs().maxCoeff()));
  EXPECT_NEAR(a.value(start(4)), b.value(start(4)), kSame * scaled(a.value(start(4))));
}

TEST(RiskSensitive, fixedSizesAllocateNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations are not counted under AddressSanitizer";
  phri_core::Random random(10);
  const auto problem = randomProblem<4, 2>(random, 4, 2, 50, 2);
  const double limit = thetaMax(problem, 0);
  const RiskSensitive fine{ { 0.5 * limit, -0.5 } }, beyond{ { 2.0 * limit, -0.5 } };
  auto solution = solve(problem, fine);
  const auto gains = solution.gains;
  const auto feedforward = solution.feedforward;
  RiskEvaluation<4> evaluation = evaluate(problem, fine, gains, feedforward);
  EXPECT_EQ(phri_core::testing::countAllocations([&] {
              solve(problem, fine, solution);
              evaluate(problem, fine, gains, feedforward, evaluation);
              solve(problem, beyond, solution);
              solveWithFallback(problem, beyond, solution);
            }),
            0);
  EXPECT_TRUE(evaluation.status);
  EXPECT_TRUE(solution.status);
}
