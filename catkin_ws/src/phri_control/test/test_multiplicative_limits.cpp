// Control under multiplicative noise: the infinite horizon with its threshold, breakdown, bad input, every end typed.
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <limits>

#include "multiplicative_oracle.hpp"

using namespace multiplicative_oracle;

namespace
{
/// x+ = a x + b u + state x w1 + control u w2, cost 1/2 (x^2 + r u^2).
Problem scalar(double a, double b, double r, double state, double control, int horizon)
{
  Problem problem;
  LqStage<> stage = LqStage<>::zero(1, 1);
  stage.A << a;
  stage.B << b;
  stage.Q << 1.0;
  stage.R << r;
  problem.lq.stages.assign(horizon, stage);
  problem.lq.terminal = LqTerminal<>::zero(1);
  const MatrixXd one = MatrixXd::Ones(1, 1), zero = MatrixXd::Zero(1, 1);
  const NoiseChannel x = NoiseChannel::fromMatrices(state * one, zero, VectorXd::Zero(1));
  const NoiseChannel u = NoiseChannel::fromMatrices(zero, control * one, VectorXd::Zero(1));
  problem.noise = { { "hand", { x, u } } };
  return problem;
}
}  // namespace

// The infinite horizon of a scalar system: W solves a quadratic equation, and signal-dependent noise lowers the gain.
TEST(MultiplicativeLimits, signalDependentNoiseLowersTheGainToTheClosedForm)
{
  constexpr double kStationary = 1e-11;  // relative: the tolerance of the recursion over its contraction
  double last = std::numeric_limits<double>::infinity();
  for (const double f : { 0.0, 0.2, 0.5, 1.0 })
  {
    const double a = 0.99, b = 0.1, r = 0.02, effect = b * b * (1.0 + f * f);
    // W = 1 + a^2 W - (a b W)^2 / (r + effect W), times the denominator
    const double two = effect - a * a * effect + a * a * b * b, one = r - effect - a * a * r, zero = -r;
    const double W = (-one + std::sqrt(one * one - 4.0 * two * zero)) / (2.0 * two);
    const double gain = -a * b * W / (r + effect * W);
    const auto problem = scalar(a, b, r, 0.0, f * b, 400);
    const auto stationary = meanSquareGain(problem);
    ASSERT_EQ(stationary.status, MeanSquareGain::Status::Converged);
    EXPECT_NEAR(stationary.gain(0, 0), gain, kStationary * std::abs(gain));
    EXPECT_NEAR(solve(problem).gains[0](0, 0), gain, kStationary * std::abs(gain));
    EXPECT_LT(std::abs(gain), last);
    last = std::abs(gain);
  }
}

// Athans, Ku and Gershwin (1977): a stationary gain exists if and only if sa^2 + a^2 - (a b)^2/(b^2 + sb^2) < 1.
TEST(MultiplicativeLimits, uncertaintyThresholdEndsInAStatus)
{
  const double a = 1.1, b = 0.5, state = 0.4;
  const double critical = std::sqrt(a * a * b * b / (state * state + a * a - 1.0) - b * b);
  const auto below = meanSquareGain(scalar(a, b, 0.1, state, 0.999 * critical, 1));
  EXPECT_EQ(below.status, MeanSquareGain::Status::Converged);
  EXPECT_TRUE(below.gain.allFinite());
  const auto above = meanSquareGain(scalar(a, b, 0.1, state, 1.001 * critical, 1));
  EXPECT_EQ(above.status, MeanSquareGain::Status::NotStabilisable);
  EXPECT_EQ(above.gain.size(), 0);
  EXPECT_EQ(meanSquareGain(scalar(a, b, 0.1, state, 0.999 * critical, 1), 1e-13, 10).status,
            MeanSquareGain::Status::IterationLimit);

  // rotated so that no element tells: one mode beyond the threshold, the other well below it
  for (const double factor : { 0.99, 1.01 })
  {
    Problem plane;
    LqStage<> stage = LqStage<>::zero(2, 2);
    const Eigen::Matrix2d turn = Eigen::Rotation2Dd(0.7).toRotationMatrix();
    stage.A = turn * Eigen::Vector2d(a, 0.5).asDiagonal() * turn.transpose();
    stage.B = turn * b;
    stage.Q.setIdentity();
    stage.R.setIdentity();
    plane.lq.stages = { stage };
    plane.lq.terminal = LqTerminal<>::zero(2);
    MatrixXd C = turn * Eigen::Vector2d(state, 0.0).asDiagonal() * turn.transpose();
    MatrixXd D = turn * Eigen::Vector2d(factor * critical, 0.0).asDiagonal();
    const VectorXd none = VectorXd::Zero(2);
    plane.noise = { { "hand",
                      { NoiseChannel::fromMatrices(C, MatrixXd::Zero(2, 2), none),
                        NoiseChannel::fromMatrices(MatrixXd::Zero(2, 2), D, none) } } };
    const auto result = meanSquareGain(plane);
    EXPECT_EQ(result.status == MeanSquareGain::Status::Converged, factor < 1.0);
    EXPECT_EQ(bool(result), result.gain.size() > 0);
  }
}

TEST(MultiplicativeLimits, breakdownWhereAnEigenvalueSays)
{
  phri_core::Random random(8);
  const auto problem = randomProblem(random, 3, 2, 1, 0, 2, 0.3);
  const auto points = randomPoints(random, problem);
  VectorXd z(6);
  z << points.states[0], points.controls[0], 1.0;
  MatrixXd E(3, 2);
  E << problem.noise[0].channels[0].at(0) * z, problem.noise[0].channels[1].at(0) * z;
  const MatrixXd P = E.transpose() * problem.lq.terminal.Q * E;
  const double limit = 1.0 / Eigen::SelfAdjointEigenSolver<MatrixXd>(P).eigenvalues()(1);
  EXPECT_NO_THROW(solve(problem, RiskSensitive{ { (1.0 - 1e-9) * limit } }, points));
  try
  {
    solve(problem, RiskSensitive{ { (1.0 + 1e-9) * limit } }, points);
    FAIL();
  }
  catch (const RiskBreakdown& error)
  {
    EXPECT_EQ(error.status().kind, BreakdownKind::Expectation);
    EXPECT_EQ(error.status().stage, 0);
    EXPECT_EQ(error.status().source, 0);
    EXPECT_NEAR(error.status().limit, limit, kExact * limit);
  }
  MultiplicativeSolution<> solution;
  EXPECT_EQ(solve(problem, variance(1, -100.0), solution, points).kind, BreakdownKind::Hessian);
  auto broken = problem;
  broken.noise[0].channels[0].map[0](0, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(solve(broken, solution).kind, BreakdownKind::NotFinite);
  EXPECT_EQ(solve(broken, RiskSensitive{ { 0.1 } }, solution).kind, BreakdownKind::NotFinite);
  EXPECT_THROW(solve(broken), std::invalid_argument);
}

TEST(MultiplicativeLimits, badInputIsNamed)
{
  phri_core::Random random(9);
  auto problem = randomProblem(random, 3, 2, 2, 1, 2);
  const auto message = [&](const std::function<void()>& call) -> std::string {
    try
    {
      call();
    }
    catch (const std::invalid_argument& error)
    {
      return error.what();
    }
    return "nothing thrown";
  };
  EXPECT_NE(message([&] { solve(problem, CostCumulants{ MatrixXd::Zero(2, 2) }); }).find("K = 3"), std::string::npos);
  EXPECT_NE(message([&] { solve(problem, variance(1, 0.1)); }).find("1 rows, expected 2"), std::string::npos);
  EXPECT_NE(message([&] { solve(problem, RiskSensitive{ { 0.1 } }); }).find("1 thetas, expected 2"), std::string::npos);
  EXPECT_NE(message([&] {
              solve(problem, variance(2, 0.1), { { VectorXd::Zero(3) }, {} });
            }).find("1 states"),
            std::string::npos);
  EXPECT_NE(message([&] {
              NoiseChannel::fromMatrices(MatrixXd::Zero(3, 3), MatrixXd::Zero(2, 2), VectorXd::Zero(3));
            }).find("channel D"),
            std::string::npos);
  problem.noise[0].channels[1].map[0].resize(3, 5);
  EXPECT_NE(message([&] { solve(problem); }).find("noise \"hand\".channels[1].map"), std::string::npos);
  auto negative = scalar(1.0, 1.0, 1.0, 0.1, 0.1, 1);
  negative.lq.stages[0].Q << -1.0;
  EXPECT_NE(message([&] { meanSquareGain(negative); }).find("eigenvalue -1"), std::string::npos);
}

// 2000 random problems of all sizes of noise: what is returned is finite, what is not has a kind.
TEST(MultiplicativeLimits, everyEndIsTyped)
{
  phri_core::Random random(10);
  int solved = 0, broken = 0;
  for (int trial = 0; trial < 2000; ++trial)
  {
    const auto problem = randomProblem(random, 2, 1, 5, trial % 2, 2, std::pow(10.0, random.uniform(-2.0, 0.5)));
    MultiplicativeSolution<> solution;
    const double size = random.uniform(-0.5, 0.5);
    const RiskSensitive risk{ std::vector<double>(problem.sources(), size) };
    const RiskStatus status = trial % 3 == 0   ? solve(problem, solution)
                              : trial % 3 == 1 ? solve(problem, risk, solution)
                                               : solve(problem, variance(problem.sources(), size), solution);
    status ? ++solved : ++broken;
    EXPECT_EQ(bool(status), status.stage == -1);
    for (std::size_t k = 0; status && k < 5; ++k)
      EXPECT_TRUE(solution.gains[k].allFinite() && solution.feedforward[k].allFinite());
  }
  EXPECT_GT(solved, 500);
  EXPECT_GT(broken, 100);
}
