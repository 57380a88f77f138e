// Random left-to-right fits: whatever the data, training ends in a finite model that is still left-to-right, and its
// likelihood never falls.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "fixtures.hpp"
#include "phri_core/soak.hpp"
#include "phri_learning/hmm_training.hpp"

using namespace phri_learning;
using phri_core::Random;

namespace
{
constexpr double kRounding = 1e-9;  // relative to the log-likelihood, a sum of up to some thousand terms
/// Of a covariance in units of the data, the difference of a mean square and a squared mean, each of size 1 to 10. It
/// costs half of this over the smallest eigenvalue allowed per sample.
constexpr double kCovarianceRounding = 1e-15;

Eigen::MatrixXd curve(Random& random, int samples, int d)
{
  Eigen::MatrixXd x(samples, d);
  const double pace = std::exp(0.3 * random.normal());
  for (int t = 0; t < samples; ++t)
    for (int j = 0; j < d; ++j)
      x(t, j) = std::sin(pace * (2.0 + j) * t / samples + j) + 0.02 * random.normal();
  return x;
}

std::vector<Eigen::MatrixXd> randomDemonstrations(Random& random, std::uint64_t number, int d, soak::Tally& tally)
{
  const int count = soak::number(random, 1, 6), kind = soak::number(random, 0, 6);
  const int longest = static_cast<int>(soak::scale(random, 0.0, 2.2));
  const TimeHmm truth(phri_learning::testing::randomModel(number, soak::number(random, 2, 6), 1, d));
  std::vector<Eigen::MatrixXd> all;
  for (int e = 0; e < count; ++e)
  {
    const int samples = soak::number(random, 1, longest);
    Eigen::MatrixXd x = curve(random, samples, d);
    if (kind == 1)
      x = sample(truth, samples, &random);
    else if (kind == 2)  // plateaus: states without a spread of their own
      x = (4.0 * x.array()).round();
    else if (kind == 3)  // on a line
      x = x.col(0) * Eigen::RowVectorXd::LinSpaced(d, 0.0, 1.0);
    else if (kind == 4)  // one sample far out
      x.row(soak::number(random, 0, samples - 1)).array() += soak::scale(random, 0.0, 6.0);
    else if (kind == 5 && e > 0)
      x = all.front();
    else if (kind == 6)
      x = x.rowwise().reverse().colwise().reverse().eval();
    all.push_back(x);
  }
  const char* names[] = { "curves", "model", "plateaus", "on_a_line", "outlier", "copies", "reversed" };
  tally.count(names[kind]);
  Eigen::RowVectorXd unit(d), offset(d);
  for (int j = 0; j < d; ++j)
  {
    unit(j) = soak::scale(random, -6.0, 6.0);
    offset(j) = unit(j) * soak::scale(random, -2.0, 3.0);
  }
  for (Eigen::MatrixXd& x : all)
    x = (x.array().rowwise() * unit.array()).rowwise() + offset.array();
  return all;
}

void expectSorted(const std::vector<int>& states, int count, const char* what)
{
  for (std::size_t k = 0; k < states.size(); ++k)
    ASSERT_TRUE(states[k] >= (k ? states[k - 1] + 1 : 0) && states[k] < count) << what << " " << states[k];
}
}  // namespace

TEST(SoakHmm, randomFitsStayFiniteLeftToRightAndNeverLoseLikelihood)
{
  const soak::Tally tally = soak::run(100, [](std::uint64_t number, Random& random, soak::Tally& count) {
    const int d = soak::number(random, 1, 6);
    const std::vector<Eigen::MatrixXd> demonstrations = randomDemonstrations(random, number, d, count);
    TrainingOptions options;
    options.states = soak::number(random, 1, 15);
    options.components = random.uniform() < 0.25 ? soak::number(random, 2, 3) : 1;
    options.shrinkage = random.uniform() < 0.5 ? 0.0 : soak::scale(random, -2.0, 1.0);
    options.covariance_floor = soak::scale(random, -8.0, -2.0);
    options.max_iterations = soak::number(random, 1, 20);
    options.tolerance = random.uniform() < 0.5 ? 0.0 : 1e-5;
    const TrainingResult result = train(demonstrations, options);

    const TimeHmmParameters& p = result.model.parameters();
    ASSERT_TRUE(p.mean_s.allFinite() && p.mean_t.allFinite() && p.tt.allFinite() && p.ts.allFinite());
    ASSERT_TRUE(p.transition.allFinite() && p.weights.allFinite() && p.between_tt.allFinite() && p.memory.allFinite());
    for (const Eigen::MatrixXd& covariance : p.ss)
      ASSERT_TRUE(covariance.allFinite() && covariance.llt().info() == Eigen::Success);
    for (int i = 0; i < options.states; ++i)
      for (int j = 0; j < options.states; ++j)
        if (j != i && j != i + 1)
        {
          ASSERT_EQ(p.transition(i, j), 0.0) << i << " to " << j;
        }
        else
        {
          ASSERT_GT(p.transition(i, j), 0.0) << i << " to " << j;
        }
    ASSERT_EQ(p.initial(0), 1.0);
    ASSERT_EQ(p.initial.sum(), 1.0);
    ASSERT_TRUE(std::isfinite(result.model.length()) && result.model.durations().minCoeff() >= 1.0);

    double samples = 0.0;
    for (const Eigen::MatrixXd& x : demonstrations)
    {
      samples += static_cast<double>(x.rows());
      ASSERT_TRUE(std::isfinite(result.model.score(x)));
    }
    const std::vector<double>& trace = result.log_likelihood;
    ASSERT_FALSE(trace.empty());
    const double rounding = samples * kCovarianceRounding / options.covariance_floor;
    for (std::size_t k = 1; k < trace.size(); ++k)
      ASSERT_GE(trace[k], trace[k - 1] - kRounding * std::abs(trace[k]) - rounding) << "iteration " << k;
    expectSorted(result.starved, options.states, "starved");
    expectSorted(result.collapsed, options.states, "collapsed");
    const TimeHmm::Trajectory output = result.model.regress(Eigen::VectorXd::LinSpaced(5, 0.0, result.model.length()));
    ASSERT_TRUE(output.means.allFinite() && output.covariances[2].allFinite());
    count.count(!result.starved.empty() ? "starved" : !result.collapsed.empty() ? "collapsed" : "plain");
    if (result.converged)
      count.count("converged");
  });
  for (const char* met : { "starved", "collapsed", "plain", "converged" })
    tally.expectMoreThan(0.05, met);
}
