// Random nonlinear problems, scenes and control loops: every solve ends in a finite policy inside its limits or in a
// typed failure, and nothing that is not finite is ever acted on.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <memory>

#include "lq_fixtures.hpp"
#include "phri_control/autodiff.hpp"
#include "phri_control/mpc.hpp"
#include "phri_control/planar_scene.hpp"
#include "phri_core/soak.hpp"

using namespace phri_control;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using lq_fixtures::randomMatrix;
using phri_core::Random;

namespace
{
constexpr double kSame = 1e-6;  // relative, of a criterion evaluated a second time at a nominal with max |l| < 1e-6

template <typename T>
using State = Eigen::Matrix<T, 3, 1>;
template <typename T>
using Control = Eigen::Matrix<T, 2, 1>;

/// x+ = A x + B u + bend sin(C x + D u).
struct BentPlant
{
  Eigen::Matrix3d A, C;
  Eigen::Matrix<double, 3, 2> B, D;
  Eigen::Vector3d bend;

  BentPlant(Random& random, double growth)
    : A(growth * (0.9 * Eigen::Matrix3d::Identity() + 0.2 * randomMatrix(random, 3, 3))),
      C(randomMatrix(random, 3, 3)),
      B(randomMatrix(random, 3, 2)),
      D(randomMatrix(random, 3, 2)),
      bend(soak::scale(random, -3.0, -0.5) * randomMatrix(random, 3, 1))
  {
  }
  template <typename T>
  State<T> operator()(const State<T>& x, const Control<T>& u) const
  {
    using std::sin;
    State<T> next;
    for (int i = 0; i < 3; ++i)
    {
      T angle = C(i, 0) * x(0) + C(i, 1) * x(1) + C(i, 2) * x(2) + D(i, 0) * u(0) + D(i, 1) * u(1);
      next(i) =
          A(i, 0) * x(0) + A(i, 1) * x(1) + A(i, 2) * x(2) + B(i, 0) * u(0) + B(i, 1) * u(1) + bend(i) * sin(angle);
    }
    return next;
  }
};

/// 1/2 z'H z + g'z of z = [x; u], a bump, and a term of fourth order, all times a weight.
struct BumpyCost
{
  Eigen::Matrix<double, 5, 5> H;
  Eigen::Matrix<double, 5, 1> g;
  Eigen::Vector3d centre;
  double height, width, quartic, weight;

  BumpyCost(Random& random, bool indefinite, bool cross)
    : H(lq_fixtures::randomDefinite(random, 5)),
      g(randomMatrix(random, 5, 1)),
      centre(randomMatrix(random, 3, 1)),
      height(random.uniform() < 0.5 ? soak::scale(random, -2.0, 1.0) : 0.0),
      width(soak::scale(random, -1.0, 0.5)),
      quartic(random.uniform() < 0.5 ? random.uniform() : 0.0),
      weight(soak::scale(random, -8.0, 8.0))
  {
    if (!cross)
    {
      H.topRightCorner<3, 2>().setZero();
      H.bottomLeftCorner<2, 3>().setZero();
    }
    if (indefinite)
      H.topLeftCorner<3, 3>().diagonal().array() -= random.uniform(0.0, 2.0);
  }
  template <typename T>
  T operator()(const State<T>& x, const Control<T>& u) const
  {
    using std::exp;
    const Eigen::Matrix<T, 5, 1> z = (Eigen::Matrix<T, 5, 1>() << x, u).finished();
    T sum = quartic * x(0) * x(0) * x(0) * x(0), distance(0.0);
    for (int i = 0; i < 5; ++i)
    {
      T row = 0.5 * H(i, i) * z(i);
      for (int j = 0; j < i; ++j)
        row += H(i, j) * z(j);
      sum += z(i) * row + g(i) * z(i);
    }
    for (int i = 0; i < 3; ++i)
      distance += (x(i) - centre(i)) * (x(i) - centre(i));
    sum += height * exp(-0.5 / (width * width) * distance);
    return weight * sum;
  }
  template <typename T>
  T operator()(const State<T>& x) const
  {
    return (*this)(x, Control<T>(T(0.0), T(0.0)));
  }
};

Attitude randomAttitude(Random& random, Eigen::Index sources, double unit)
{
  const double size = soak::scale(random, -4.0, 2.0) / unit;
  if (random.uniform() < 0.5)
  {
    RiskSensitive attitude;
    for (Eigen::Index s = 0; s < sources; ++s)
      attitude.theta.push_back(size * random.normal());
    return attitude;
  }
  CostCumulants attitude{ randomMatrix(random, sources, soak::number(random, 0, 4)) };
  for (Eigen::Index r = 0; r < attitude.gamma.cols(); ++r)
    attitude.gamma.col(r) *= std::pow(size, r + 1);
  return attitude;
}

IterativeOptions randomOptions(Random& random)
{
  IterativeOptions options;
  options.max_iterations = random.uniform() < 0.3 ? soak::number(random, 1, 20) : 100;
  options.max_passes = random.uniform() < 0.2 ? soak::number(random, 1, 20) : 0;
  options.line_search = random.uniform() < 0.2 ? LineSearch::Criterion : LineSearch::Feedforward;
  options.reduce = random.uniform() < 0.5;
  options.skip_neutral = random.uniform() < 0.1;
  options.cumulants = soak::number(random, 0, 3);
  return options;
}

template <int N, int M>
void limitControls(Random& random, OptimalControlProblem<N, M>& problem)
{
  const Eigen::Index m = problem.controlSize();
  if (random.uniform() < 0.3)
    problem.lower = Eigen::Matrix<double, M, 1>(-soak::scale(random, -2.0, 2.0) * VectorXd::Ones(m));
  if (random.uniform() < 0.3)
    problem.upper = Eigen::Matrix<double, M, 1>(soak::scale(random, -2.0, 2.0) * VectorXd::Ones(m));
}

OptimalControlProblem<3, 2> randomProblem(Random& random, double& unit)
{
  const double growth = random.uniform() < 0.03 ? soak::scale(random, 0.0, 30.0) : 1.0;
  const BumpyCost cost(random, random.uniform() < 0.3, random.uniform() < 0.5);
  auto problem = autodiff<3, 2>(BentPlant(random, growth), cost, cost, soak::number(random, 1, 30));
  const double noise = soak::scale(random, -3.0, 0.0);
  const int sources = soak::number(random, 0, 2);
  for (int s = 0; s < sources; ++s)
    problem.noise.push_back(
        NoiseModel<3, 2>::constant(std::to_string(s), noise * randomMatrix(random, 3, soak::number(random, 1, 4))));
  limitControls(random, problem);
  unit = cost.weight * noise * noise;
  return problem;
}

template <int N, int M>
void expectInside(const OptimalControlProblem<N, M>& problem, const Eigen::Matrix<double, M, 1>& u)
{
  ASSERT_TRUE(u.allFinite());
  ASSERT_TRUE(!problem.lower || (u.array() >= problem.lower->array()).all());
  ASSERT_TRUE(!problem.upper || (u.array() <= problem.upper->array()).all());
}

/// What every result promises, whatever its status.
template <int N, int M>
void expectWhole(const OptimalControlProblem<N, M>& problem, const IterativeOptions& options,
                 const IterativeResult<N, M>& result, soak::Tally& tally)
{
  constexpr const char* kNames[] = { "converged", "max_iterations", "breakdown", "line_search", "not_finite" };
  tally.count(kNames[static_cast<int>(result.status)]);
  ASSERT_FALSE(result.message().empty());
  if (result.status == IterativeStatus::Converged)
  {
    ASSERT_TRUE(result.usable && result.converged && result.max_feedforward < options.tolerance);
  }
  if (result.status == IterativeStatus::Breakdown)
  {
    ASSERT_TRUE(result.risk.kind == BreakdownKind::Expectation || result.risk.kind == BreakdownKind::Hessian);
    ASSERT_NE(result.fallback, Fallback::None);
  }
  if (result.status == IterativeStatus::NotFinite)
  {
    ASSERT_FALSE(result.usable);
    ASSERT_EQ(result.risk.kind, BreakdownKind::NotFinite);
  }
  if (!result.usable)
    return;
  ASSERT_TRUE(std::isfinite(result.criterion) && std::isfinite(result.max_feedforward));
  ASSERT_TRUE(result.nominal.states[0].allFinite());
  Eigen::Matrix<double, N, 1> next = result.nominal.states[0];
  for (int k = 0; k < problem.horizon; ++k)
  {
    expectInside(problem, result.nominal.controls[k]);
    problem.dynamics->step(k, result.nominal.states[k], result.nominal.controls[k], next);
    ASSERT_EQ(next, result.nominal.states[k + 1]) << "the nominal is no motion of the plant, stage " << k;
    ASSERT_TRUE(result.policy.gains[k].allFinite() && result.policy.feedforward[k].allFinite());
  }
  if (options.cumulants > 0)
  {
    if (!result.cumulants.allFinite())
    {
      ASSERT_TRUE(result.cumulants.array().isNaN().all());
      CumulantValues<N> values;
      ASSERT_FALSE(evaluateCumulants(approximate(problem, result.nominal), options.cumulants, result.policy.gains,
                                     result.policy.feedforward, values))
          << "they do not overflow";
      tally.count("cumulants_overflow");
    }
  }
}

/// The policy's value in the approximation at its own nominal, by `evaluate` instead of the backward pass.
template <int N, int M>
void expectValue(const OptimalControlProblem<N, M>& problem, const Attitude& attitude,
                 const IterativeResult<N, M>& result, soak::Tally& tally)
{
  const RiskSensitive* risk = std::get_if<RiskSensitive>(&attitude);
  if (!result || !risk || result.share != 1.0 || problem.lower || problem.upper)
    return;
  LqApproximation<N, M> approximation;
  LqPolicy<N, M> own;
  RiskEvaluation<N> evaluation;
  approximation.resize(problem);
  approximation.linearise(problem, result.nominal);
  ASSERT_TRUE(approximation.assembleFor(result.policy, own));
  ASSERT_TRUE(evaluate(approximation.problem, *risk, own.gains, own.feedforward, evaluation));
  double size = std::abs(result.nominal.cost);  // of the terms that may cancel
  for (const QuadraticValue<N>& value : evaluation.values)
    size += std::abs(value.c);
  ASSERT_NEAR(evaluation.value(VectorXd::Zero(problem.stateSize())), result.criterion, kSame * size);
  tally.count("checked");
}

std::shared_ptr<const Plant> randomPlant(Random& random, VectorXd& start)
{
  const int kind = soak::number(random, 0, 3);
  start = random.uniform(0.1, 1.0) * randomMatrix(random, kind == 3 ? 5 : 4, 1);
  if (kind == 3)
    return std::make_shared<CarLikeRobot>();
  if (kind == 2)
    return std::make_shared<TwoLinkArm>(ArmParameters(),
                                        random.uniform() < 0.5 ? ArmInput::JointTorque : ArmInput::WorkspaceForce);
  const Eigen::Vector2d mass = Eigen::Vector2d::Constant(soak::scale(random, -0.5, 0.5));
  if (kind == 1)
    return std::make_shared<PointMass>(mass, mass, DrivingForce{ random.uniform(1.0, 10.0) });
  return std::make_shared<PointMass>(mass, mass);
}

MatrixXd randomDiffusion(Random& random, Eigen::Index n)
{
  return random.uniform() < 0.4
             ? MatrixXd()
             : MatrixXd(soak::scale(random, -2.0, 0.0) * randomMatrix(random, n, soak::number(random, 1, int(n))));
}

PlanarScene randomScene(Random& random)
{
  PlanarScene scene;
  scene.robot = randomPlant(random, scene.robot_start);
  scene.robot_diffusion = randomDiffusion(random, scene.robot_start.size());
  scene.dt = soak::scale(random, -3.0, -1.0);
  scene.horizon = soak::number(random, 2, 20);
  scene.integrator = random.uniform() < 0.5 ? Integrator::Euler : Integrator::RungeKutta4;
  scene.control_weight *= soak::scale(random, -3.0, 0.0);
  const int movers = soak::number(random, 0, 2);
  for (int i = 0; i < movers; ++i)
  {
    Mover mover;
    mover.name = std::to_string(i);
    mover.plant = randomPlant(random, mover.start);
    mover.diffusion = randomDiffusion(random, mover.start.size());
    scene.movers.push_back(mover);
    if (random.uniform() < 0.5)
      scene.goals.push_back(
          { std::size_t(i), soak::scale(random, -1.0, 1.0) * lq_fixtures::randomDefinite(random, 4) });
    else
      scene.obstacles.push_back({ std::size_t(i),
                                  soak::scale(random, 0.0, 3.0) * lq_fixtures::randomDefinite(random, 2),
                                  soak::scale(random, -2.0, 0.5) });
  }
  const int still = soak::number(random, 0, 2);
  for (int i = 0; i < still; ++i)
  {
    const MatrixXd weight = soak::scale(random, 0.0, 1.0) * lq_fixtures::randomDefinite(random, 2),
                   root = 0.3 * randomMatrix(random, 2, soak::number(random, 1, 2)), spread = root * root.transpose();
    const VectorXd place = randomMatrix(random, 2, 1);
    scene.static_goals.push_back({ UncertainGoal(place, spread, weight), random.uniform(-2.0, 1.0) });
    scene.static_obstacles.push_back({ UncertainObstacle(-place, spread, weight, random.uniform(0.0, 1.0)),
                                       { random.uniform(-0.5, 0.5), random.uniform(-0.2, 0.2) } });
  }
  return scene;
}
}  // namespace

TEST(SoakIterative, randomNonlinearProblems)
{
  const soak::Tally tally = soak::run(1000, [](std::uint64_t, Random& random, soak::Tally& count) {
    double unit = 1.0;
    const auto problem = randomProblem(random, unit);
    const Attitude attitude = randomAttitude(random, problem.noise.size(), unit);
    const IterativeOptions options = randomOptions(random);
    const Eigen::Vector3d x0 = soak::scale(random, -2.0, 1.0) * randomMatrix(random, 3, 1);
    const auto result = solveIterative(problem, x0, attitude, options);
    expectWhole(problem, options, result, count);
    expectValue(problem, attitude, result, count);
  });
  for (const char* met : { "converged", "max_iterations", "breakdown", "checked", "line_search" })
    tally.expectMoreThan(0.02, met);
  tally.expectMoreThan(0.01, "not_finite");
}

TEST(SoakIterative, randomScenes)
{
  soak::run(200, [](std::uint64_t, Random& random, soak::Tally& count) {
    const PlanarScene scene = randomScene(random);
    double limit = std::numeric_limits<double>::infinity();  // of the static goals' share of it
    for (const StaticGoal& goal : scene.static_goals)
      limit = std::min(limit, goal.theta > 0.0 ? goal.belief.thetaLimit() / goal.theta : limit);
    OptimalControlProblem<> problem;
    try
    {
      problem = problemOf(scene);
    }
    catch (const RiskBreakdown& error)
    {
      ASSERT_EQ(error.status().kind, BreakdownKind::Expectation);
      ASSERT_LE(limit, 1.0);
      count.count("static_breakdown");
      return;
    }
    ASSERT_GT(limit, 1.0);
    limitControls(random, problem);
    const Attitude attitude = randomAttitude(random, problem.noise.size(), 1e-2);
    const IterativeOptions options = randomOptions(random);
    const auto result = solveIterative(problem, scene.start(), attitude, options);
    expectWhole(problem, options, result, count);
    expectValue(problem, attitude, result, count);
  });
}

TEST(SoakIterative, randomControlLoops)
{
  const soak::Tally tally = soak::run(200, [](std::uint64_t, Random& random, soak::Tally& count) {
    double unit = 1.0;
    const auto problem = randomProblem(random, unit);
    MpcOptions options;
    options.iterations = soak::number(random, 1, 5);
    options.passes = soak::number(random, 1, 20);
    options.reduce = random.uniform() < 0.3;
    ModelPredictiveController<3, 2> controller(problem, randomAttitude(random, problem.noise.size(), unit), options);
    IterativeOptions promised;
    promised.tolerance = options.tolerance;
    Eigen::Vector3d x = randomMatrix(random, 3, 1), next;
    Eigen::Vector2d u;
    int age = problem.horizon;  // samples since the plan in use began
    for (int plan = 0; plan < 8; ++plan)
    {
      Eigen::Vector3d measured = x;
      if (random.uniform() < 0.05)
        measured(1) = random.uniform() < 0.5 ? std::numeric_limits<double>::quiet_NaN() : 1e200;
      const int shift = soak::number(random, 0, 3);
      const auto& result = controller.plan(measured, shift);
      expectWhole(problem, promised, result, count);
      age = result.usable ? 0 : std::min(age + shift, problem.horizon);
      const int at = soak::number(random, 0, 2);
      const bool acted = controller.act(at, x, u);
      count.count(acted ? "acted" : "passive");
      ASSERT_TRUE(u.allFinite());
      if (acted)
      {
        ASSERT_LT(age + at, problem.horizon);
        expectInside(problem, u);
      }
      else
      {
        ASSERT_EQ(u.norm(), 0.0);
      }
      problem.dynamics->step(0, x, u, next);
      x = next + 0.01 * randomMatrix(random, 3, 1);
      if (!x.allFinite() || x.norm() > 1e6)
        x = randomMatrix(random, 3, 1);
    }
  });
  tally.expectMoreThan(1.0, "acted");  // of eight per problem
  tally.expectMoreThan(0.05, "passive");
}
