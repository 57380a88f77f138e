#include "phri_learning/hmm_training.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "fixtures.hpp"
#include "phri_learning/hmm_expectation.hpp"

namespace phri_learning
{
namespace
{
using testing::kDt;
using testing::movements;

TrainingOptions options(int states, double shrinkage = 1.0, int components = 1)
{
  TrainingOptions o;
  o.states = states;
  o.components = components;
  o.dt = kDt;
  o.shrinkage = shrinkage;
  o.max_iterations = 30;
  o.tolerance = 0.0;
  return o;
}

void expectFinite(const TimeHmm& model)
{
  const TimeHmmParameters& p = model.parameters();  // positive definite and normalised: TimeHmm refuses otherwise
  EXPECT_TRUE(p.mean_s.allFinite() && p.tt.allFinite() && p.ts.allFinite() && p.memory.allFinite());
  EXPECT_TRUE(std::isfinite(p.pace_variance) && std::isfinite(model.length()));
}

TEST(Training, expectationEqualsTheSumOverAllPaths)
{
  // oracle: responsibilities by enumeration of every path of a 3-state model over 5 samples
  const TimeHmm model(testing::randomModel(6, 3, 1, 2));
  const TimeHmmParameters& p = model.parameters();
  const Eigen::MatrixXd x = testing::randomSamples(7, 5, 2);
  const Expectation sums = expectation(model, { x });
  const Eigen::MatrixXd emission = model.logComponents(x);
  double total = 0.0;
  Eigen::VectorXd n = Eigen::VectorXd::Zero(3), stay = n, next = n, t_sum = n;
  Eigen::MatrixXd x_sum = Eigen::MatrixXd::Zero(3, 2);
  for (int code = 0; code < 243; ++code)
  {
    int path[5];
    double weight = 1.0;
    for (int t = 0, rest = code; t < 5; ++t, rest /= 3)
    {
      path[t] = rest % 3;
      weight *= (t == 0 ? p.initial(path[0]) : p.transition(path[t - 1], path[t])) * std::exp(emission(path[t], t));
    }
    total += weight;
    for (int t = 0; t < 5; ++t)
    {
      n(path[t]) += weight;
      t_sum(path[t]) += weight * t * kDt;
      x_sum.row(path[t]) += weight * x.row(t);
      if (t < 4)
        (path[t + 1] == path[t] ? stay : next)(path[t]) += weight;
    }
  }
  constexpr double kRounding = 1e-10;
  EXPECT_NEAR(sums.log_likelihood, std::log(total), kRounding);
  EXPECT_LT((sums.n - n / total).cwiseAbs().maxCoeff(), kRounding);
  EXPECT_LT((sums.t - t_sum / total).cwiseAbs().maxCoeff(), kRounding);
  EXPECT_LT((sums.x - x_sum / total).cwiseAbs().maxCoeff(), kRounding);
  EXPECT_LT((sums.stay - stay / total).cwiseAbs().maxCoeff(), kRounding);
  EXPECT_LT((sums.next - next / total).cwiseAbs().maxCoeff(), kRounding);
}

/// Largest difference of two E-steps' sums, relative to the largest sum of their kind.
double difference(const Expectation& a, const Expectation& b)
{
  double worst = std::abs(a.log_likelihood - b.log_likelihood) / std::abs(b.log_likelihood);
  const auto compare = [&worst](const Eigen::MatrixXd& x, const Eigen::MatrixXd& y) {
    worst = std::max(worst, (x - y).cwiseAbs().maxCoeff() / std::max(1.0, y.cwiseAbs().maxCoeff()));
  };
  compare(a.stay, b.stay);
  compare(a.next, b.next);
  compare(a.start, b.start);
  compare(a.n, b.n);
  compare(a.t, b.t);
  compare(a.within_tt, b.within_tt);
  compare(a.demo_tt, b.demo_tt);
  compare(a.x, b.x);
  compare(a.within_tx, b.within_tx);
  for (std::size_t c = 0; c < a.xx.size(); ++c)
    compare(a.xx[c], b.xx[c]);
  return worst;
}

TEST(Training, scaledProbabilitiesEqualLogarithms)
{
  constexpr double kRounding = 1e-9;
  const auto demonstrations = movements(9, 4);
  for (const int states : { 1, 2, 10, 40 })
    for (int components = 1; components <= 2; ++components)
    {
      const TimeHmm model = train(demonstrations, options(states, 0.0, components)).model;
      const Expectation scaled = expectation(model, demonstrations),
                        logarithms = expectation(model, demonstrations, Numerics::kLogarithms);
      EXPECT_LT(difference(scaled, logarithms), kRounding);
      // every demonstration starts in state 0: exactly, or a later iteration could make something of the rest
      EXPECT_TRUE((scaled.start.tail(states - 1).array() == 0.0).all());
      EXPECT_TRUE((logarithms.start.tail(states - 1).array() == 0.0).all());
    }
}

TEST(Training, pathsThatOneSampleMakesHopelessAreNotLost)
{
  // states at 0 and 1, both possible first; the first sample favours the last state by e^800, which no double can hold
  // beside 1, the two after it the first state by e^650 each: the path through the first state wins by e^500
  TimeHmmParameters p = testing::randomModel(1, 2, 1, 1);
  p.initial << 0.5, 0.5;
  p.mean_s << 0.0, 1.0;
  p.ts.setZero();
  for (Eigen::MatrixXd& ss : p.ss)
    ss << 1.0 / 1300.0;
  const auto favoursLastBy = [](double nat) { return 0.5 + nat / 1300.0; };
  Eigen::MatrixXd x(3, 1);
  x << favoursLastBy(800.0), favoursLastBy(-650.0), favoursLastBy(-650.0);
  const TimeHmm model(p);
  const Expectation sums = expectation(model, { x });
  EXPECT_NEAR(sums.n(0), 3.0, 1e-12);
  EXPECT_NEAR(sums.log_likelihood, model.score(x), 1e-9 * std::abs(sums.log_likelihood));
  EXPECT_LT(difference(sums, expectation(model, { x }, Numerics::kLogarithms)), 1e-12);
}

TEST(Training, reportsCollapsedStates)
{
  // six plateaus without any spread: every state's covariance is at the floor; movements with noise: none is
  Eigen::MatrixXd plateaus(120, 2);
  for (int t = 0; t < 120; ++t)
    plateaus.row(t).setConstant(t / 20);
  const TrainingResult result = train({ plateaus }, options(6, 0.0));
  EXPECT_EQ(result.collapsed, (std::vector<int>{ 0, 1, 2, 3, 4, 5 }));
  expectFinite(result.model);
  phri_core::Random random(10);
  Eigen::MatrixXd noisy = plateaus;
  for (int t = 0; t < 120; ++t)
    noisy.row(t) += Eigen::RowVector2d(0.3 * random.normal(), 0.3 * random.normal());
  EXPECT_TRUE(train({ noisy }, options(6, 0.0)).collapsed.empty());
}

TEST(Training, findsTheModelThatMadeTheData)
{
  // 200 sequences of a known model, whose states last as long as the slices that training starts from (EM finds the
  // optimum nearby): means and transitions within a few standard errors
  TimeHmmParameters p = testing::randomModel(11, 3, 1, 2);
  p.initial = Eigen::Vector3d(1.0, 0.0, 0.0);
  for (int i = 0; i < 3; ++i)
    p.mean_s.row(i) << 10.0 * i, -10.0 * i;
  for (int i = 0; i < 2; ++i)
    p.transition.row(i).segment(i, 2) << 0.9, 0.1;
  const TimeHmm truth(p);
  phri_core::Random random(12);
  std::vector<Eigen::MatrixXd> demonstrations;
  for (int e = 0; e < 200; ++e)
    demonstrations.push_back(sample(truth, 30, &random));
  const TimeHmmParameters found = train(demonstrations, options(3, 0.0)).model.parameters();
  for (int i = 0; i < 3; ++i)
  {
    const double deviation = std::sqrt(p.ss[static_cast<std::size_t>(i)].diagonal().maxCoeff());
    EXPECT_LT((found.mean_s.row(i) - p.mean_s.row(i)).cwiseAbs().maxCoeff(), 4.0 * deviation / std::sqrt(1000.0));
  }
  for (int i = 0; i < 2; ++i)  // at least 1000 samples in each state
    EXPECT_NEAR(found.transition(i, i + 1), p.transition(i, i + 1), 4.0 * 0.3 / std::sqrt(1000.0));
}

TEST(Training, neverDecreasesTheLikelihood)
{
  constexpr double kRounding = 1e-9;  // relative to the log-likelihood of some thousand samples
  const auto demonstrations = movements(1, 5);
  for (const double shrinkage : { 0.0, 1.0 })
    for (int components = 1; components <= 2; ++components)
    {
      const TrainingResult result = train(demonstrations, options(12, shrinkage, components));
      ASSERT_GT(result.log_likelihood.size(), 3u);
      for (std::size_t k = 1; k < result.log_likelihood.size(); ++k)
        EXPECT_GE(result.log_likelihood[k],
                  result.log_likelihood[k - 1] - kRounding * std::abs(result.log_likelihood[k]))
            << "iteration " << k << ", shrinkage " << shrinkage << ", components " << components;
      EXPECT_GT(result.log_likelihood.back(), result.log_likelihood.front());
    }
}

TEST(Training, withoutShrinkageTheTraceIsTheLikelihoodOfTheSpatialModel)
{
  // the first entry belongs to equal time slices, so one state makes it the likelihood of one Gaussian: known in closed
  // form
  const auto demonstrations = movements(2, 3);
  TrainingOptions o = options(1, 0.0);
  const TrainingResult result = train(demonstrations, o);
  double sum = 0.0;
  for (const Eigen::MatrixXd& x : demonstrations)
    sum += result.model.score(x);
  EXPECT_NEAR(result.log_likelihood.back(), sum, 1e-8 * std::abs(sum));
}

TEST(Training, recoversDurationsOfAStaircaseExactly)
{
  // 5 plateaus of 40 samples: states are certain, so time statistics are those of 40 equispaced samples
  phri_core::Random random(3);
  std::vector<Eigen::MatrixXd> demonstrations;
  for (int e = 0; e < 3; ++e)
  {
    Eigen::MatrixXd x(200, 1);
    for (int t = 0; t < 200; ++t)
      x(t, 0) = t / 40 + 0.01 * random.normal();
    demonstrations.push_back(x);
  }
  TrainingOptions o = options(5);
  const TimeHmm corrected = train(demonstrations, o).model;
  o.formulas = Formulas::kThesis;
  const TimeHmm thesis = train(demonstrations, o).model;
  constexpr double kTolerance = 1e-6;  // plateaus are 100 standard deviations apart
  const double v = (40.0 * 40.0 - 1.0) / 12.0;
  for (int i = 0; i < 5; ++i)
  {
    EXPECT_NEAR(corrected.durations()(i), 40.0, kTolerance);
    EXPECT_NEAR(thesis.durations()(i), (-3.0 + std::sqrt(1.0 + 48.0 * v)) / 4.0, kTolerance);
    EXPECT_NEAR(corrected.stateTime(i), kDt * (40.0 * i + 19.5), kTolerance);
  }
  // thesis mode is half a length short by (3.10)
  EXPECT_NEAR(corrected.length(), kDt * (179.5 + 20.0), kTolerance);
  EXPECT_LT(thesis.length(), corrected.length() - kDt * 9.0);
}

TEST(Training, timeStatisticsAreTakenAboutEachDemonstrationsOwnMean)
{
  // the same staircase, delayed by 100 samples on its first plateau: later states happen 100 samples later but last as
  // long
  std::vector<Eigen::MatrixXd> demonstrations;
  phri_core::Random random(4);
  for (const int delay : { 0, 100 })
  {
    Eigen::MatrixXd x(120 + delay, 1);
    for (int t = 0; t < 120 + delay; ++t)
      x(t, 0) = (t < 40 + delay ? 0 : t < 80 + delay ? 1 : 2) + 0.01 * random.normal();
    demonstrations.push_back(x);
  }
  const TimeHmm model = train(demonstrations, options(3)).model;
  EXPECT_NEAR(model.durations()(2), 40.0, 1e-6);
  EXPECT_NEAR(std::sqrt(model.parameters().between_tt(2)), 50.0 * kDt, 1e-6);
}

TEST(Training, isTheSameInEveryUnit)
{
  const auto demonstrations = movements(5, 3);
  auto scaled = demonstrations;
  const Eigen::Vector4d factor(1000.0, 1.0, 1e-3, 1e6);
  for (Eigen::MatrixXd& x : scaled)
    x = x * factor.asDiagonal();
  const TimeHmm a = train(demonstrations, options(10)).model, b = train(scaled, options(10)).model;
  constexpr double kRounding = 1e-8;  // relative; 30 iterations
  const Eigen::MatrixXd back = b.parameters().mean_s * factor.cwiseInverse().asDiagonal();
  EXPECT_LT((back - a.parameters().mean_s).cwiseAbs().maxCoeff(), kRounding);
  EXPECT_LT((b.durations() - a.durations()).cwiseAbs().maxCoeff(), kRounding * 100.0);
  EXPECT_NEAR(b.parameters().pace_variance, a.parameters().pace_variance, kRounding);
}

TEST(Training, survivesDegenerateDemonstrations)
{
  const auto train_on = [](std::vector<Eigen::MatrixXd> x, int states, int components = 1) {
    return train(x, options(states, 1.0, components));
  };
  const auto some = movements(6, 2);
  expectFinite(train_on({ some[0] }, 40).model);                       // one demonstration
  expectFinite(train_on({ some[0], some[0], some[0] }, 20, 3).model);  // duplicates
  expectFinite(train_on({ Eigen::MatrixXd::Constant(50, 3, 7.0) }, 5).model);
  expectFinite(train_on({ Eigen::MatrixXd::Zero(50, 2) }, 5, 2).model);
  expectFinite(train_on({ Eigen::MatrixXd::Ones(1, 2) }, 3).model);  // a single sample
  Eigen::MatrixXd constant = some[0];
  constant.col(1).setConstant(-3.0);
  expectFinite(train_on({ constant }, 10).model);
  expectFinite(train_on({ some[0], some[1].topRows(7) }, 15).model);  // one much shorter than the other
  Eigen::MatrixXd far = some[0];
  far.col(0).array() += 1e9;
  expectFinite(train_on({ far }, 10).model);
}

TEST(Training, reportsStarvedStatesAndKeepsThemInOrder)
{
  // 4 samples cannot visit 10 left-to-right states
  const TrainingResult result = train({ movements(7, 1)[0].topRows(4) }, options(10));
  EXPECT_FALSE(result.starved.empty());
  EXPECT_GE(result.starved.front(), 4);
  EXPECT_EQ(result.starved.back(), 9);
  for (int i = 1; i < 10; ++i)
    EXPECT_GE(result.model.stateTime(i), result.model.stateTime(i - 1));
  EXPECT_TRUE(train(movements(7, 2), options(10)).starved.empty());
}

TEST(Training, whatLastedOneSampleMayLastLonger)
{
  // one sample per state: no demonstration says that a state can be kept, and none that it cannot
  Eigen::MatrixXd quick(6, 1), slow(12, 1);
  for (int t = 0; t < 6; ++t)
    quick(t) = slow(2 * t) = slow(2 * t + 1) = t;
  const TimeHmm model = train({ quick, quick }, options(6, 0.0)).model;
  EXPECT_TRUE(std::isfinite(model.score(slow)));
  EXPECT_LT(model.score(slow), model.score(quick));
  EXPECT_TRUE((model.parameters().transition.diagonal().array() > 0.0).all());
}

TEST(Training, refusesBadInputAndNamesIt)
{
  const auto refusal = [](const std::vector<Eigen::MatrixXd>& x, const TrainingOptions& o) {
    try
    {
      train(x, o);
    }
    catch (const std::invalid_argument& error)
    {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  auto demonstrations = movements(8, 2);
  demonstrations[1](17, 2) = std::nan("");
  EXPECT_NE(refusal(demonstrations, options(5)).find("demonstration 1"), std::string::npos);
  EXPECT_NE(refusal({}, options(5)).find("0 given"), std::string::npos);
  EXPECT_NE(refusal({ Eigen::MatrixXd::Zero(5, 2), Eigen::MatrixXd::Zero(5, 3) }, options(5)).find("(5, 3)"),
            std::string::npos);
  EXPECT_NE(refusal({ Eigen::MatrixXd(0, 2) }, options(5)).find("at least 1"), std::string::npos);
  EXPECT_NE(refusal(movements(8, 1), options(0)).find("states"), std::string::npos);
}
}  // namespace
}  // namespace phri_learning
