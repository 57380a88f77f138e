// The iterative solver with problems that are not finite or malformed: every end is typed or named.
#include <gtest/gtest.h>

#include <limits>

#include "iterative_fixtures.hpp"
#include "phri_control/iterative_solver.hpp"

using namespace phri_control;

namespace
{
const Eigen::Vector4d kWalker = Eigen::Vector4d::Zero();
const Attitude kNeutral = RiskSensitive{ { 0.0 } };
}  // namespace

TEST(IterativeFailures, NotFiniteIsTyped)
{
  struct Broken : fixtures::PointMass
  {
    bool derivatives_only = false;
    void step(int k, const State& x, const Control& u, State& next) const override
    {
      fixtures::PointMass::step(k, x, u, next);
      if (k == 7 && !derivatives_only)
        next(1) = std::numeric_limits<double>::quiet_NaN();
    }
    void linearise(int k, const State& x, const Control& u, StateMatrix& A, InputMatrix& B) const override
    {
      fixtures::PointMass::linearise(k, x, u, A, B);
      if (k == 7)
        A(0, 0) = std::numeric_limits<double>::quiet_NaN();
    }
  };
  for (const bool derivatives_only : { false, true })
  {
    OptimalControlProblem<4, 2> problem = fixtures::passBy();
    const auto broken = std::make_shared<Broken>();
    broken->derivatives_only = derivatives_only;
    problem.dynamics = broken;
    const auto result = solveIterative(problem, kWalker, kNeutral);
    EXPECT_EQ(result.status, IterativeStatus::NotFinite);
    EXPECT_EQ(result.risk.kind, BreakdownKind::NotFinite);
    EXPECT_FALSE(result.usable);
  }
}

TEST(IterativeFailures, NotFiniteCostWithMixedTermIsTyped)
{
  struct Broken : fixtures::PassBy
  {
    void expand(int k, const State& x, const Control& u, CostExpansion<4, 2>& out) const override
    {
      fixtures::PassBy::expand(k, x, u, out);
      out.S.setZero();
      out.has_cross = true;
      if (k == 7)
        out.R(0, 0) = std::numeric_limits<double>::quiet_NaN();
    }
  };
  OptimalControlProblem<4, 2> problem = fixtures::passBy();
  problem.cost = std::make_shared<Broken>();
  const auto result = solveIterative(problem, kWalker, kNeutral);
  EXPECT_EQ(result.status, IterativeStatus::NotFinite);
  EXPECT_EQ(result.risk.stage, 7);
  EXPECT_FALSE(result.usable);
}

TEST(IterativeFailures, MalformedProblemsAreNamed)
{
  OptimalControlProblem<4, 2> problem = fixtures::passBy();
  EXPECT_THROW(solveIterative(problem, kWalker, Attitude(RiskSensitive{ { 0.0, 1.0 } })), std::invalid_argument);
  EXPECT_THROW(solveIterative(problem, kWalker, Attitude(RiskSensitive{ { std::nan("") } })), std::invalid_argument);
  EXPECT_THROW(solveIterative(problem, kWalker, Attitude(CostCumulants{ Eigen::MatrixXd::Zero(2, 1) })),
               std::invalid_argument);
  EXPECT_THROW(solveIterative(problem, kWalker, kNeutral, {}, std::vector<Eigen::Vector2d>(3)), std::invalid_argument);
  problem.lower = Eigen::Vector2d(1.0, 0.0);
  problem.upper = Eigen::Vector2d(0.0, 1.0);
  EXPECT_THROW(solveIterative(problem, kWalker, kNeutral), std::invalid_argument);
  problem = fixtures::passBy();
  problem.cost.reset();
  EXPECT_THROW(solveIterative(problem, kWalker, kNeutral), std::invalid_argument);
}
