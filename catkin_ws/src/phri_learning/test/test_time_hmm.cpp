#include "phri_learning/time_hmm.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "fixtures.hpp"

namespace phri_learning
{
namespace
{
using testing::kDt;
using testing::randomModel;
using testing::randomSamples;

constexpr double kRounding = 1e-9;  // relative, of sums over at most some thousand terms

double logNormal(const Eigen::VectorXd& x, const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance)
{
  const Eigen::VectorXd r = x - mean;
  return -0.5 * (r.dot(covariance.inverse() * r) + std::log(covariance.determinant()) +
                 static_cast<double>(x.size()) * std::log(2.0 * M_PI));
}

/// log P(x, path | model) by the definition, for every path of a model small enough to enumerate.
template <typename Visit>
void forEachPath(const TimeHmmParameters& p, const Eigen::MatrixXd& x, Visit visit)
{
  const int states = static_cast<int>(p.transition.rows()), components = static_cast<int>(p.weights.cols());
  const int samples = static_cast<int>(x.rows());
  const int paths = static_cast<int>(std::lround(std::pow(states, samples)));
  for (int code = 0; code < paths; ++code)
  {
    std::vector<int> path(static_cast<std::size_t>(samples));
    double log_p = 0.0;
    for (int t = 0, rest = code; t < samples; ++t, rest /= states)
    {
      const int i = path[static_cast<std::size_t>(t)] = rest % states;
      log_p += std::log(t == 0 ? p.initial(i) : p.transition(path[static_cast<std::size_t>(t - 1)], i));
      double emission = 0.0;
      for (int k = 0; k < components; ++k)
        emission += p.weights(i, k) * std::exp(logNormal(x.row(t), p.mean_s.row(i * components + k),
                                                         p.ss[static_cast<std::size_t>(i * components + k)]));
      log_p += std::log(emission);
    }
    visit(path, log_p);
  }
}

TEST(TimeHmm, likelihoodAndViterbiEqualTheSumAndTheMaximumOverAllPaths)
{
  for (int components = 1; components <= 2; ++components)
    for (std::uint64_t seed = 1; seed <= 20; ++seed)
    {
      const TimeHmmParameters p = randomModel(seed, 3, components, 2);
      const Eigen::MatrixXd x = randomSamples(seed + 100, 6, 2);
      double sum = 0.0, best = -1e300;
      std::vector<int> best_path;
      forEachPath(p, x, [&](const std::vector<int>& path, double log_p) {
        sum += std::exp(log_p);
        if (log_p > best)
        {
          best = log_p;
          best_path = path;
        }
      });
      const TimeHmm model(p);
      EXPECT_NEAR(model.score(x), std::log(sum), kRounding * std::abs(std::log(sum)));
      EXPECT_EQ(model.viterbi(x), best_path);
    }
}

TEST(TimeHmm, durationOfEquispacedSamplesIsExactAndThePrintedFormulaHalvesIt)
{
  // v = (d^2 - 1) / 12 is the variance of d equispaced samples, in samples^2
  for (const double d : { 1.0, 2.0, 7.0, 40.0, 1000.0 })
  {
    TimeHmmParameters p = randomModel(1, 1, 1, 1);
    p.ts.setZero();
    p.tt(0) = std::max(kDt * kDt * (d * d - 1.0) / 12.0, 1e-3 * kDt * kDt);
    const double rounding = 1e-2 / d;  // the smallest time variance stands in for 0
    EXPECT_NEAR(TimeHmm(p).durations()(0), d, rounding);
    // the root of (3.11) is (-3 + sqrt(1 + 48 v)) / 2: d for long states; (3.12) divides by 4
    const double v = p.tt(0) / (kDt * kDt);
    EXPECT_NEAR(TimeHmm(p, Formulas::kThesis).durations()(0), std::max(1.0, (-3.0 + std::sqrt(1.0 + 48.0 * v)) / 4.0),
                1e-9 * d);
  }
  TimeHmmParameters p = randomModel(1, 1, 1, 1);
  p.ts.setZero();
  // (d / 2 + 1)(d + 1) / 6 of (3.11) at d = 40: the printed (3.12) returns the half
  p.tt(0) = kDt * kDt * 21.0 * 41.0 / 6.0;
  EXPECT_NEAR(TimeHmm(p, Formulas::kThesis).durations()(0), 20.0, 1e-9);
}

TEST(TimeHmm, lengthEndsHalfADurationAfterTheLastMeanTime)
{
  const TimeHmmParameters p = randomModel(3, 4, 1, 2);
  const TimeHmm model(p);
  EXPECT_NEAR(model.length(), p.mean_t(3) + kDt * model.durations()(3) / 2.0, 1e-12);
}

TEST(TimeHmm, regressionEqualsTheMomentsOfTheConditionalMixture)
{
  // oracle: the moments of p(x | t) integrated numerically from the joint density, one spatial dimension
  constexpr double kQuadrature = 1e-6;  // the midpoint rule is spectrally accurate for these densities
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
  {
    const TimeHmmParameters p = randomModel(seed, 3, 2, 1);
    const TimeHmm model(p);
    const Eigen::VectorXd times = Eigen::VectorXd::LinSpaced(7, 0.0, 0.6);
    const TimeHmm::Trajectory full = model.regress(times, true), printed = model.regress(times, false);
    for (Eigen::Index n = 0; n < times.size(); ++n)
    {
      double mass = 0.0, first = 0.0, second = 0.0;
      for (double x = -60.0; x < 60.0; x += 0.01)
      {
        double density = 0.0;
        for (int c = 0; c < 6; ++c)
        {
          Eigen::MatrixXd joint(2, 2);
          joint << p.ss[static_cast<std::size_t>(c)](0, 0), p.ts(c, 0), p.ts(c, 0), p.tt(c);
          density += p.weights(c / 2, c % 2) * std::exp(logNormal(Eigen::Vector2d(x, times(n)),
                                                                  Eigen::Vector2d(p.mean_s(c, 0), p.mean_t(c)), joint));
        }
        mass += density;
        first += density * x;
        second += density * x * x;
      }
      const double mean = first / mass, variance = second / mass - mean * mean;
      EXPECT_NEAR(full.means(n, 0), mean, kQuadrature * (1.0 + std::abs(mean)));
      EXPECT_NEAR(full.covariances[static_cast<std::size_t>(n)](0, 0), variance, kQuadrature * (1.0 + variance));
      // what (3.6) leaves out is a variance
      EXPECT_LE(printed.covariances[static_cast<std::size_t>(n)](0, 0), variance + kQuadrature);
      EXPECT_EQ(printed.means(n, 0), full.means(n, 0));
    }
  }
}

TEST(TimeHmm, printedCovarianceIsTheWeightedMeanOfTheConditionalOnes)
{
  const TimeHmmParameters p = randomModel(8, 3, 1, 2);
  const Eigen::VectorXd time = Eigen::VectorXd::Constant(1, 0.17);
  Eigen::VectorXd h(3);
  for (int c = 0; c < 3; ++c)
    h(c) = std::exp(-0.5 * std::pow(time(0) - p.mean_t(c), 2) / p.tt(c)) / std::sqrt(p.tt(c));
  h /= h.sum();
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(2, 2);
  for (int c = 0; c < 3; ++c)
    expected += h(c) * (p.ss[static_cast<std::size_t>(c)] - p.ts.row(c).transpose() * p.ts.row(c) / p.tt(c));
  EXPECT_LT((TimeHmm(p).regress(time, false).covariances[0] - expected).cwiseAbs().maxCoeff(), kRounding);
}

TEST(TimeHmm, uncertainTimeFollowsTheLawOfTotalVariance)
{
  // one state is a straight line in time: Var = Var(x | t) + slope^2 Var(t), exactly
  const TimeHmmParameters p = randomModel(4, 1, 1, 2);
  const TimeHmm model(p);
  TimeHmm::Scratch scratch = model.scratch();
  const double variance = 0.3 * p.tt(0);
  model.regressUncertain(0.02, variance, &scratch);
  const Eigen::VectorXd slope = p.ts.row(0).transpose() / p.tt(0);
  const Eigen::MatrixXd expected =
      p.ss[0] - p.ts.row(0).transpose() * p.ts.row(0) / p.tt(0) + variance * slope * slope.transpose();
  EXPECT_LT((scratch.covariance - expected).cwiseAbs().maxCoeff(), kRounding * expected.cwiseAbs().maxCoeff());
}

TEST(TimeHmm, timeWithinAStateIsTheConditionalExpectation)
{
  const TimeHmmParameters p = randomModel(5, 2, 2, 2);
  const TimeHmm model(p);
  const Eigen::Vector2d x(0.4, 1.1);
  double sum = 0.0, first = 0.0, second = 0.0;
  for (int c = 2; c < 4; ++c)
  {
    const Eigen::MatrixXd& ss = p.ss[static_cast<std::size_t>(c)];
    const double r = p.weights(1, c - 2) * std::exp(logNormal(x, p.mean_s.row(c), ss));
    const Eigen::VectorXd gain = ss.inverse() * p.ts.row(c).transpose();
    const double mean = p.mean_t(c) + gain.dot(x - p.mean_s.row(c).transpose());
    sum += r;
    first += r * mean;
    second += r * (p.tt(c) - p.ts.row(c).dot(gain) + mean * mean);
  }
  double mean = 0.0, variance = 0.0;
  TimeHmm::Scratch scratch = model.scratch();
  model.timeWithin(1, x, &scratch, &mean, &variance);
  EXPECT_NEAR(mean, first / sum, kRounding);
  EXPECT_NEAR(variance, second / sum - std::pow(first / sum, 2), kRounding);
}

TEST(TimeHmm, eigenvalueFloorIsTheRestrictedMaximumOfTheLikelihood)
{
  // f(S) = -log det S - tr(S^-1 C) over S >= floor: no admissible neighbour is better
  phri_core::Random random(2);
  const Eigen::VectorXd scale = Eigen::Vector3d(1.0, 10.0, 0.1);
  Eigen::MatrixXd factor(3, 2);
  for (Eigen::Index i = 0; i < 3; ++i)
    for (Eigen::Index j = 0; j < 2; ++j)
      factor(i, j) = scale(i) * random.normal();
  const Eigen::MatrixXd sample = factor * factor.transpose();  // rank 2: the plain maximum does not exist
  const auto value = [&](const Eigen::MatrixXd& s) {
    return -std::log(s.determinant()) - (s.inverse() * sample).trace();
  };
  const Eigen::MatrixXd best = withEigenvalueFloor(sample, scale, 1e-2);
  for (int trial = 0; trial < 200; ++trial)
  {
    Eigen::MatrixXd change(3, 3);
    for (Eigen::Index i = 0; i < 3; ++i)
      for (Eigen::Index j = 0; j < 3; ++j)
        change(i, j) = 0.02 * scale(i) * scale(j) * random.normal();
    const Eigen::MatrixXd other = withEigenvalueFloor(best + change + change.transpose(), scale, 1e-2);
    EXPECT_LE(value(other), value(best) + kRounding * std::abs(value(best)));
  }
}

TEST(TimeHmm, refusesParametersThatAreNoModelAndNamesThem)
{
  const auto refusal = [](auto change) {
    TimeHmmParameters p = randomModel(1, 3, 1, 2);
    change(&p);
    try
    {
      TimeHmm model(p);
    }
    catch (const std::invalid_argument& error)
    {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  using P = TimeHmmParameters*;
  EXPECT_EQ(refusal([](P) {}), "accepted");
  EXPECT_NE(refusal([](P p) { p->mean_s(1, 0) = std::nan(""); }).find("mean_s"), std::string::npos);
  EXPECT_NE(refusal([](P p) { p->ss[2] *= -1.0; }).find("ss of state 2"), std::string::npos);
  EXPECT_NE(refusal([](P p) { p->ss[1](0, 1) += 1.0; }).find("not symmetric"), std::string::npos);
  EXPECT_NE(refusal([](P p) { p->transition(2, 0) = 0.5, p->transition(2, 2) = 0.5; }).find("left-to-right"),
            std::string::npos);
  EXPECT_NE(refusal([](P p) { p->weights(0, 0) = 0.5; }).find("weights"), std::string::npos);
  EXPECT_NE(refusal([](P p) { p->ts *= 100.0; }).find("joint covariance"), std::string::npos);
  EXPECT_NE(refusal([](P p) { p->tt(0) = -1.0; }).find("tt of state 0"), std::string::npos);
  EXPECT_NE(refusal([](P p) { p->dt = 0.0; }).find("dt"), std::string::npos);
  EXPECT_THROW(TimeHmm(randomModel(1, 3, 1, 2)).score(Eigen::MatrixXd::Zero(5, 3)), std::invalid_argument);
  EXPECT_THROW(TimeHmm(randomModel(1, 3, 1, 2)).viterbi(Eigen::MatrixXd(0, 2)), std::invalid_argument);
}
}  // namespace
}  // namespace phri_learning
