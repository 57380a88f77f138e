// Derivatives of functions written once for any scalar: against the analytic ones of the plants, which were written
// apart from them, and against derivatives known by hand; what the solver makes of them.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <future>
#include <limits>
#include <vector>

#include "autodiff_plants.hpp"
#include "iterative_fixtures.hpp"
#include "phri_control/autodiff.hpp"
#include "phri_control/benchmark_plants.hpp"
#include "phri_control/iterative_solver.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;
using namespace autodiff_plants;
using Eigen::Matrix2d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector4d;

namespace
{
constexpr int kStates = 200;
// Both sides are exact but for rounding, which the arm's inverse mass matrix and four stages enlarge by some 100
constexpr double kSame = 1e-10;

double difference(const MatrixXd& a, const MatrixXd& b)
{
  return (a - b).cwiseAbs().maxCoeff() / std::max(1.0, b.cwiseAbs().maxCoeff());
}

/// Largest relative difference between autodiff's derivatives and the plant's analytic ones.
template <typename Rate>
void compareWithPlant(const Plant& plant, const Rate& rate, Integrator integrator)
{
  constexpr int N = Rate::kSize;
  phri_core::Random random(11);
  const Task<Rate> task{ rate };
  const auto problem = autodiff<N, 2>(Stepped<Rate>{ rate, integrator }, task, task, 10, 0.02);
  double step_error = 0.0, first = 0.0, second = 0.0, terminal = 0.0;
  for (int i = 0; i < kStates; ++i)
  {
    const Eigen::Matrix<double, N, 1> x = 2.0 * fixtures::gaussian(random, N, 1);
    const Vector2d u = 5.0 * fixtures::gaussian(random, 2, 1);
    PlantState next;
    PlantMatrix A;
    PlantInput B;
    step(plant, integrator, problem.dt, x, u, next);
    linearise(plant, integrator, problem.dt, x, u, A, B);
    Eigen::Matrix<double, N, 1> own_next;
    Eigen::Matrix<double, N, N> own_A;
    Eigen::Matrix<double, N, 2> own_B;
    problem.dynamics->step(3, x, u, own_next);
    problem.dynamics->linearise(3, x, u, own_A, own_B);
    step_error = std::max(step_error, difference(own_next, next));
    first = std::max({ first, difference(own_A, A), difference(own_B, B) });

    MotionJacobian J;
    plant.motionJacobian(x, J);
    const Vector4d slope = task.weight.cwiseProduct(plant.motion(x) - task.target);
    Eigen::Matrix<double, N, 1> q = J.transpose() * slope;
    PlantMatrix Q = J.transpose() * task.weight.asDiagonal() * J;
    plant.addMotionCurvature(x, slope, Q);
    LqTerminal<N> end = LqTerminal<N>::zero();
    problem.cost->expandTerminal(x, end);
    terminal = std::max({ terminal, difference(end.q, q), difference(end.Q, Q) });
    EXPECT_EQ(end.q0, problem.cost->terminal(x));

    CostExpansion<N, 2> own = CostExpansion<N, 2>::zero();
    problem.cost->expand(3, x, u, own);
    q(2) += 0.1 * u(1) * x(2);
    Q(2, 2) += 0.1 * u(1);
    Eigen::Matrix<double, 2, N> S = Eigen::Matrix<double, 2, N>::Zero();
    S(1, 2) = 0.1 * x(2);
    const Matrix2d R = 0.4 * (Matrix2d() << 2.0, 1.0, 1.0, 4.0).finished();
    const Vector2d r = R * u + Vector2d(0.0, 0.05 * x(2) * x(2));
    EXPECT_EQ(own.q0, problem.cost->running(3, x, u));
    EXPECT_TRUE(own.has_cross);
    EXPECT_EQ(own.Q, own.Q.transpose());
    second = std::max({ second, difference(own.q, q), difference(own.Q, Q), difference(own.S, S), difference(own.R, R),
                        difference(own.r, r) });
  }
  EXPECT_LT(step_error, kSame);
  EXPECT_LT(first, kSame);
  EXPECT_LT(second, kSame);
  EXPECT_LT(terminal, kSame);
}

/// The fixtures' point mass and bump, and their pendulum, once more.
struct Walk
{
  template <typename T>
  Eigen::Matrix<T, 4, 1> operator()(const Eigen::Matrix<T, 4, 1>& x, const Vector2<T>& u) const
  {
    const double dt = fixtures::PointMass::kDt;
    return { x(0) + dt * x(2), x(1) + dt * x(3), x(2) + dt * (u(0) - x(2)), x(3) + dt * (u(1) - x(3)) };
  }
};
struct PassByCost
{
  fixtures::PassBy data;

  template <typename T>
  T operator()(const Eigen::Matrix<T, 4, 1>& x, const Vector2<T>& u) const
  {
    using std::exp;
    const T gx = x(0) - data.goal(0), gy = x(1) - data.goal(1);
    const T ox = x(0) - data.obstacle(0), oy = x(1) - data.obstacle(1);
    const T bump = data.weight * exp(-0.5 / (data.width * data.width) * (ox * ox + oy * oy));
    return fixtures::PointMass::kDt * (0.5 * (gx * gx + gy * gy) + 0.005 * (u(0) * u(0) + u(1) * u(1)) + bump);
  }
};
struct PassByEnd
{
  template <typename T>
  T operator()(const Eigen::Matrix<T, 4, 1>& x) const
  {
    const T gx = x(0) - 1.0, gy = x(1);
    return 2.0 * (gx * gx + gy * gy + 0.1 * (x(2) * x(2) + x(3) * x(3)));
  }
};

OptimalControlProblem<4, 2> passByAutodiff()
{
  auto problem = autodiff<4, 2>(Walk(), PassByCost(), PassByEnd(), 40, fixtures::PointMass::kDt);
  problem.noise = fixtures::passBy().noise;
  return problem;
}

/// Value, slope and curvature of `function` (of one dual number) at x.
template <typename Function>
Eigen::Vector3d derivatives(const Function& function, double x)
{
  const auto cost = [&](const auto& state) {
    using T = std::decay_t<decltype(state(0))>;
    return T(function(state(0)));
  };
  const auto step = [](const auto& state, const auto&) { return std::decay_t<decltype(state)>(state); };
  const auto running = [](const auto&, const auto&) { return 0.0; };
  const auto problem = autodiff<1, 1>(step, running, cost, 1);
  LqTerminal<1> end = LqTerminal<1>::zero();
  problem.cost->expandTerminal(Eigen::Matrix<double, 1, 1>(x), end);
  return { end.q0, end.q(0), end.Q(0, 0) };
}
}  // namespace

TEST(Autodiff, DerivativesOfTheArmAreItsAnalyticOnes)
{
  for (const Integrator integrator : { Integrator::Euler, Integrator::RungeKutta4 })
    compareWithPlant(TwoLinkArm(), ArmRate(), integrator);
}

TEST(Autodiff, DerivativesOfTheCarAreItsAnalyticOnes)
{
  for (const Integrator integrator : { Integrator::Euler, Integrator::RungeKutta4 })
    compareWithPlant(CarLikeRobot(), CarRate(), integrator);
}

TEST(Autodiff, ElementaryFunctionsHaveTheirTextbookDerivatives)
{
  using std::cos, std::cosh, std::exp, std::log, std::sin, std::sinh, std::sqrt, std::tan, std::tanh;
  constexpr double kRounding = 1e-13;  // relative to derivatives of size 10 at most
  const auto expect = [&](const char* name, const Eigen::Vector3d& found, double value, double first, double second) {
    EXPECT_LT((found - Eigen::Vector3d(value, first, second)).cwiseAbs().maxCoeff(), kRounding * 10.0) << name;
  };
  phri_core::Random random(12);
  for (int i = 0; i < 20; ++i)
  {
    const double x = random.uniform(0.3, 1.2), s = sin(x), c = cos(x), t = tan(x), e = exp(x), h = tanh(x);
    expect("sin", derivatives([](auto v) -> decltype(v) { return sin(v); }, x), s, c, -s);
    expect("cos", derivatives([](auto v) -> decltype(v) { return cos(v); }, x), c, -s, -c);
    expect("tan", derivatives([](auto v) -> decltype(v) { return tan(v); }, x), t, 1.0 + t * t,
           2.0 * t * (1.0 + t * t));
    expect("exp", derivatives([](auto v) -> decltype(v) { return exp(v); }, x), e, e, e);
    expect("log", derivatives([](auto v) -> decltype(v) { return log(v); }, x), log(x), 1.0 / x, -1.0 / (x * x));
    expect("sqrt", derivatives([](auto v) -> decltype(v) { return sqrt(v); }, x), sqrt(x), 0.5 / sqrt(x),
           -0.25 / (x * sqrt(x)));
    expect("tanh", derivatives([](auto v) -> decltype(v) { return tanh(v); }, x), h, 1.0 - h * h,
           -2.0 * h * (1.0 - h * h));
    expect("sinh", derivatives([](auto v) -> decltype(v) { return sinh(v); }, x), sinh(x), cosh(x), sinh(x));
    expect("cosh", derivatives([](auto v) -> decltype(v) { return cosh(v); }, x), cosh(x), sinh(x), cosh(x));
    expect("|x|", derivatives([](auto v) -> decltype(v) { return v < 0.0 ? decltype(v)(-v) : v; }, -x), x, -1.0, 0.0);
    expect("1/x", derivatives([](auto v) -> decltype(v) { return 1.0 / v; }, x), 1.0 / x, -1.0 / (x * x),
           2.0 / (x * x * x));
    expect("x^2/(1+x)", derivatives([](auto v) -> decltype(v) { return v * v / (1.0 + v); }, x), x * x / (1.0 + x),
           1.0 - 1.0 / ((1.0 + x) * (1.0 + x)), 2.0 / std::pow(1.0 + x, 3));
    expect("-x", derivatives([](auto v) -> decltype(v) { return 3.0 - v; }, x), 3.0 - x, -1.0, 0.0);
    expect("constant", derivatives([](auto v) -> decltype(v) { return decltype(v)(3.0); }, x), 3.0, 0.0, 0.0);
  }
}

TEST(Autodiff, SolverReachesTheSolutionOfAnalyticDerivatives)
{
  for (const Attitude& attitude : { Attitude(RiskSensitive{ { 20.0 } }), Attitude(RiskSensitive{ { -5.0 } }),
                                    Attitude(CostCumulants{ MatrixXd::Constant(1, 3, 0.5) }) })
  {
    const auto exact = solveIterative(fixtures::passBy(), Vector4d(Vector4d::Zero()), attitude);
    const auto own = solveIterative(passByAutodiff(), Vector4d(Vector4d::Zero()), attitude);
    ASSERT_TRUE(exact) << exact.message();
    ASSERT_TRUE(own) << own.message();
    EXPECT_EQ(own.iterations, exact.iterations);  // the same derivatives make the same path
    EXPECT_NEAR(own.criterion, exact.criterion, 1e-9);
    for (int k = 0; k < 40; ++k)
    {
      EXPECT_LT((own.nominal.states[k + 1] - exact.nominal.states[k + 1]).norm(), 1e-9);
      EXPECT_LT((own.policy.gains[k] - exact.policy.gains[k]).norm(), 1e-8 * (1.0 + exact.policy.gains[k].norm()));
    }
  }
}

// The other way to a solution without derivatives by hand: it differs by the differences' own error.
TEST(Autodiff, SolvesTheArmAsItsDifferencesDo)
{
  struct Differences : detail::AutodiffDynamics<4, 2, Stepped<ArmRate>>::Dynamics
  {
    std::shared_ptr<const Dynamics<4, 2>> of;
    Eigen::Index stateSize() const override { return 4; }
    Eigen::Index controlSize() const override { return 2; }
    void step(int k, const Vector4d& x, const Vector2d& u, Vector4d& next) const override { of->step(k, x, u, next); }
  };
  const Task<ArmRate> task;
  auto problem = autodiff<4, 2>(Stepped<ArmRate>(), task, task, 25, 0.02), other = problem;
  const auto differences = std::make_shared<Differences>();
  differences->of = problem.dynamics;
  other.dynamics = differences;
  const Vector4d x0(0.4, 1.0, 0.0, 0.0);
  const auto exact = solveIterative(problem, x0, RiskSensitive{});
  const auto close = solveIterative(other, x0, RiskSensitive{});
  ASSERT_TRUE(exact) << exact.message();
  ASSERT_TRUE(close) << close.message();
  EXPECT_NEAR(exact.criterion, close.criterion, 1e-8);
  for (int k = 0; k < 25; ++k)
    EXPECT_LT((exact.nominal.controls[k] - close.nominal.controls[k]).norm(), 1e-5);  // tolerance of both and h^2
}

TEST(Autodiff, AllocatesNothingAndServesThreadsAtOnce)
{
  const auto problem = passByAutodiff();
  const Attitude attitude = RiskSensitive{ { 20.0 } };
  IterativeSolver<4, 2> solver(problem, attitude);
  const Vector4d x0 = Vector4d::Zero();
  if (phri_core::testing::kCountsAllocations)
  {
    EXPECT_EQ(phri_core::testing::countAllocations([&] { solver.solve(x0); }), 0);
  }
  ASSERT_TRUE(solver.solve(x0));
  std::vector<std::future<std::vector<Vector2d>>> others;
  for (int i = 0; i < 3; ++i)
    others.push_back(
        std::async(std::launch::async, [&] { return solveIterative(problem, x0, attitude).nominal.controls; }));
  for (auto& other : others)
    EXPECT_EQ(other.get(), solver.result().nominal.controls);
}

TEST(Autodiff, WhereThereIsNoDerivativeTheSolverSaysSo)
{
  const auto distance = [](const auto& x, const auto& u) {
    using std::sqrt;
    using T = std::decay_t<decltype(x(0))>;
    return T(sqrt(T(x(0) * x(0) + x(1) * x(1))) + u(0) * u(0) + u(1) * u(1));
  };
  auto problem = autodiff<4, 2>(Walk(), distance, PassByEnd(), 5, 0.05);
  const Vector4d corner = Vector4d::Zero(), beside(0.1, 0.2, 0.0, 0.0);
  EXPECT_EQ(solveIterative(problem, corner, RiskSensitive{}).status, IterativeStatus::NotFinite);
  EXPECT_NE(solveIterative(problem, beside, RiskSensitive{}).status, IterativeStatus::NotFinite);
  problem.horizon = 0;
  EXPECT_THROW(solveIterative(problem, beside, RiskSensitive{}), std::invalid_argument);
}

TEST(Autodiff, MixedTermsAreReportedOnlyWhereThereAreSome)
{
  const auto problem = passByAutodiff();
  CostExpansion<4, 2> expansion = CostExpansion<4, 2>::zero();
  expansion.has_cross = true;
  problem.cost->expand(0, Vector4d::Ones(), Vector2d::Ones(), expansion);
  EXPECT_FALSE(expansion.has_cross);
  EXPECT_EQ(expansion.S.norm(), 0.0);
}
