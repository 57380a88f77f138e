// The Riccati recursion against oracles that do not recurse: the stacked (condensed) least-squares problem, the exact
// expected cost of any affine policy by forward propagation of mean and covariance, and the adjoint residual.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <limits>

#include "lq_fixtures.hpp"
#include "phri_control/lq_solver.hpp"
#include "phri_core/gaussian.hpp"
#include "phri_core/random.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace
{
constexpr double kExact = 1e-10;  // two dense factorisations of well-conditioned problems of some 50 unknowns

using lq_fixtures::randomMatrix;

/// Time-varying, affine, with drift, constants and two sources of noise, one of them singular and time-varying.
template <int N, int M>
LinearQuadraticProblem<N, M> randomProblem(std::uint64_t seed, Eigen::Index n, Eigen::Index m, int horizon)
{
  phri_core::Random random(seed);
  LinearQuadraticProblem<N, M> problem;
  std::vector<MatrixXd> factors;
  for (int k = 0; k < horizon; ++k)
  {
    problem.stages.push_back(lq_fixtures::randomStage<N, M>(random, n, m, 1.0, 0.3, 1.0));
    factors.push_back(randomMatrix(random, n, 1));
  }
  problem.terminal = lq_fixtures::randomTerminal<N>(random, n);
  problem.noise = { NoiseSource::fromFactor("varying", factors),
                    NoiseSource::fromCovariance("full", lq_fixtures::randomDefinite(random, n)) };
  return problem;
}

/// Cost of a noise-free trajectory from xi at stage `first` under the controls `u` (m, T - first).
template <int N, int M>
double costOf(const LinearQuadraticProblem<N, M>& problem, std::size_t first, VectorXd xi, const MatrixXd& u)
{
  double cost = 0.0;
  for (std::size_t k = first; k < problem.horizon(); ++k)
  {
    const LqStage<N, M>& stage = problem.stages[k];
    const VectorXd uk = u.col(k - first);
    cost += 0.5 * xi.dot(stage.Q * xi) + stage.q.dot(xi) + stage.q0 + 0.5 * uk.dot(stage.R * uk) + stage.r.dot(uk);
    xi = VectorXd(stage.A * xi + stage.B * uk + stage.d);
  }
  return cost + 0.5 * xi.dot(problem.terminal.Q * xi) + problem.terminal.q.dot(xi) + problem.terminal.q0;
}

/// Optimal controls from xi at stage `first` on: the states are eliminated, J = 1/2 U'H U + f'U + const, U = -H^-1 f.
template <int N, int M>
MatrixXd stackedControls(const LinearQuadraticProblem<N, M>& problem, std::size_t first, const VectorXd& xi)
{
  const Eigen::Index n = problem.stateSize(), m = problem.controlSize(), steps = problem.horizon() - first;
  MatrixXd H = MatrixXd::Zero(steps * m, steps * m), S = MatrixXd::Zero(n, steps * m);
  VectorXd f = VectorXd::Zero(steps * m), h = xi;  // state = S U + h
  for (Eigen::Index i = 0; i < steps; ++i)
  {
    const LqStage<N, M>& stage = problem.stages[first + i];
    H += S.transpose() * stage.Q * S;
    f += S.transpose() * (stage.Q * h + stage.q);
    H.block(i * m, i * m, m, m) += stage.R;
    f.segment(i * m, m) += stage.r;
    S = MatrixXd(stage.A * S);
    S.middleCols(i * m, m) += stage.B;
    h = VectorXd(stage.A * h + stage.d);
  }
  H += S.transpose() * problem.terminal.Q * S;
  f += S.transpose() * (problem.terminal.Q * h + problem.terminal.q);
  const VectorXd U = H.ldlt().solve(-f);
  return Eigen::Map<const MatrixXd>(U.data(), m, steps);
}

/// E J of the affine policy of `solution` from xi, exactly: mean and covariance of the state go forward.
template <int N, int M>
double expectedCost(const LinearQuadraticProblem<N, M>& problem, const LqSolution<N, M>& solution, VectorXd mean)
{
  const Eigen::Index n = problem.stateSize();
  MatrixXd P = MatrixXd::Zero(n, n);
  double cost = 0.0;
  for (std::size_t k = 0; k < problem.horizon(); ++k)
  {
    const LqStage<N, M>& stage = problem.stages[k];
    const MatrixXd L = solution.gains[k];
    const VectorXd u = L * mean + solution.feedforward[k];
    cost += 0.5 * mean.dot(stage.Q * mean) + stage.q.dot(mean) + stage.q0 + 0.5 * u.dot(stage.R * u) + stage.r.dot(u);
    cost += 0.5 * ((stage.Q + L.transpose() * stage.R * L) * P).trace();
    const MatrixXd closed = stage.A + stage.B * L;
    mean = VectorXd(stage.A * mean + stage.B * u + stage.d);
    P = MatrixXd(closed * P * closed.transpose());
    for (const NoiseSource& source : problem.noise)
      P += source.at(k) * source.at(k).transpose();
  }
  cost += 0.5 * mean.dot(problem.terminal.Q * mean) + problem.terminal.q.dot(mean) + problem.terminal.q0;
  return cost + 0.5 * (problem.terminal.Q * P).trace();
}

template <int N, int M>
void expectStackedSolution(std::uint64_t seed, Eigen::Index n, Eigen::Index m)
{
  constexpr int kHorizon = 12;
  auto problem = randomProblem<N, M>(seed, n, m, kHorizon);
  const LqSolution<N, M> solution = solve(problem);
  ASSERT_TRUE(solution.status.ok);
  for (int k = 0; k < kHorizon; ++k)
  {
    const VectorXd l = stackedControls(problem, k, VectorXd::Zero(n)).col(0);
    EXPECT_LT((solution.feedforward[k] - l).norm(), kExact * (1.0 + l.norm())) << "stage " << k;
    for (Eigen::Index i = 0; i < n; ++i)
    {
      const VectorXd column = stackedControls(problem, k, VectorXd::Unit(n, i)).col(0) - l;
      EXPECT_LT((solution.gains[k].col(i) - column).norm(), kExact * (1.0 + column.norm())) << "stage " << k;
    }
  }
  problem.noise.clear();
  const VectorXd xi = VectorXd::LinSpaced(n, -1.0, 2.0);
  const double cost = costOf(problem, 0, xi, stackedControls(problem, 0, xi));
  EXPECT_NEAR(solve(problem).value(xi), cost, kExact * (1.0 + std::abs(cost)));
}
}  // namespace

// A finite-horizon LQ problem without noise is one quadratic function of all controls together: its minimiser from
// every stage and state is the policy (certainty equivalence), its minimum the value.
TEST(LqSolver, equalsTheStackedLeastSquaresSolution)
{
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
  {
    expectStackedSolution<4, 2>(seed, 4, 2);
    expectStackedSolution<Eigen::Dynamic, Eigen::Dynamic>(seed, 3, 1);
    expectStackedSolution<Eigen::Dynamic, Eigen::Dynamic>(seed, 6, 3);
  }
}

// The value with its constant 1/2 tr(W Sigma) is the expected cost of the policy itself.
TEST(LqSolver, valueIsTheExpectedCostOfItsPolicy)
{
  const auto problem = randomProblem<4, 2>(11, 4, 2, 30);
  const auto solution = solve(problem);
  for (const VectorXd& xi : { VectorXd(VectorXd::Zero(4)), VectorXd(VectorXd::LinSpaced(4, -3.0, 2.0)) })
  {
    const double cost = expectedCost(problem, solution, xi);
    EXPECT_NEAR(solution.value(xi), cost, kExact * std::abs(cost));
  }
}

// The policy is the global minimiser over affine policies: any other one costs more.
TEST(LqSolver, perturbingThePolicyNeverLowersTheCost)
{
  const auto problem = randomProblem<4, 2>(12, 4, 2, 20);
  const auto solution = solve(problem);
  const VectorXd xi = VectorXd::LinSpaced(4, -1.0, 1.0);
  const double best = expectedCost(problem, solution, xi);
  phri_core::Random random(13);
  for (int trial = 0; trial < 300; ++trial)
  {
    auto other = solution;
    const int k = static_cast<int>(random.uniform(0.0, 20.0));
    const double size = std::pow(10.0, random.uniform(-3.0, 0.0));
    other.gains[k] += size * randomMatrix(random, 2, 4);
    other.feedforward[k] += size * randomMatrix(random, 2, 1);
    // curvature H >= R >= 0.1 makes the rise at least 0.05 (size)^2 |n|^2 >> rounding of a cost of a few hundred
    EXPECT_GT(expectedCost(problem, other, xi), best) << "stage " << k << " size " << size;
  }
}

TEST(LqSolver, residualIsZeroForTheSolutionAndSeesAWrongGain)
{
  const auto problem = randomProblem<4, 2>(14, 4, 2, 40);
  auto solution = solve(problem);
  EXPECT_LT(residual(problem, solution), 1e-11);
  solution.gains[17](1, 2) *= 1.0 + 1e-3;
  EXPECT_GT(residual(problem, solution), 1e-6);
}

template <int N, int M>
void expectFixedAsDynamic()
{
  SCOPED_TRACE(std::to_string(N) + " states");
  const auto a = solve(randomProblem<N, M>(15, N, M, 50));
  const auto b = solve(randomProblem<Eigen::Dynamic, Eigen::Dynamic>(15, N, M, 50));
  constexpr double kRounding = 1e-11;  // other order of additions, some of which cancel
  for (std::size_t k = 0; k < 50; ++k)
    EXPECT_LT((a.gains[k] - b.gains[k]).norm(), kRounding * (1.0 + a.gains[k].norm()));
  EXPECT_LT((a.value.W - b.value.W).norm(), kRounding * a.value.W.norm());
  EXPECT_EQ((a.value.W - a.value.W.transpose()).norm(), 0.0);
  EXPECT_NEAR(a.value.c, b.value.c, kRounding * std::abs(a.value.c));
}

TEST(LqSolver, fixedAndDynamicSizesAgree)
{
  expectFixedAsDynamic<4, 2>();
  expectFixedAsDynamic<8, 2>();  // by quarters
  expectFixedAsDynamic<12, 3>();
}

// If r = -R u* and mu is the path of u*, then u = u*, xi = mu has no cost to gain from leaving it: zero error exactly.
TEST(LqSolver, tracksAReachableReferenceWithoutError)
{
  auto problem = randomProblem<4, 2>(16, 4, 2, 60);
  phri_core::Random random(17);
  VectorXd mu = VectorXd::LinSpaced(4, -1.0, 1.0);
  const VectorXd start = mu;
  std::vector<VectorXd> path{ mu }, controls;
  for (LqStage<4, 2>& stage : problem.stages)
  {
    controls.push_back(-0.3 * stage.B.transpose() * mu + 0.1 * randomMatrix(random, 2, 1));
    stage.q = -stage.Q * mu;
    stage.r = -stage.R * controls.back();
    mu = VectorXd(stage.A * mu + stage.B * controls.back() + stage.d);
    path.push_back(mu);
  }
  problem.terminal.q = -problem.terminal.Q * mu;
  const auto solution = solve(problem);
  VectorXd xi = start;
  for (std::size_t k = 0; k < problem.horizon(); ++k)
  {
    const VectorXd u = solution.gains[k] * xi + solution.feedforward[k];
    EXPECT_LT((u - controls[k]).norm(), 1e-8 * (1.0 + controls[k].norm()));
    xi = VectorXd(problem.stages[k].A * xi + problem.stages[k].B * u + problem.stages[k].d);
    EXPECT_LT((xi - path[k + 1]).norm(), 1e-8 * (1.0 + path[k + 1].norm()));
  }
}

// Figure 5.13: M = 1 kg, D = 1 Ns/m, R = 1. The stationary position gain of a mass-damper is sqrt(Q/s2) in continuous
// time, whatever the velocity weight and the damping; at 1 kHz it is lower by about half the sample's share, Kv dt / M.
TEST(LqSolver, stationaryPositionGainIsTheRootOfTheMahalanobisWeight)
{
  constexpr double kDt = 1e-3, kVarianceOfVelocity = 0.3;
  for (const double q : { 1.0, 10.0, 100.0, 1000.0 })
    for (const double s2 : { 0.1, 0.3, 0.5 })
    {
      const MatrixXd covariance = Eigen::Vector2d(s2, kVarianceOfVelocity).asDiagonal();
      const MatrixXd root = phri_core::inverseSquareRoot(covariance, 1e-8);
      LqStage<2, 1> stage = LqStage<2, 1>::zero();
      stage.A << 1.0, kDt, 0.0, 1.0 - kDt;
      stage.B << 0.0, kDt;
      stage.Q = root * (q * MatrixXd::Identity(2, 2)) * root;
      stage.R(0, 0) = 1.0;
      LinearQuadraticProblem<2, 1> problem;
      problem.stages.assign(40000, stage);  // 40 s: the slowest pole, of Q = 1, s2 = 0.5, is near 0.6 /s
      problem.terminal = LqTerminal<2>::zero();
      const Eigen::RowVector2d L = solve(problem).gains[0];
      const double expected = std::sqrt(q / s2), damping = -L(1);
      EXPECT_NEAR(-L(0), expected, kDt * (1.0 + damping) * expected) << "Q " << q << " s2 " << s2;
      EXPECT_LT(-L(0), 200.0);  // the axis of the figure
    }
}

TEST(LqSolver, reportsTheStageWithoutAMinimum)
{
  auto problem = randomProblem<4, 2>(18, 4, 2, 10);
  problem.stages[3].R -= 1e6 * Eigen::Matrix2d::Identity();
  const LqStatus status = solve(problem).status;
  EXPECT_FALSE(status.ok);
  EXPECT_EQ(status.kind, LqFailure::Hessian);
  EXPECT_EQ(status.stage, 3);
}

TEST(LqSolver, refusesNonFiniteProblemsByStatusOnTheFastPathAndByNameOnTheOther)
{
  for (const double bad : { std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity() })
  {
    auto weight = randomProblem<4, 2>(19, 4, 2, 10), linear = weight;
    weight.stages[6].Q(2, 2) = bad;
    linear.stages[6].q(2) = bad;
    LqSolution<4, 2> solution;
    for (const auto* problem : { &weight, &linear })
    {
      EXPECT_FALSE(solve(*problem, solution).ok);
      EXPECT_EQ(solution.status.kind, LqFailure::NotFinite);
      EXPECT_EQ(solution.status.stage, 5);  // the first whose future holds it
      EXPECT_THROW(solve(*problem), std::invalid_argument);
    }
  }
}

TEST(LqSolver, fixedSizesAllocateNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations are not counted under AddressSanitizer";
  const auto problem = randomProblem<4, 2>(20, 4, 2, 200);
  LqSolution<4, 2> solution = solve(problem);
  EXPECT_EQ(phri_core::testing::countAllocations([&] { solve(problem, solution); }), 0);
}
