// Scenes as control problems: derivatives of the joint state, the error state, the noise, and the thesis' scenes.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>

#include "phri_control/iterative_solver.hpp"
#include "phri_control/thesis_scenes.hpp"
#include "phri_core/random.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

namespace
{
constexpr int kStates = 100;
// Central differences with step 1e-5 of costs with curvatures up to 0.1 * 200: relative to the largest element, both
// the truncation and the rounding stay below 1e-8.
constexpr double kStep = 1e-5, kDifferenceTolerance = 1e-7;
constexpr double kRounding = 1e-15;  // of sums of a few terms below 1

/// Scenes of every kind: the thesis' and one with everything in it.
PlanarScene fullScene()
{
  PlanarScene scene = thesisScene("4.9").scene;
  scene.name = "full";
  scene.integrator = Integrator::RungeKutta4;
  scene.robot_diffusion = MatrixXd::Identity(4, 4).rightCols(2);
  VectorXd start(5);
  start << 0.2, 0.1, 0.4, 0.5, -0.3;
  scene.movers.push_back({ "car", std::make_shared<CarLikeRobot>(), start, MatrixXd::Identity(5, 5).leftCols(3) });
  Eigen::Matrix4d weight;
  weight << 2.0, 0.3, 0.1, 0.0, 0.3, 1.0, 0.0, 0.2, 0.1, 0.0, 0.5, 0.1, 0.0, 0.2, 0.1, 0.7;
  scene.goals.push_back({ 2, weight });
  scene.obstacles.push_back({ 2, (Eigen::Matrix2d() << 9.0, 2.0, 2.0, 5.0).finished(), 0.4 });
  scene.obstacles.push_back({ 0, (Eigen::Matrix2d() << 30.0, 2.0, 2.0, 50.0).finished(), -0.2 });
  scene.static_goals.push_back(
      { UncertainGoal(Vector2d(0.2, 0.2), 0.1 * MatrixXd::Identity(2, 2), MatrixXd::Identity(2, 2)), 1.5 });
  scene.static_goals.push_back({ UncertainGoal(VectorXd::Constant(4, 0.3), 0.2 * weight, weight), -2.0 });
  scene.static_obstacles[0].gamma = { 5.0, -1.0 };
  return scene;
}

std::vector<PlanarScene> scenes()
{
  std::vector<PlanarScene> all{ fullScene() };
  for (const std::string& figure : thesisSceneNames())
    all.push_back(thesisScene(figure).scene);
  return all;
}

VectorXd randomVector(phri_core::Random& random, Eigen::Index n)
{
  VectorXd x(n);
  for (Eigen::Index i = 0; i < n; ++i)
    x(i) = random.uniform(-0.6, 0.6);
  return x;
}

double difference(const MatrixXd& a, const MatrixXd& b)
{
  return (a - b).cwiseAbs().maxCoeff() / std::max(1.0, a.cwiseAbs().maxCoeff());
}

MatrixXd numericalJacobian(const std::function<VectorXd(const VectorXd&)>& function, const VectorXd& x)
{
  MatrixXd jacobian;
  for (Eigen::Index i = 0; i < x.size(); ++i)
  {
    VectorXd up = x, down = x;
    up(i) += kStep;
    down(i) -= kStep;
    const VectorXd slope = (function(up) - function(down)) / (up(i) - down(i));
    jacobian.conservativeResize(slope.size(), x.size());
    jacobian.col(i) = slope;
  }
  return jacobian;
}

double cost(const OptimalControlProblem<>& problem, const VectorXd& start, const std::vector<VectorXd>& controls)
{
  VectorXd x = start, next(start.size());
  double sum = 0.0;
  for (std::size_t k = 0; k < controls.size(); ++k, x = next)
  {
    sum += problem.cost->running(static_cast<int>(k), x, controls[k]);
    problem.dynamics->step(static_cast<int>(k), x, controls[k], next);
  }
  return sum + problem.cost->terminal(x);
}
}  // namespace

TEST(PlanarScene, DynamicsHaveExactDerivatives)
{
  for (const PlanarScene& scene : scenes())
  {
    SCOPED_TRACE(scene.name);
    const OptimalControlProblem<> problem = problemOf(scene);
    validate(problem);
    const Eigen::Index n = problem.stateSize();
    phri_core::Random random(31);
    double worst = 0.0;
    for (int i = 0; i < kStates; ++i)
    {
      const VectorXd z = scene.start() + randomVector(random, n), u = randomVector(random, 2);
      MatrixXd A(n, n), B(n, 2);
      A.setConstant(NAN);  // every element must be filled
      B.setConstant(NAN);
      problem.dynamics->linearise(0, z, u, A, B);
      const auto stepped = [&](const VectorXd& from, const VectorXd& with) {
        VectorXd next = VectorXd::Constant(n, NAN);
        problem.dynamics->step(0, from, with, next);
        return next;
      };
      worst = std::max({ worst, difference(A, numericalJacobian([&](const VectorXd& p) { return stepped(p, u); }, z)),
                         difference(B, numericalJacobian([&](const VectorXd& v) { return stepped(z, v); }, u)) });
    }
    EXPECT_LT(worst, kDifferenceTolerance);
  }
}

TEST(PlanarScene, CostsHaveExactGradientsAndHessians)
{
  for (const PlanarScene& scene : scenes())
  {
    SCOPED_TRACE(scene.name);
    const OptimalControlProblem<> problem = problemOf(scene);
    const Eigen::Index n = problem.stateSize();
    phri_core::Random random(32);
    double worst = 0.0;
    for (int i = 0; i < kStates; ++i)
    {
      const VectorXd z = scene.start() + randomVector(random, n), u = randomVector(random, 2);
      auto expansion = CostExpansion<>::zero(n, 2);
      auto terminal = LqTerminal<>::zero(n);
      expansion.q.setConstant(NAN);
      expansion.Q.setConstant(NAN);
      terminal.q.setConstant(NAN);
      terminal.Q.setConstant(NAN);
      problem.cost->expand(0, z, u, expansion);
      problem.cost->expandTerminal(z, terminal);
      EXPECT_NEAR(expansion.q0, problem.cost->running(0, z, u), 1e-14);
      EXPECT_NEAR(terminal.q0, problem.cost->terminal(z), 1e-14);
      EXPECT_LT(difference(expansion.Q, expansion.Q.transpose()), kRounding);
      const auto scalar = [](double value) { return VectorXd::Constant(1, value); };
      const auto running = [&](const VectorXd& p) { return scalar(problem.cost->running(0, p, u) / scene.dt); };
      const auto slope = [&](const VectorXd& p) {
        auto at = CostExpansion<>::zero(n, 2);
        problem.cost->expand(0, p, u, at);
        return VectorXd(at.q / scene.dt);
      };
      const auto final_slope = [&](const VectorXd& p) {
        auto at = LqTerminal<>::zero(n);
        problem.cost->expandTerminal(p, at);
        return VectorXd(at.q);
      };
      const auto effort = [&](const VectorXd& v) { return scalar(problem.cost->running(0, z, v)); };
      worst = std::max(
          { worst, difference(expansion.q.transpose() / scene.dt, numericalJacobian(running, z)),
            difference(expansion.Q / scene.dt, numericalJacobian(slope, z)),
            difference(terminal.q.transpose(),
                       numericalJacobian([&](const VectorXd& p) { return scalar(problem.cost->terminal(p)); }, z)),
            difference(terminal.Q, numericalJacobian(final_slope, z)),
            difference(expansion.r.transpose(), numericalJacobian(effort, u)) });
      EXPECT_LT(difference(expansion.R, scene.dt * scene.control_weight), kRounding);
    }
    EXPECT_LT(worst, kDifferenceTolerance);
  }
}

TEST(PlanarScene, FixedSizesGiveTheSameNumbers)
{
  const PlanarScene scene = thesisScene("4.10").scene;
  const auto fixed = problemOf<14, 2>(scene);
  const auto any = problemOf(scene);
  phri_core::Random random(33);
  const VectorXd z = scene.start() + randomVector(random, 14), u = randomVector(random, 2);
  auto a = CostExpansion<14, 2>::zero();
  auto b = CostExpansion<>::zero(14, 2);
  fixed.cost->expand(3, z, u, a);
  any.cost->expand(3, z, u, b);
  EXPECT_LT(difference(a.Q, b.Q), 1e-15);
  EXPECT_LT(difference(a.q, b.q), 1e-15);
  EXPECT_THROW((problemOf<8, 2>(scene)), std::invalid_argument);
}

TEST(PlanarScene, FixedSizesAllocateNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations are not counted under AddressSanitizer";
  for (const char* figure : { "4.7", "4.9" })
  {
    PlanarScene scene = thesisScene(figure).scene;
    scene.integrator = figure == std::string("4.9") ? Integrator::RungeKutta4 : Integrator::Euler;
    const auto problem = problemOf<12, 2>(scene);
    const Eigen::Matrix<double, 12, 1> z = scene.start();
    Eigen::Matrix<double, 12, 1> next;
    Eigen::Matrix<double, 12, 12> A;
    Eigen::Matrix<double, 12, 2> B;
    auto expansion = CostExpansion<12, 2>::zero();
    auto terminal = LqTerminal<12>::zero();
    EXPECT_EQ(phri_core::testing::countAllocations([&] {
                problem.dynamics->step(0, z, Vector2d(0.1, 0.2), next);
                problem.dynamics->linearise(0, z, Vector2d(0.1, 0.2), A, B);
                problem.cost->expand(0, z, Vector2d(0.1, 0.2), expansion);
                problem.cost->expandTerminal(next, terminal);
                next(0) = problem.cost->running(0, z, Vector2d(0.1, 0.2)) + problem.cost->terminal(z);
              }),
              0);
  }
}

TEST(PlanarScene, NoiseIsTheDiffusionOfItsBlock)
{
  const PlanarScene scene = fullScene();
  const OptimalControlProblem<> problem = problemOf(scene);
  ASSERT_EQ(problem.noise.size(), 4U);
  EXPECT_EQ(problem.noise[2].name, "car");
  EXPECT_EQ(problem.noise[3].name, "robot");
  MatrixXd factor(problem.stateSize(), 3), expected = MatrixXd::Zero(problem.stateSize(), 3);
  ASSERT_EQ(problem.noise[2].width, 3);
  problem.noise[2].factor(0, scene.start(), Vector2d::Zero(), factor);
  expected.block<3, 3>(12, 0) = 0.1 * MatrixXd::Identity(3, 3);  // sqrt(dt) = 0.1; the car's block begins at 12
  EXPECT_LT((factor - expected).norm(), 1e-15);
  EXPECT_EQ(problemOf(thesisScene("4.5").scene).noise.size(), 1U);
}

TEST(PlanarScene, ErrorStateCostsWhatTheJointStateCosts)
{
  for (const char* figure : { "4.4", "4.5", "4.6" })
  {
    const PlanarScene scene = thesisScene(figure).scene;
    const auto joint = problemOf(scene), error = errorProblemOf(scene);
    phri_core::Random random(34);
    for (int trial = 0; trial < 20; ++trial)
    {
      std::vector<VectorXd> controls(scene.horizon);
      for (VectorXd& u : controls)
        u = 10.0 * randomVector(random, 2);
      const double expected = cost(joint, scene.start(), controls);
      EXPECT_NEAR(cost(error, errorStart(scene), controls), expected, 1e-12 * (1.0 + expected));
    }
  }
  for (const char* figure : { "4.7", "4.9", "4.10" })
    EXPECT_THROW(errorProblemOf(thesisScene(figure).scene), std::invalid_argument) << figure;
}

TEST(PlanarScene, ErrorStateHasTheGainsOfTheJointState)
{
  // section 4: where both states exist, the gains on the goal and obstacle blocks of z are those on the errors, and the
  // robot's block is minus their sum
  const ThesisScene thesis = thesisScene("4.6");
  const Eigen::Matrix<double, 12, 1> z = thesis.scene.start();
  const Eigen::Matrix<double, 8, 1> xi = errorStart(thesis.scene);
  const Attitude attitude = RiskSensitive{ { -5.0, 0.5 } };
  const auto joint = solveIterative(problemOf<12, 2>(thesis.scene), z, attitude);
  const auto error = solveIterative(errorProblemOf<8, 2>(thesis.scene), xi, attitude);
  ASSERT_TRUE(joint) << joint.message();
  ASSERT_TRUE(error) << error.message();
  constexpr double kFixedPoint = 1e-5;  // both stop at max |l| < 1e-6
  for (std::size_t k = 0; k < joint.policy.gains.size(); ++k)
  {
    const auto& L = joint.policy.gains[k];
    const auto& E = error.policy.gains[k];
    const double scale = 1.0 + E.norm();
    EXPECT_LT((L.rightCols<8>() - E).norm(), kFixedPoint * scale) << k;
    EXPECT_LT((L.leftCols<4>() + E.leftCols<4>() + E.rightCols<4>()).norm(), kFixedPoint * scale) << k;
  }
  EXPECT_NEAR(joint.criterion, error.criterion, 1e-8);
}

TEST(ThesisScenes, RiskNeutralCostOfFigure5IsThatOfIndependentSolvers)
{
  // four independent solvers (crocoddyl, mim_solvers, the author's, a plain iterative LQR) reach 0.0491451919
  const PlanarScene scene = thesisScene("4.5").scene;
  const Eigen::Matrix<double, 12, 1> z = scene.start();
  const auto result = solveIterative(problemOf<12, 2>(scene), z, RiskSensitive{ { 0.0 } });
  ASSERT_TRUE(result) << result.message();
  std::vector<VectorXd> controls(result.nominal.controls.begin(), result.nominal.controls.end());
  EXPECT_NEAR(cost(problemOf(scene), scene.start(), controls), 0.0491451919, 1e-10);
}

TEST(ThesisScenes, EverySceneHasARiskNeutralPolicyAndPanelsForItsSources)
{
  for (const std::string& figure : thesisSceneNames())
  {
    SCOPED_TRACE(figure);
    const ThesisScene thesis = thesisScene(figure);
    EXPECT_EQ(thesis.figure, figure);
    EXPECT_FALSE(thesis.assumed.empty());
    ASSERT_FALSE(thesis.panels.empty());
    const OptimalControlProblem<> problem = problemOf(thesis.scene);
    const std::size_t sources = problem.noise.size();
    for (const FigurePanel& panel : thesis.panels)
      EXPECT_NO_THROW(IterativeSolver<>(problem, panel.attitude)) << panel.name;
    const auto result =
        solveIterative(problem, thesis.scene.start(), Attitude(RiskSensitive{ std::vector<double>(sources, 0.0) }));
    EXPECT_TRUE(result) << result.message();
  }
  EXPECT_THROW(thesisScene("4.3"), std::invalid_argument);
}

TEST(ThesisScenes, ObstacleOfFigure5SpreadsFarBeyondItsWidth)
{
  // noise on the positions alone is a random walk: variance T = 0.5 m^2 per axis, whatever the drift; noise on the
  // velocities comes on top
  PlanarScene scene = thesisScene("4.5").scene;
  EXPECT_GT(obstacleSpread(scene, scene.obstacles[0]), 10.0);
  MatrixXd& diffusion = scene.movers[1].diffusion;
  diffusion = MatrixXd::Identity(4, 2);  // noise on the positions alone: a random walk
  EXPECT_NEAR(obstacleSpread(scene, scene.obstacles[0]), std::sqrt(2.0 * 0.5 * 200.0), 1e-12);
  diffusion = MatrixXd();
  EXPECT_EQ(obstacleSpread(scene, scene.obstacles[0]), 0.0);
}

TEST(PlanarScene, RefusesBadScenes)
{
  const PlanarScene good = thesisScene("4.7").scene;
  const auto refused = [&](const std::function<void(PlanarScene&)>& spoil, const std::string& field) {
    PlanarScene scene = good;
    spoil(scene);
    try
    {
      problemOf(scene);
      ADD_FAILURE() << field << " was accepted";
    }
    catch (const std::invalid_argument& error)
    {
      EXPECT_NE(std::string(error.what()).find(field), std::string::npos) << error.what();
    }
  };
  refused([](PlanarScene& s) { s.robot.reset(); }, "robot");
  refused([](PlanarScene& s) { s.robot_start = VectorXd::Zero(5); }, "robot");
  refused([](PlanarScene& s) { s.movers[0].start(1) = NAN; }, "goal");
  refused([](PlanarScene& s) { s.movers[1].diffusion = MatrixXd::Identity(3, 3); }, "obstacle");
  refused([](PlanarScene& s) { s.goals[0].mover = 2; }, "mover 2");
  refused([](PlanarScene& s) { s.obstacles[0].weight(0, 0) = -1.0; }, "weight of an obstacle");
  refused([](PlanarScene& s) { s.obstacles[0].amplitude = INFINITY; }, "amplitude");
  refused([](PlanarScene& s) { s.control_weight.setZero(); }, "control_weight");
  refused([](PlanarScene& s) { s.dt = 0.0; }, "dt");
  refused([](PlanarScene& s) { s.horizon = 0; }, "horizon");
  PlanarScene scene = good;
  scene.static_goals.push_back(
      { UncertainGoal(Vector2d::Zero(), MatrixXd::Identity(2, 2), MatrixXd::Identity(2, 2)), 2.0 });
  EXPECT_THROW(problemOf(scene), RiskBreakdown);
}
