// Roll-outs of policies: the moments of a linear-quadratic problem, the places of static things, streams, collisions.
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "iterative_fixtures.hpp"
#include "phri_control/cumulant_evaluation.hpp"
#include "phri_control/iterative_solver.hpp"
#include "phri_control/stochastic_rollout.hpp"
#include "phri_control/thesis_scenes.hpp"
#include "phri_core/testing.hpp"

namespace phri_control
{
// both are in the library: compiling them again here takes longer than the rest of this file
extern template class IterativeSolver<>;
extern template IterativeResult<> solveIterative(const OptimalControlProblem<>&, const Eigen::VectorXd&,
                                                 const Attitude&, const IterativeOptions&,
                                                 const std::vector<Eigen::VectorXd>&);
}  // namespace phri_control

using namespace phri_control;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

namespace
{
// Estimates are compared in their own standard errors. A right program fails a seed with probability 6e-5; the seeds
// are fixed, so that it either always passes or never does.
constexpr double kErrors = 4.0;
// Two ways to sum a few hundred numbers of size 1
constexpr double kRounding = 1e-11;

double mean(const VectorXd& sample)
{
  return sample.mean();
}
double variance(const VectorXd& sample)
{
  return (sample.array() - sample.mean()).square().sum() / static_cast<double>(sample.size() - 1);
}
double meanError(const VectorXd& sample)
{
  return std::sqrt(variance(sample) / static_cast<double>(sample.size()));
}
double varianceError(const VectorXd& sample)
{
  return meanError((sample.array() - sample.mean()).square());
}

struct LinearCase
{
  OptimalControlProblem<3, 2> problem;
  Trajectory<3, 2> nominal;
  LqPolicy<3, 2> policy;
  MatrixXd cumulants;  // (S, 2) of the policy, by the exact recursion
};

/// A random plant with two sources of noise around a nominal and under gains that are nobody's optimum.
LinearCase linearCase(std::uint64_t seed, int horizon)
{
  phri_core::Random rng(seed);
  const auto linear = std::make_shared<fixtures::Linear>(rng, false);
  LinearCase result;
  result.problem.dynamics = linear;
  result.problem.cost = linear;
  result.problem.horizon = horizon;
  result.problem.noise = { NoiseModel<3, 2>::constant("one", 0.1 * fixtures::gaussian(rng, 3, 2)),
                           NoiseModel<3, 2>::constant("two", 0.2 * fixtures::gaussian(rng, 3, 1)) };
  result.nominal.resize(horizon, 3, 2);
  result.policy.resize(horizon, 3, 2);
  for (int k = 0; k < horizon; ++k)
  {
    result.nominal.controls[k] = 0.2 * fixtures::gaussian(rng, 2, 1);
    result.policy.gains[k] = -linear->B.completeOrthogonalDecomposition().pseudoInverse() * 0.5 * linear->A +
                             0.1 * fixtures::gaussian(rng, 2, 3);
  }
  const Eigen::Vector3d x0 = fixtures::gaussian(rng, 3, 1);
  rollOut(result.problem, x0, result.nominal);
  // the same policy in absolute coordinates: u = L x + (u_nominal - L x_nominal)
  LinearQuadraticProblem<3, 2> lq;
  std::vector<Eigen::Vector2d> feedforward;
  lq.terminal = linear->end;
  for (int k = 0; k < horizon; ++k)
  {
    auto stage = LqStage<3, 2>::zero(3, 2);
    stage.A = linear->A;
    stage.B = linear->B;
    stage.d = linear->d;
    stage.Q = linear->h.Q;
    stage.q = linear->h.q;
    stage.R = linear->h.R;
    stage.r = linear->h.r;
    lq.stages.push_back(stage);
    feedforward.emplace_back(result.nominal.controls[k] - result.policy.gains[k] * result.nominal.states[k]);
  }
  for (const auto& source : result.problem.noise)
  {
    MatrixXd factor(3, source.width);
    source.factor(0, result.nominal.states[0], result.nominal.controls[0], factor);
    lq.noise.push_back(NoiseSource::fromFactor(source.name, factor));
  }
  result.cumulants = evaluateCumulants(lq, 2, result.policy.gains, feedforward).cumulants(result.nominal.states[0]);
  return result;
}

/// Robot, a goal and an obstacle that stand still but for noise, a goal and an obstacle at uncertain places.
PlanarScene smallScene()
{
  PlanarScene scene;
  scene.name = "small";
  scene.robot = std::make_shared<PointMass>();
  scene.robot_start = VectorXd::Zero(4);
  scene.dt = 0.05;
  scene.horizon = 20;
  const auto resting = [](double x, double y) { return (VectorXd(4) << x, y, 0.0, 0.0).finished(); };
  scene.movers = { { "goal", scene.robot, resting(1.0, 0.0), 0.1 * MatrixXd::Identity(4, 4) },
                   { "obstacle", scene.robot, resting(0.5, 0.2), 0.1 * MatrixXd::Identity(4, 2) } };
  scene.goals = { { 0, Eigen::Matrix4d::Identity() } };
  scene.obstacles = { { 1, 20.0 * Eigen::Matrix2d::Identity(), 0.5 } };
  scene.static_goals = { { UncertainGoal(Vector2d(0.5, -0.5), (Eigen::Matrix2d() << 0.2, 0.1, 0.1, 0.3).finished(),
                                         Eigen::Matrix2d::Identity()),
                           0.0 } };
  scene.static_obstacles = { { UncertainObstacle(Vector2d(0.3, 0.1),
                                                 (Eigen::Matrix2d() << 0.04, -0.02, -0.02, 0.02).finished(),
                                                 (Eigen::Matrix2d() << 8.0, 1.0, 1.0, 5.0).finished(), 0.7),
                               {} } };
  return scene;
}

IterativeResult<> neutral(const PlanarScene& scene)
{
  const OptimalControlProblem<> problem = problemOf(scene);
  return solveIterative(problem, scene.start(), Attitude(CostCumulants{ MatrixXd(problem.noise.size(), 0) }));
}

struct FixedPolicy
{
  Trajectory<12, 2> nominal;
  LqPolicy<12, 2> policy;
};

FixedPolicy fixed(const IterativeResult<>& result)
{
  FixedPolicy copy;
  for (const VectorXd& x : result.nominal.states)
    copy.nominal.states.emplace_back(x);
  for (const VectorXd& u : result.nominal.controls)
    copy.nominal.controls.emplace_back(u);
  for (const MatrixXd& gain : result.policy.gains)
    copy.policy.gains.emplace_back(gain);
  return copy;
}
}  // namespace

// J is a polynomial of normal variables with cumulants known in closed form. The marginal ones are those of one source.
TEST(StochasticRollout, LinearQuadraticMomentsAreTheExactOnes)
{
  for (const std::uint64_t seed : { 1, 2, 3 })
  {
    const LinearCase linear = linearCase(seed, 15);
    for (const int source : { 0, 1 })
    {
      const VectorXd costs = rollOuts(linear.problem, linear.nominal, linear.policy, { 20000, seed, source }).costs;
      EXPECT_NEAR(mean(costs), linear.cumulants(source, 0), kErrors * meanError(costs)) << seed << " " << source;
      EXPECT_NEAR(variance(costs), linear.cumulants(source, 1), kErrors * varianceError(costs))
          << seed << " " << source;
    }
    // with both sources the added expectations add up: E J = J_0 + sum_s (E_s J - J_0)
    const VectorXd both = rollOuts(linear.problem, linear.nominal, linear.policy, { 20000, seed }).costs;
    EXPECT_NEAR(mean(both), linear.cumulants.col(0).sum() - linear.nominal.cost, kErrors * meanError(both));
    EXPECT_GT(mean(both) - linear.nominal.cost, kErrors * meanError(both));  // and that is not nothing
  }
}

TEST(StochasticRollout, WithoutNoiseItIsTheNominal)
{
  LinearCase linear = linearCase(5, 15);
  linear.problem.noise.clear();
  const RollOuts runs = rollOuts(linear.problem, linear.nominal, linear.policy, { 3 });
  EXPECT_TRUE((runs.costs.array() == linear.nominal.cost).all());
  EXPECT_EQ(runs.costs, runs.model_costs);
  EXPECT_EQ(runs.clearance()(0), std::numeric_limits<double>::infinity());
  EXPECT_FALSE(runs.collided().any());

  const ThesisScene thesis = thesisScene("4.5");
  PlanarScene scene = thesis.scene;
  for (Mover& mover : scene.movers)
    mover.diffusion.resize(4, 0);
  const auto result = neutral(scene);
  EXPECT_EQ(rollOuts(scene, result.nominal, result.policy, { 1 }).costs(0), result.nominal.cost);
}

TEST(StochasticRollout, FirstRollOutsDoNotDependOnTheCountNorOnTheSizes)
{
  const PlanarScene scene = thesisScene("4.7").scene;
  const auto result = neutral(scene);
  const RollOuts few = rollOuts(scene, result.nominal, result.policy, { 20, 7 });
  const RollOuts many = rollOuts(scene, result.nominal, result.policy, { 40, 7 });
  EXPECT_EQ(few.costs, many.costs.head(20));
  EXPECT_EQ(few.distances, many.distances.topRows(20));
  EXPECT_NE(few.costs(0), few.costs(1));
  const RollOuts other = rollOuts(scene, result.nominal, result.policy, { 20, 8 });
  EXPECT_TRUE((few.costs.array() != other.costs.array()).all());

  const FixedPolicy policy = fixed(result);
  const RollOuts same = rollOuts(scene, policy.nominal, policy.policy, { 20, 7 });
  EXPECT_LT((same.costs - few.costs).cwiseAbs().maxCoeff(), kRounding);
}

// The costs of an undriven body's motion show the noise it met: it must be the same under any policy. Here the robot
// stands still (mass of 1e9 kg), so that all costs and distances are the movers'.
TEST(StochasticRollout, EveryPolicyMeetsTheSameNoise)
{
  PlanarScene scene = smallScene();
  scene.robot = std::make_shared<PointMass>(Vector2d(1e9, 1e9));
  scene.control_weight *= 1e-12;
  const auto problem = problemOf(scene);
  Trajectory<> nominal;
  LqPolicy<> still, lively;
  for (LqPolicy<>* policy : { &still, &lively })
    policy->resize(scene.horizon, 12, 2);
  nominal.resize(scene.horizon, 12, 2);
  ASSERT_TRUE(rollOut(problem, scene.start(), nominal));
  for (auto& gain : lively.gains)
    gain.setOnes();
  const RollOuts one = rollOuts(scene, nominal, still, { 50, 3 }), two = rollOuts(scene, nominal, lively, { 50, 3 });
  EXPECT_NE(one.costs, two.costs);  // the controls cost a little
  EXPECT_LT((one.distances - two.distances).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_LT((one.costs - two.costs).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_GT(std::sqrt(variance(one.costs)), 1e-3);
}

// In a linear plant under a linear policy deviations add up, hence the distances under a source that acts alone are
// those of a scene that has no other.
TEST(StochasticRollout, ASourceAloneActsAsAmongTheOthers)
{
  const PlanarScene scene = smallScene();
  PlanarScene quiet = scene;
  quiet.movers[1].diffusion.resize(4, 0);
  const auto result = neutral(scene);
  const RollOuts alone = rollOuts(scene, result.nominal, result.policy, { 100, 3, 0 });
  const RollOuts only = rollOuts(quiet, result.nominal, result.policy, { 100, 3 });
  const RollOuts all = rollOuts(scene, result.nominal, result.policy, { 100, 3 });
  EXPECT_EQ(alone.costs, only.costs);
  EXPECT_EQ(alone.distances, only.distances);
  EXPECT_TRUE((alone.costs.array() != all.costs.array()).all());
  EXPECT_THROW(rollOuts(scene, result.nominal, result.policy, { 100, 3, 2 }), std::invalid_argument);
  EXPECT_THROW(rollOuts(scene, result.nominal, result.policy, { 0 }), std::invalid_argument);
  IterativeResult<> broken = result;
  broken.policy.gains.pop_back();
  EXPECT_THROW(rollOuts(scene, result.nominal, broken.policy), std::invalid_argument);
  broken = result;
  broken.policy.gains[2](1, 3) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(rollOuts(scene, result.nominal, broken.policy), std::invalid_argument);
}

// (section 4.5) Averaging over the place first or simulating it: one expectation. Other sources are silent, so that
// nothing but the places varies; then with them.
TEST(StochasticRollout, PlacesAreDrawnAsTheirClosedFormExpects)
{
  PlanarScene scene = smallScene();
  const auto result = neutral(scene);
  const RollOuts noisy = rollOuts(scene, result.nominal, result.policy, { 40000, 11 });
  for (Mover& mover : scene.movers)
    mover.diffusion.resize(4, 0);
  const RollOuts places = rollOuts(scene, result.nominal, result.policy, { 40000, 11 });
  EXPECT_TRUE((places.model_costs.array() == result.nominal.cost).all());
  for (const RollOuts& runs : { noisy, places })
  {
    const VectorXd excess = runs.costs - runs.model_costs;
    EXPECT_NEAR(mean(excess), 0.0, kErrors * meanError(excess));
    EXPECT_GT(std::sqrt(variance(excess)), 0.1);
  }
}

// A robot that stands still sees one cost h of the drawn place over the whole horizon, dt T of it running and, of a
// goal, all of it once more at the end: Var J = (dt T + 1)^2 Var h, of an obstacle (dt T)^2 Var h, Var h in closed
// form.
TEST(StochasticRollout, SpreadOverPlacesIsThatOfTheClosedForm)
{
  for (const bool goal : { false, true })
  {
    PlanarScene scene = smallScene();
    scene.robot = std::make_shared<PointMass>(Vector2d(1e9, 1e9));
    scene.movers.clear();
    scene.goals.clear();
    scene.obstacles.clear();
    const double seen = scene.dt * scene.horizon + (goal ? 1.0 : 0.0);
    double expected = 0.0;
    if (goal)
      expected = scene.static_goals[0].belief.cumulant(2).value(Vector2d::Zero());
    else
      expected = value(scene.static_obstacles[0].belief.cumulant(2), Vector2d::Zero());
    if (goal)
      scene.static_obstacles.clear();
    else
      scene.static_goals.clear();
    Trajectory<> nominal;
    LqPolicy<> policy;
    nominal.resize(scene.horizon, 4, 2);
    policy.resize(scene.horizon, 4, 2);
    ASSERT_TRUE(rollOut(problemOf(scene), scene.start(), nominal));
    const RollOuts runs = rollOuts(scene, nominal, policy, { 40000, 13 });
    const VectorXd& costs = runs.costs;
    EXPECT_NEAR(mean(costs), runs.model_costs(0), kErrors * meanError(costs)) << goal;
    EXPECT_NEAR(variance(costs), seen * seen * expected, kErrors * varianceError(costs)) << goal;
  }
}

// The attitude to a place is in the problem's cost, not in the world.
TEST(StochasticRollout, TrueCostHasNoAttitudeToThePlace)
{
  const PlanarScene scene = smallScene();
  PlanarScene averse = scene;
  averse.static_goals[0].theta = 1.0;
  averse.static_obstacles[0].gamma = { 3.0 };
  const auto result = neutral(scene);
  const RollOuts one = rollOuts(scene, result.nominal, result.policy, { 20, 5 });
  const RollOuts two = rollOuts(averse, result.nominal, result.policy, { 20, 5 });
  EXPECT_LT((one.costs - two.costs).cwiseAbs().maxCoeff(), kRounding);
  EXPECT_GT((two.model_costs - one.model_costs).minCoeff(), 0.01);  // averse: both are dearer
}

// At a certain place the closed form is the cost itself, averse or not.
TEST(StochasticRollout, ACertainPlaceIsWhereItIs)
{
  PlanarScene scene = smallScene();
  const Eigen::Matrix2d zero = Eigen::Matrix2d::Zero(), unit = Eigen::Matrix2d::Identity();
  scene.static_goals = { { UncertainGoal(Vector2d(0.5, -0.5), zero, unit), 2.0 } };
  scene.static_obstacles = { { UncertainObstacle(Vector2d(0.3, 0.1), zero, 5.0 * unit, 0.7), { 1.0, -0.5 } } };
  const auto result = neutral(scene);
  const RollOuts runs = rollOuts(scene, result.nominal, result.policy, { 20, 1 });
  EXPECT_LT((runs.costs - runs.model_costs).cwiseAbs().maxCoeff(), kRounding);
}

// The robot moves along the x axis from 0 to 1 at 1 m/s past an obstacle of width 0.2 m at (0.5, y).
TEST(StochasticRollout, CollisionIsWithinOneWidth)
{
  for (const double y : { 0.19, 0.21 })
  {
    PlanarScene scene;
    scene.name = "pass";
    scene.robot = std::make_shared<PointMass>(Vector2d::Ones(), Vector2d::Zero());
    scene.robot_start = (VectorXd(4) << 0.0, 0.0, 1.0, 0.0).finished();
    scene.dt = 0.05;
    scene.horizon = 20;
    const Eigen::Matrix2d weight = 25.0 * Eigen::Matrix2d::Identity();
    scene.movers = { { "obstacle", scene.robot, (VectorXd(4) << 0.5, y, 0.0, 0.0).finished(), MatrixXd() },
                     { "far", scene.robot, (VectorXd(4) << 0.5, 2.0, 0.0, 0.0).finished(), MatrixXd() } };
    scene.obstacles = { { 1, weight, 0.1 }, { 0, weight, 0.1 } };
    scene.static_obstacles = { { UncertainObstacle(Vector2d(1.0, 0.4), Eigen::Matrix2d::Zero(), weight, 0.1), {} } };
    Trajectory<> nominal;
    LqPolicy<> policy;
    nominal.resize(20, 12, 2);
    policy.resize(20, 12, 2);
    ASSERT_TRUE(rollOut(problemOf(scene), scene.start(), nominal));
    const RollOuts runs = rollOuts(scene, nominal, policy, { 2 });
    ASSERT_EQ(runs.distances.cols(), 3);
    EXPECT_NEAR(runs.distances(0, 0), 2.0 / 0.2, kRounding);
    EXPECT_NEAR(runs.distances(0, 1), y / 0.2, kRounding);
    EXPECT_NEAR(runs.distances(0, 2), 0.4 / 0.2, kRounding);  // met at the last sample
    EXPECT_EQ(runs.clearance()(1), runs.distances.row(1).minCoeff());
    EXPECT_EQ(runs.collided()(1), y < 0.2);
  }
}

TEST(StochasticRollout, ControlsStayInsideTheirLimits)
{
  LinearCase linear = linearCase(9, 15);
  const VectorXd free = rollOuts(linear.problem, linear.nominal, linear.policy, { 100 }).costs;
  linear.problem.lower = linear.problem.upper = linear.nominal.controls[0];  // one control is left
  Trajectory<3, 2> held = linear.nominal;
  ASSERT_TRUE(rollOut(linear.problem, linear.nominal.states[0], held));
  const VectorXd costs = rollOuts(linear.problem, linear.nominal, linear.policy, { 100 }).costs;
  EXPECT_TRUE((costs.array() != free.array()).all());
  linear.policy.resize(15, 3, 2);  // no feedback, around the held controls
  EXPECT_EQ(costs, rollOuts(linear.problem, held, linear.policy, { 100 }).costs);
}

// As many allocations for a thousand roll-outs as for one.
TEST(StochasticRollout, AllocatesNothingPerRollOut)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP();
  const auto count = [](const PlanarScene& scene, const auto& result, int runs) {
    return phri_core::testing::countAllocations([&] { rollOuts(scene, result.nominal, result.policy, { runs, 1 }); });
  };
  for (const char* figure : { "4.7", "4.9", "4.10" })
  {
    PlanarScene scene = thesisScene(figure).scene;
    scene.horizon = 20;
    scene.static_goals = smallScene().static_goals;
    const auto dynamic = neutral(scene);
    EXPECT_EQ(count(scene, dynamic, 1), count(scene, dynamic, 1000)) << figure;
  }
  const FixedPolicy policy = fixed(neutral(smallScene()));
  EXPECT_EQ(count(smallScene(), policy, 1), count(smallScene(), policy, 1000));
}
