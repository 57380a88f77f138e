// Random problems for cost cumulants: every solve ends in a finite policy with the cumulants of the stacked form, or in
// a typed breakdown where the stacked criterion has no minimum.
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "cumulant_oracle.hpp"
#include "soak_problems.hpp"

using namespace soak_problems;

namespace
{
// A second difference of sums of cumulants up to the fifth, relative to the largest one.
constexpr double kCurvature = 1e-6;
// One in a thousand of the policies moves the state so much between stages that the two orders of summing agree to half
// of the digits only.
constexpr double kRough = 1e-3, kRare = 1e-3;
// Nearly singular H with gains of 1e3 and more: nothing is left of a variance near 0. Met 2 times in 700 000.
constexpr double kVeryRare = 1e-5;

/// Cumulants of the tail's cost under every source, weighted as the criterion.
template <int N, int M>
double cumulantCriterion(const LinearQuadraticProblem<N, M>& problem, const CostCumulants& attitude,
                         const CumulantSolution<N, M>& policy)
{
  double sum = 0.0;
  for (std::size_t s = 0; s < problem.noise.size(); ++s)
  {
    const auto form = phri_control_test::stackedForm(problem, policy, s, VectorXd::Zero(problem.stateSize()));
    sum += form.cumulant(1);
    for (int r = 2; r <= attitude.gamma.cols() + 1; ++r)
      sum += attitude.gamma(s, r - 2) * form.cumulant(r);
  }
  return sum / double(problem.noise.size());
}

template <int N, int M>
void compareCumulants(const LinearQuadraticProblem<N, M>& problem, const CostCumulants& attitude,
                      const CumulantSolution<N, M>& solution, soak::Tally& tally)
{
  const RiskStatus& status = solution.status;
  if (status)
  {
    const VectorXd xi = VectorXd::LinSpaced(problem.stateSize(), -1.0, 2.0);
    const MatrixXd kappa = solution.cumulants(xi);
    for (std::size_t s = 0; s < problem.noise.size(); ++s)
    {
      const auto form = phri_control_test::stackedForm(problem, solution, s, xi);
      // terms of either sign, each as large as the same sum of their magnitudes
      const VectorXd spectrum = Eigen::SelfAdjointEigenSolver<MatrixXd>(form.M, Eigen::EigenvaluesOnly).eigenvalues();
      const double largest = std::max(spectrum.cwiseAbs().maxCoeff(), 1e-300);
      for (int r = 1; r <= kappa.cols(); ++r)
      {
        const double quadratic = std::tgamma(double(r)) / 2.0 * spectrum.array().abs().pow(double(r)).sum();
        const double affine = r == 1 ? std::abs(form.c) + form.b.norm()
                                     : std::tgamma(r + 1.0) / 2.0 * form.b.squaredNorm() * std::pow(largest, r - 2);
        const double difference = std::abs(kappa(s, r - 1) - form.cumulant(r)), size = quadratic + affine;
        if (difference <= kClose * size)
          continue;
        EXPECT_LE(difference, kRough * size) << "kappa " << r << " of " << s;
        tally.count("roughly_equal");
      }
    }
  }
  else
  {
    const auto rest = tail(problem, status.stage);
    CostCumulants padded = attitude;
    if (padded.gamma.rows() < Eigen::Index(rest.noise.size()))
      padded.gamma = MatrixXd::Zero(rest.noise.size(), attitude.gamma.cols());
    const auto value = [&](const VectorXd& u) {
      return cumulantCriterion(rest, padded, tailPolicy(solution, status.stage, rest.stateSize(), u));
    };
    EXPECT_LT(curvature(value, rest.controlSize()), kCurvature) << "the criterion has a minimum, said not to";
  }
  tally.count(std::string("checked_") + nameOf(status.kind));
}

template <int N, int M>
void cumulantProblem(Random& random, Eigen::Index n, Eigen::Index m, bool checked, soak::Tally& tally)
{
  const int sources = soak::number(random, 0, 3), count = soak::number(random, 1, 5);
  const Case<N, M> given = randomCase<N, M>(random, n, m, sources);
  const LinearQuadraticProblem<N, M>& problem = given.problem;
  const int horizon = static_cast<int>(problem.horizon());
  CostCumulants attitude{ lq_fixtures::randomMatrix(random, sources, count - 1) };
  if (random.uniform() < 0.6)
    attitude.gamma = attitude.gamma.cwiseAbs().eval();
  const double ratio = soak::scale(random, -6.0, 1.0) / given.unit;
  for (int r = 2; r <= count; ++r)
    attitude.gamma.col(r - 2) *= std::pow(ratio, r - 1) / std::tgamma(r + 1.0);
  static thread_local CumulantSolution<N, M> solution;
  static thread_local CumulantValues<N> values;
  const RiskStatus status = solve(problem, attitude, solution);
  tally.count(nameOf(status.kind));
  if (status)
  {
    for (int k = 0; k < horizon; ++k)
      ASSERT_TRUE(solution.gains[k].allFinite() && solution.feedforward[k].allFinite()) << "stage " << k;
    const VectorXd x0 = VectorXd::LinSpaced(n, -1.0, 2.0);
    ASSERT_TRUE(solution.value.W.allFinite() && solution.value.w.allFinite() && std::isfinite(solution.value.c));
    const MatrixXd kappa = solution.cumulants(x0);
    if (count > 1 && !given.grows)
    {
      ASSERT_TRUE(kappa.allFinite());
      if (kappa.col(1).minCoeff() < 0.0)
        tally.count("negative_variance");
    }
    ASSERT_TRUE(evaluateCumulants(problem, count, solution.gains, solution.feedforward, values));
    for (std::size_t i = 0; i < values.series.size(); ++i)
    {
      const auto& W = solution.values.series[i].W;
      ASSERT_LE((values.series[i].W - W).norm(), kClose * W.norm());
    }
  }
  else
  {
    ASSERT_TRUE(status.stage >= 0 && status.stage < horizon);
    ASSERT_NE(status.kind, BreakdownKind::Expectation);
    if (status.kind == BreakdownKind::NotFinite)
    {
      ASSERT_TRUE(given.grows) << "nothing overflows here";
    }
  }
  if (checked && status.kind != BreakdownKind::NotFinite && !given.grows && stackedSize(problem) <= kStacked)
    compareCumulants(problem, attitude, solution, tally);
}
}  // namespace

TEST(SoakCumulants, randomProblemsEndFiniteOrTyped)
{
  const soak::Tally tally = soak::run(10000, [](std::uint64_t number, Random& random, soak::Tally& count) {
    const bool checked = random.uniform() * kChecked < 1.0;
    const int n = soak::number(random, 1, 8), m = soak::number(random, 1, std::min(n, 4));
    if (number % 4 == 0)
      cumulantProblem<4, 2>(random, 4, 2, checked, count);
    else
      cumulantProblem<Eigen::Dynamic, Eigen::Dynamic>(random, n, m, checked, count);
  });
  for (const char* met : { "policy", "hessian" })
    tally.expectMoreThan(0.05, met);
  for (const char* met : { "not_finite", "checked_policy", "checked_hessian" })
    tally.expectMoreThan(0.001, met);
  EXPECT_LE(tally.of("roughly_equal"), 1 + kRare * tally.of("checked_policy"));
  EXPECT_LE(tally.of("negative_variance"), kVeryRare * tally.of("policy")) << "more than rounding can do";
}
