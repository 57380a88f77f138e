// Control under multiplicative noise, against the exact moments and the quadrature of multiplicative_oracle.hpp, and in
// its limiting cases. test_multiplicative_limits.cpp has where it ends without a policy.
#include "multiplicative_oracle.hpp"
#include "phri_control/cost_cumulants.hpp"
#include "phri_control/risk_sensitive.hpp"
#include "phri_core/testing.hpp"

using namespace multiplicative_oracle;

namespace
{
constexpr double kSame = 1e-12;  // relative: the same sums in another order
}  // namespace

// C = D = 0: the channels' constants are the columns of an additive factor, at any expansion points.
TEST(MultiplicativeNoise, constantChannelsAreTheAdditiveSolvers)
{
  phri_core::Random random(1);
  for (int trial = 0; trial < 10; ++trial)
  {
    const auto plain = risk_oracle::randomProblem(random, 4, 2, 8, 2);
    Problem problem{ plain, { { "channels", {} } } };
    problem.lq.noise.pop_back();  // the last source becomes channels: additive and multiplicative mixed
    for (Eigen::Index i = 0; i < plain.noise[1].at(0).cols(); ++i)
    {
      NoiseChannel channel;
      for (std::size_t k = 0; k < plain.horizon(); ++k)
      {
        channel.map.push_back(MatrixXd::Zero(4, 7));
        channel.map.back().col(6) = plain.noise[1].at(k).col(i);
      }
      problem.noise[0].channels.push_back(channel);
    }
    const VectorXd x0 = VectorXd::LinSpaced(4, -1.0, 2.0);
    const auto points = randomPoints(random, problem);
    for (const double share : { -2.0, 0.0, 1e-9, 0.5 })
    {
      const RiskSensitive attitude{ { share * thetaMax(plain, 0), 0.5 * share * thetaMax(plain, 1) } };
      const auto expected = solve(plain, attitude);
      const auto solution = solve(problem, attitude);
      EXPECT_LT(largestDifference(solution.gains, expected.gains), kSame) << share;
      EXPECT_LT(largestDifference(solution.feedforward, expected.feedforward), kSame) << share;
      EXPECT_NEAR(solution.value(x0), expected.value(x0), kSame * (1.0 + std::abs(expected.value(x0)))) << share;
      EXPECT_LT(largestDifference(solve(problem, attitude, points).gains, expected.gains), kExact) << share;
    }
    const auto expected = solve(plain, variance(2, 0.05));
    const auto solution = solve(problem, variance(2, 0.05));
    EXPECT_LT(largestDifference(solution.gains, expected.gains), kSame);
    EXPECT_NEAR(solution.value(x0), expected.value(x0), kSame * (1.0 + std::abs(expected.value(x0))));
    for (int s = 0; s < 2; ++s)
    {
      const double kappa = expected.cumulants(x0)(s, 1);
      EXPECT_NEAR(solution.variances[s](x0), kappa, kSame * (1.0 + kappa));
    }
    const auto neutral = solve(plain);
    EXPECT_LT(largestDifference(solve(problem).gains, neutral.gains), kSame);
    EXPECT_NEAR(solve(problem).value(x0), neutral.value(x0), kSame * (1.0 + std::abs(neutral.value(x0))));
  }
}

TEST(MultiplicativeNoise, meanOfAnyPolicyIsExactAndTheOptimumStationary)
{
  constexpr double kStep = 1e-4, kGradient = 1e-7;  // curvature times step squared
  phri_core::Random random(2);
  const auto problem = randomProblem(random, 2, 2, 3, 1, 1, 0.4);
  auto policy = solve(problem);
  const VectorXd x0 = VectorXd::LinSpaced(2, -1.0, 2.0);
  const auto oracle = [&] { return enumerate(problem, policy.gains, policy.feedforward, x0).mean; };
  EXPECT_NEAR(policy.value(x0), oracle(), kExact * (1.0 + std::abs(oracle())));
  for (std::size_t k = 0; k < 3; ++k)
    for (Eigen::Index i = 0; i < 2; ++i)
      for (Eigen::Index j = 0; j < 3; ++j)
      {
        double& element = j < 2 ? policy.gains[k](i, j) : policy.feedforward[k](i);
        const double kept = element;
        element = kept + kStep;
        const double up = oracle();
        element = kept - kStep;
        const double down = oracle();
        element = kept;
        EXPECT_NEAR((up - down) / (2.0 * kStep), 0.0, kGradient) << k << i << j;
      }
  for (auto& gain : policy.gains)
    gain += 0.3 * randomMatrix(random, 2, 2);
  EXPECT_NEAR(evaluate(problem, policy.gains, policy.feedforward).value(x0), oracle(),
              kExact * (1.0 + std::abs(oracle())));
}

TEST(MultiplicativeNoise, oneStageVarianceHasTheExactTaylorCoefficients)
{
  phri_core::Random random(3);
  for (int trial = 0; trial < 5; ++trial)
  {
    const auto problem = randomProblem(random, 3, 2, 1, 0, 3, 0.5);
    const Gains L{ randomMatrix(random, 2, 3) };
    const Feedforward l{ randomMatrix(random, 2, 1) };
    const VectorXd center = randomMatrix(random, 3, 1);
    const auto taylor = evaluate(problem, variance(1, 1.0), L, l, expandAlong(problem, L, l, center));
    expectTaylor(
        taylor.variances[0], [&](const VectorXd& xi) { return enumerate(problem, L, l, xi).variance; }, center);
  }
}

TEST(MultiplicativeNoise, oneStageRiskHasTheTaylorCoefficientsOfTheQuadrature)
{
  phri_core::Random random(4);
  for (const double share : { -1.5, 0.4 })
  {
    auto problem = randomProblem(random, 2, 1, 1, 0, 2, 0.2);
    const Gains L{ randomMatrix(random, 1, 2) };
    const Feedforward l{ randomMatrix(random, 1, 1) };
    const VectorXd center = randomMatrix(random, 2, 1);
    VectorXd z(4);
    z << center, L[0] * center + l[0], 1.0;
    MatrixXd E(2, 2);
    E << problem.noise[0].channels[0].at(0) * z, problem.noise[0].channels[1].at(0) * z;
    const RiskSensitive attitude{ { share * detail::thetaLimit(problem.lq.terminal.Q, E, true) } };
    const auto taylor = evaluate(problem, attitude, L, l, expandAlong(problem, L, l, center));
    expectTaylor(
        taylor.values[0], [&](const VectorXd& xi) { return gridRisk(problem, attitude.theta[0], L[0], l[0], xi); },
        center);
  }
}

// Solving about its own mean trajectory again and again ends where the exact criterion of one stage is stationary.
TEST(MultiplicativeNoise, fixedPointOfTheExpansionIsStationaryForTheExactCriterion)
{
  constexpr double kStep = 1e-4, kGradient = 1e-7;
  phri_core::Random random(5);
  const auto problem = randomProblem(random, 2, 2, 1, 0, 2, 0.3);
  const VectorXd x0 = randomMatrix(random, 2, 1);
  const double gamma = 0.05;
  ExpansionPoints<> points;
  MultiplicativeSolution<> solution;
  for (int pass = 0; pass < 60; ++pass)
  {
    solution = solve(problem, variance(1, gamma), points);
    points = expandAlong(problem, solution.gains, solution.feedforward, x0);
  }
  const auto exact = [&] {
    const Moments moments = enumerate(problem, solution.gains, solution.feedforward, x0);
    return moments.mean + gamma * moments.variance;
  };
  EXPECT_NEAR(solution.value(x0), exact(), kExact * (1.0 + std::abs(exact())));
  for (Eigen::Index i = 0; i < 2; ++i)
  {
    double& element = solution.feedforward[0](i);
    const double kept = element;
    element = kept + kStep;
    const double up = exact();
    element = kept - kStep;
    const double down = exact();
    element = kept;
    EXPECT_NEAR((up - down) / (2.0 * kStep), 0.0, kGradient);
  }
}

// Over several stages the variance is exact up to second order in the state and the constant part of the noise
// together: halving both must divide the error by 8 or more. The error itself must be there, or nothing is tested.
TEST(MultiplicativeNoise, errorOfTheVarianceOverStagesIsOfThirdOrder)
{
  constexpr double kPower = 2.9;  // three, and the higher orders at a finite size
  phri_core::Random random(6);
  const auto full = randomProblem(random, 2, 1, 4, 0, 2, 0.2);
  const auto policy = solve(full);
  const VectorXd direction = VectorXd::LinSpaced(2, -1.0, 2.0);
  const auto error = [&](double size) {
    Problem problem = full;
    for (NoiseChannel& channel : problem.noise[0].channels)
      channel.map[0].col(3) *= size;
    Feedforward none(4, VectorXd::Zero(1));
    for (auto& stage : problem.lq.stages)
      stage.d.setZero();
    const auto model = evaluate(problem, variance(1, 1.0), policy.gains, none);
    const VectorXd x0 = size * direction;
    return std::abs(model.variances[0](x0) - enumerate(problem, policy.gains, none, x0).variance);
  };
  double last = error(0.08);
  EXPECT_GT(last, 1e-6);
  for (const double size : { 0.04, 0.02, 0.01 })
  {
    const double now = error(size);
    EXPECT_GT(std::log2(last / now), kPower) << size;
    last = now;
  }
}

// d/d theta of the value at 0 is half the variance; beyond that the two attitudes part with theta squared.
TEST(MultiplicativeNoise, riskSensitiveIsMeanVarianceToFirstOrder)
{
  phri_core::Random random(7);
  const auto problem = randomProblem(random, 3, 2, 6, 1, 2);
  const auto points = randomPoints(random, problem);
  const auto distance = [&](double theta) {
    const auto risk = solve(problem, RiskSensitive{ { theta, 2.0 * theta } }, points);
    CostCumulants half{ MatrixXd(2, 1) };
    half.gamma << 0.5 * theta, theta;
    return largestDifference(risk.gains, solve(problem, half, points).gains);
  };
  const auto first = [&](double theta) {
    return largestDifference(solve(problem, variance(2, theta), points).gains,
                             solve(problem, variance(2, 0.0), points).gains);
  };
  const double coarse = distance(1e-4), fine = distance(5e-5);
  EXPECT_NEAR(coarse / fine, 4.0, 0.2);
  EXPECT_LT(coarse, 0.1 * first(1e-4));
  const auto limit = solve(problem, RiskSensitive{ { 1e-13, -1e-13 } }, points);
  EXPECT_LT(largestDifference(limit.gains, solve(problem, CostCumulants{ MatrixXd(2, 0) }, points).gains), kExact);
}

TEST(MultiplicativeNoise, fixedSizesAllocateNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP();
  phri_core::Random random(11);
  MultiplicativeNoiseProblem<4, 2> problem{ risk_oracle::randomProblem<4, 2>(random, 4, 2, 10, 2), { { "hand", {} } } };
  for (int j = 0; j < 3; ++j)
    problem.noise[0].channels.push_back(randomChannel(random, 4, 2, 0.1, 0.1));
  const RiskSensitive risk{ { 0.01, -0.01, 0.01 } }, wild{ { 0.0, 0.0, 1e6 } };
  const CostCumulants cumulants = variance(3, 0.01);
  MultiplicativeSolution<4, 2> a, b, c;
  const auto all = [&] {
    solve(problem, a);
    solve(problem, risk, b);
    solve(problem, cumulants, c);
  };
  all();
  ASSERT_TRUE(a.status && b.status && c.status);
  const Problem dynamic = [&] {
    Problem copy;
    copy.lq.terminal = { problem.lq.terminal.Q, problem.lq.terminal.q, problem.lq.terminal.q0 };
    for (const auto& s : problem.lq.stages)
      copy.lq.stages.push_back({ s.A, s.B, s.d, s.Q, s.q, s.q0, s.R, s.r });
    copy.lq.noise = problem.lq.noise;
    copy.noise = problem.noise;
    return copy;
  }();
  EXPECT_LT((solve(dynamic, cumulants).gains[0] - c.gains[0]).norm(), kSame);
  EXPECT_EQ(phri_core::testing::countAllocations(all), 0);
  EXPECT_EQ(phri_core::testing::countAllocations([&] { solve(problem, wild, b); }), 0);
  EXPECT_EQ(b.status.kind, BreakdownKind::Expectation);
}
