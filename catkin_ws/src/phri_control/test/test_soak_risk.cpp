// Random risk-sensitive problems: every solve ends in a finite policy or in a typed breakdown, and what it ends in is
// what the eigenvalues of the stacked form say.
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "risk_oracle.hpp"
#include "soak_problems.hpp"

using namespace soak_problems;

namespace
{
// -theta E'WE beyond the digits of a double (a seeking theta, or a negative W) leaves of W what rounding does: the
// solver may then refuse a policy that exists (NotFinite).
constexpr double kPrecision = 1e12;

/// The largest eigenvalue of theta M from stage `first` on, in units of what rounding may hide around 1: below -1 the
/// expectation exists, above 1 it does not.
template <int N, int M, typename Solution>
double excess(const LinearQuadraticProblem<N, M>& rest, int source, double theta, const Solution& policy)
{
  const risk_oracle::StackedCost stacked(rest, source, policy.gains, policy.feedforward,
                                         VectorXd(VectorXd::Zero(rest.stateSize())));
  const Eigen::ArrayXd loss = theta * stacked.spectrum().array();
  return (loss.maxCoeff() - 1.0) / (kClose * std::max(1.0, loss.abs().maxCoeff()));
}

/// The largest |theta E'WE| that the solver meets down to stage `last`.
template <int N, int M>
double reach(const LinearQuadraticProblem<N, M>& problem, const RiskSensitive& attitude, int last)
{
  double most = 0.0;
  for (int k = static_cast<int>(problem.horizon()) - 1; k >= last; --k)
  {
    RiskSolution<N, M> later;
    if (k + 1 < static_cast<int>(problem.horizon()))
      solve(tail(problem, k + 1), attitude, later);
    for (std::size_t s = 0; s < problem.noise.size(); ++s)
    {
      const MatrixXd W = later.values.empty() ? MatrixXd(problem.terminal.Q) : MatrixXd(later.values[s].W);
      const MatrixXd& factor = problem.noise[s].at(k);
      most = std::max(most, std::abs(attitude.theta[s]) * (factor.transpose() * W * factor).norm());
    }
  }
  return most;
}

/// The value changes by more than kClose, or ceases to be, when the dynamics change by 1e-11 of themselves.
template <int N, int M>
bool illConditioned(LinearQuadraticProblem<N, M> problem, const RiskSensitive& attitude,
                    const RiskSolution<N, M>& solution)
{
  Random random(1);
  for (LqStage<N, M>& stage : problem.stages)
  {
    stage.A += 1e-11 * stage.A.cwiseProduct(lq_fixtures::randomMatrix(random, stage.A.rows(), stage.A.cols()));
    stage.B += 1e-11 * stage.B.cwiseProduct(lq_fixtures::randomMatrix(random, stage.B.rows(), stage.B.cols()));
  }
  RiskSolution<N, M> other;
  if (!solve(problem, attitude, other))
    return true;
  for (std::size_t s = 0; s < solution.values.size(); ++s)
    if (!((other.values[s].W - solution.values[s].W).norm() <= kClose * solution.values[s].W.norm()))
      return true;
  return false;
}

template <int N, int M>
void compareWithStacked(const LinearQuadraticProblem<N, M>& problem, const RiskSensitive& attitude,
                        const RiskSolution<N, M>& solution, soak::Tally& tally)
{
  const RiskStatus& status = solution.status;
  const int first = status ? 0 : status.stage;
  const auto rest = tail(problem, first);
  const VectorXd still = VectorXd::Zero(rest.controlSize());
  const auto policy = tailPolicy(solution, first, rest.stateSize(), still);
  bool certain = true;  // that the expectation exists: no eigenvalue within rounding of 1
  if (status || status.kind == BreakdownKind::Hessian)
  {
    for (std::size_t s = 0; s < problem.noise.size(); ++s)
    {
      const double found = excess(rest, s, attitude.theta[s], policy);
      EXPECT_LT(found, 1.0) << "source " << s;
      certain = certain && found < -1.0;
    }
  }
  if (status.kind == BreakdownKind::Expectation)
  {
    EXPECT_GT(excess(rest, status.source, status.theta, policy), -1.0) << "exists, said not to";
    if (rest.horizon() > 1)
    {
      const auto later = tail(problem, first + 1);
      EXPECT_LT(excess(later, status.source, status.theta, tailPolicy(solution, first + 1, rest.stateSize(), still)),
                1.0)
          << "broke down at a later stage already";
    }
  }
  else if (status.kind == BreakdownKind::Hessian && certain)
  {
    RiskSensitive padded = attitude;
    padded.theta.resize(rest.noise.size(), 0.0);
    const auto value = [&](const VectorXd& u) {
      const auto changed = tailPolicy(solution, first, rest.stateSize(), u);
      return risk_oracle::criterion(rest, padded, changed.gains, changed.feedforward,
                                    VectorXd(VectorXd::Zero(rest.stateSize())));
    };
    EXPECT_LT(curvature(value, rest.controlSize()), kClose) << "the criterion has a minimum, said not to";
  }
  tally.count(std::string("checked_") + nameOf(status.kind));
}

template <int N, int M>
void riskProblem(Random& random, Eigen::Index n, Eigen::Index m, bool checked, soak::Tally& tally)
{
  const int sources = soak::number(random, 0, 3);
  const Case<N, M> given = randomCase<N, M>(random, n, m, sources);
  const LinearQuadraticProblem<N, M>& problem = given.problem;
  const int horizon = static_cast<int>(problem.horizon());
  const bool relative = random.uniform() < 0.8;
  RiskSensitive attitude;
  for (int s = 0; s < sources; ++s)
    attitude.theta.push_back((random.uniform() < 0.4 ? -1.0 : 1.0) * (relative
                                                                          ? soak::scale(random, -6.0, 2.0) / given.unit
                                                                          : soak::scale(random, -12.0, 12.0)));
  static thread_local RiskSolution<N, M> solution;
  static thread_local RiskEvaluation<N> evaluation;
  const RiskStatus status = solve(problem, attitude, solution);
  tally.count(nameOf(status.kind));
  if (status)
  {
    ASSERT_EQ(int(solution.gains.size()), horizon);
    for (int k = 0; k < horizon; ++k)
      ASSERT_TRUE(solution.gains[k].allFinite() && solution.feedforward[k].allFinite()) << "stage " << k;
    const VectorXd x0 = VectorXd::LinSpaced(n, -1.0, 2.0);
    ASSERT_TRUE(std::isfinite(solution.value(x0)));
    bool same = static_cast<bool>(evaluate(problem, attitude, solution.gains, solution.feedforward, evaluation));
    for (std::size_t s = 0; same && s < solution.values.size(); ++s)
    {
      const auto& W = solution.values[s].W;
      same = (evaluation.values[s].W - W).norm() <= kClose * W.norm();
    }
    if (!same)
    {
      ASSERT_TRUE(illConditioned(problem, attitude, solution));
      tally.count("ill_conditioned");
    }
  }
  else
  {
    ASSERT_TRUE(status.stage >= 0 && status.stage < horizon);
    if (status.kind == BreakdownKind::Expectation)
    {
      ASSERT_TRUE(status.source >= 0 && status.source < sources);
      ASSERT_EQ(status.theta, attitude.theta[status.source]);
      ASSERT_GE(status.theta / status.limit, 1.0 - kClose) << "theta " << status.theta << " limit " << status.limit;
    }
    if (status.kind == BreakdownKind::NotFinite && !given.grows)
    {
      ASSERT_GT(reach(problem, attitude, status.stage), kPrecision) << "nothing overflows here";
      tally.count("beyond_precision");
    }
  }
  if (checked && status.kind != BreakdownKind::NotFinite && !given.grows && stackedSize(problem) <= kStacked)
    compareWithStacked(problem, attitude, solution, tally);
}
}  // namespace

TEST(SoakRisk, randomProblemsEndFiniteOrTyped)
{
  const soak::Tally tally = soak::run(10000, [](std::uint64_t number, Random& random, soak::Tally& count) {
    const bool checked = random.uniform() * kChecked < 1.0;
    const int n = soak::number(random, 1, 8), m = soak::number(random, 1, std::min(n, 4));
    if (number % 4 == 0)
      riskProblem<4, 2>(random, 4, 2, checked, count);
    else
      riskProblem<Eigen::Dynamic, Eigen::Dynamic>(random, n, m, checked, count);
  });
  for (const char* met : { "policy", "expectation", "hessian" })  // every outcome is really met
    tally.expectMoreThan(0.05, met);
  for (const char* met : { "not_finite", "checked_policy", "checked_expectation", "checked_hessian" })
    tally.expectMoreThan(0.001, met);
}
