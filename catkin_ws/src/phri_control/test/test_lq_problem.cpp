// The problem value: what the validator refuses, and by which name.
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "phri_control/lq_problem.hpp"

using namespace phri_control;

namespace
{
LinearQuadraticProblem<> goodProblem()
{
  LinearQuadraticProblem<> problem;
  problem.terminal = LqTerminal<>::zero(4);
  problem.stages.assign(5, LqStage<>::zero(4, 2));
  for (LqStage<>& stage : problem.stages)
    stage.R.setIdentity();
  return problem;
}

/// Message of the error that `validate` throws after `spoil`, empty if it throws none.
std::string complaint(const std::function<void(LinearQuadraticProblem<>&)>& spoil)
{
  LinearQuadraticProblem<> problem = goodProblem();
  spoil(problem);
  try
  {
    validate(problem);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}
}  // namespace

TEST(LqProblem, acceptsAGoodProblem)
{
  EXPECT_EQ(complaint([](auto&) {}), "");
}

TEST(LqProblem, namesTheFieldThatIsWrong)
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  using P = LinearQuadraticProblem<>;
  const std::pair<std::string, std::function<void(P&)>> cases[] = {
    { "stages", [](P& p) { p.stages.clear(); } },
    { "stages[3].A", [](P& p) { p.stages[3].A.setZero(3, 4); } },
    { "stages[3].B", [](P& p) { p.stages[3].B.setZero(4, 3); } },
    { "stages[1].d", [](P& p) { p.stages[1].d.setZero(3); } },
    { "stages[2].q", [nan](P& p) { p.stages[2].q(1) = nan; } },
    { "stages[0].Q", [](P& p) { p.stages[0].Q(0, 1) = 1.0; } },
    { "stages[4].R", [](P& p) { p.stages[4].R(1, 0) = 1.0; } },
    { "stages[4].r", [](P& p) { p.stages[4].r.setZero(3); } },
    { "stages[4].q0", [nan](P& p) { p.stages[4].q0 = nan; } },
    { "terminal.Q", [](P& p) { p.terminal.Q(2, 0) = 1.0; } },
    { "terminal.q", [](P& p) { p.terminal.q.setZero(2); } },
    { "hand", [](P& p) { p.noise.push_back(NoiseSource::fromFactor("hand", Eigen::MatrixXd::Zero(3, 1))); } },
    { "hand",
      [](P& p) {
        p.noise.push_back(
            NoiseSource::fromFactor("hand", std::vector<Eigen::MatrixXd>(4, Eigen::MatrixXd::Zero(4, 1))));
      } },
  };
  for (const auto& [name, spoil] : cases)
    EXPECT_NE(complaint(spoil).find(name), std::string::npos) << name << ": " << complaint(spoil);
}

// A covariance defines its factor only up to a rotation; factor factor' must give it back, singular or not.
TEST(LqProblem, factorOfACovarianceReproducesIt)
{
  Eigen::MatrixXd singular(3, 3);
  singular << 4, 2, 0, 2, 1, 0, 0, 0, 9;
  for (const Eigen::MatrixXd& covariance : { singular, Eigen::MatrixXd(Eigen::MatrixXd::Zero(3, 3)) })
  {
    const Eigen::MatrixXd factor = NoiseSource::fromCovariance("s", covariance).at(7);
    constexpr double kRounding = 1e-14;
    EXPECT_LT((factor * factor.transpose() - covariance).norm(), kRounding * (1.0 + covariance.norm()));
  }
  EXPECT_THROW(NoiseSource::fromCovariance("s", Eigen::MatrixXd(-Eigen::MatrixXd::Identity(2, 2))),
               std::invalid_argument);
}
