// Model predictive control with the iterative solver: no allocation, tracking, warm starts, and what happens when a
// plan fails.
#include <gtest/gtest.h>

#include <limits>

#include "iterative_fixtures.hpp"
#include "phri_control/mpc.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;

namespace
{
// Mean distance to a goal that walks at 0.3 m/s: the lag of a controller that plans for a resting goal is below 0.3 m
// (the criterion trades it for effort), that of one that stands still grows to 1.5 m.
constexpr double kLag = 0.3;

const Attitude kAverse = RiskSensitive{ { 20.0 } };
}  // namespace

TEST(Mpc, AllocatesNothingAfterConstruction)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP();
  for (const Attitude& attitude : { kAverse, Attitude(CostCumulants{ Eigen::MatrixXd::Constant(1, 3, 0.5) }),
                                    Attitude(RiskSensitive{ { 1e6 } }) })  // the last one breaks down
    for (const bool reduce : { false, true })
    {
      OptimalControlProblem<4, 2> problem = fixtures::passBy();
      problem.lower = Eigen::Vector2d(-2.0, -0.3);
      MpcOptions options;
      options.iterations = 10;
      options.passes = 30;
      options.reduce = reduce;
      ModelPredictiveController<4, 2> controller(problem, attitude, options);
      Eigen::Vector4d x = Eigen::Vector4d::Zero(), next;
      Eigen::Vector2d u;
      bool acted = true;
      const long count = phri_core::testing::countAllocations([&] {
        for (int k = 0; k < 5; ++k)
        {
          controller.plan(x);
          acted = acted && controller.act(0, x, u);
          problem.dynamics->step(0, x, u, next);
          x = next;
        }
      });
      EXPECT_EQ(count, 0);
      EXPECT_TRUE(acted);
    }
}

TEST(Mpc, FollowsAMovingGoalWithOneIterationPerPlan)
{
  const auto cost = std::make_shared<fixtures::PassBy>();
  cost->weight = 0.0;
  cost->goal.setZero();
  const OptimalControlProblem<4, 2> problem = fixtures::passBy(0.02, cost);
  ModelPredictiveController<4, 2> controller(problem, kAverse);
  Eigen::Vector4d x = Eigen::Vector4d::Zero(), next;
  Eigen::Vector2d u;
  for (int k = 0; k < 100; ++k)
  {
    cost->goal(0) += 0.3 * problem.dt;
    const auto& result = controller.plan(x);
    EXPECT_LE(result.iterations, 1);
    ASSERT_TRUE(controller.act(0, x, u));
    problem.dynamics->step(0, x, u, next);
    x = next;
    EXPECT_LT((x.head<2>() - cost->goal).norm(), kLag);
  }
  EXPECT_GT(x(0), 1.0);
}

TEST(Mpc, WarmStartNeedsFewerIterationsThanCold)
{
  const OptimalControlProblem<4, 2> problem = fixtures::passBy();
  MpcOptions options;
  options.iterations = options.passes = 200;
  ModelPredictiveController<4, 2> controller(problem, kAverse, options);
  Eigen::Vector4d x = Eigen::Vector4d::Zero(), next;
  Eigen::Vector2d u;
  int warm = 0, cold = 0;
  for (int k = 0; k < 10; ++k)
  {
    const auto& result = controller.plan(x);
    ASSERT_TRUE(result) << result.message();
    const auto fresh = solveIterative(problem, x, kAverse);
    ASSERT_TRUE(fresh);
    if (k > 0)
    {
      warm += result.iterations;
      cold += fresh.iterations;
    }
    EXPECT_NEAR(result.criterion, fresh.criterion, 1e-6);  // warm or cold, one solution
    ASSERT_TRUE(controller.act(0, x, u));
    problem.dynamics->step(0, x, u, next);
    x = next;
  }
  EXPECT_LT(2 * warm, cold * 2 - 9);  // fewer on average, by more than one in two plans
}

// Eight samples later on the plan itself, the plan shifted by eight is nearer to the new optimum than the plan as it
// was.
TEST(Mpc, TheLastPlanIsShiftedInTime)
{
  const OptimalControlProblem<4, 2> problem = fixtures::passBy();
  constexpr int kShift = 8;
  int iterations[2];
  for (const bool shifted : { false, true })
  {
    MpcOptions options;
    options.iterations = options.passes = 200;
    ModelPredictiveController<4, 2> controller(problem, kAverse, options);
    ASSERT_TRUE(controller.plan(Eigen::Vector4d::Zero()));
    const Eigen::Vector4d later = controller.result().nominal.states[kShift];
    const auto& result = controller.plan(later, shifted ? kShift : 0);
    ASSERT_TRUE(result) << result.message();
    iterations[shifted] = result.iterations;
  }
  EXPECT_LT(iterations[true], iterations[false]);
}

TEST(Mpc, BreakdownActsRiskNeutrally)
{
  const OptimalControlProblem<4, 2> problem = fixtures::passBy();
  MpcOptions options;
  options.iterations = options.passes = 200;
  ModelPredictiveController<4, 2> broken(problem, Attitude(RiskSensitive{ { 1e6 } }), options);
  ModelPredictiveController<4, 2> neutral(problem, Attitude(RiskSensitive{ { 0.0 } }), options);
  const Eigen::Vector4d x0 = Eigen::Vector4d::Zero(), beside(0.1, 0.1, 0.0, 0.0);
  EXPECT_EQ(broken.plan(x0).status, IterativeStatus::Breakdown);
  EXPECT_EQ(neutral.plan(x0).status, IterativeStatus::Converged);
  Eigen::Vector2d u, v;
  ASSERT_TRUE(broken.act(3, beside, u));
  ASSERT_TRUE(neutral.act(3, beside, v));
  EXPECT_LT((u - v).norm(), 1e-9);
}

// Where a plan is not finite the last one goes on, shifted; at the end of its horizon there is nothing left.
TEST(Mpc, KeepsTheLastPolicyWhenAPlanFails)
{
  const OptimalControlProblem<4, 2> problem = fixtures::passBy();
  MpcOptions options;
  options.iterations = options.passes = 200;
  ModelPredictiveController<4, 2> controller(problem, kAverse, options);
  const Eigen::Vector4d x0 = Eigen::Vector4d::Zero();
  Eigen::Vector2d u, expected;
  EXPECT_FALSE(controller.act(0, x0, u));  // no plan yet
  EXPECT_EQ(u.norm(), 0.0);
  ASSERT_TRUE(controller.plan(x0));
  ASSERT_TRUE(controller.act(6, x0, expected));
  const Eigen::Vector4d lost = Eigen::Vector4d::Constant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(controller.plan(lost, 5).status, IterativeStatus::NotFinite);
  ASSERT_TRUE(controller.act(1, x0, u));
  EXPECT_EQ(u, expected);
  EXPECT_FALSE(controller.act(1, lost, u));
  EXPECT_EQ(u.norm(), 0.0);
  controller.plan(lost, problem.horizon);
  EXPECT_FALSE(controller.act(0, x0, u));
  EXPECT_TRUE(controller.plan(x0)) << controller.result().message();  // and it recovers
}

TEST(Mpc, PolicyOfTheInteractionLoopActsAlike)
{
  const OptimalControlProblem<4, 2> problem = fixtures::passBy();
  ModelPredictiveController<4, 2> controller(problem, kAverse);
  controller.plan(Eigen::Vector4d::Zero());
  const FeedbackPolicy policy = controller.policy(2.0, 3);
  EXPECT_EQ(policy.source(), 3);
  const Eigen::Vector4d x(0.05, 0.02, 0.1, -0.1);
  for (const int k : { 0, 7, 39 })
  {
    Eigen::Vector2d u;
    phri_core::VectorDof v;
    ASSERT_TRUE(controller.act(k, x, u));
    ASSERT_TRUE(policy.act(2.0 + (k + 0.5) * problem.dt, phri_core::VectorState(x), v));
    EXPECT_LT((u - v).norm(), 1e-12 * (1.0 + u.norm()));
  }
  EXPECT_THROW(toFeedbackPolicy(Trajectory<2, 2>(), LqPolicy<2, 2>(), 0.0, 0.1), std::invalid_argument);
}
