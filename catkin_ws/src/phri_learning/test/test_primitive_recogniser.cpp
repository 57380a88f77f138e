// Theorems of the recogniser: its likelihoods against brute force and against the thesis' definition, its decisions.
#include "phri_learning/primitive_recogniser.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "fixtures.hpp"
#include "phri_core/testing.hpp"
#include "phri_learning/hmm_training.hpp"

namespace phri_learning
{
namespace
{
constexpr double kRounding = 1e-9;  // relative, of sums of some hundred logarithms
constexpr double kNoFloor = 1e9;    // outlier, in nat per dimension: no increment is that low

std::shared_ptr<const TimeHmm> randomHmm(std::uint64_t seed, int states = 5, int components = 2, int d = 3)
{
  return std::make_shared<const TimeHmm>(testing::randomModel(seed, states, components, d));
}

RecogniserOptions unlimited(int window, double leak)
{
  RecogniserOptions o;
  o.window = window;
  o.leak = leak;
  o.least = 1;
  o.outlier = kNoFloor;
  return o;
}

/// log P(x) by the dense transition matrix (1 - leak) A + leak / S, started anywhere, in logarithms throughout.
double denseLikelihood(const TimeHmm& hmm, const Eigen::MatrixXd& x, double leak)
{
  const int states = hmm.states();
  if (x.rows() == 0)
    return 0.0;
  const Eigen::MatrixXd components = hmm.logComponents(x);
  const auto emission = [&](int state, Eigen::Index t) {
    double sum = -std::numeric_limits<double>::infinity();
    for (int k = 0; k < hmm.components(); ++k)
      sum = logAdd(sum, components(state * hmm.components() + k, t));
    return sum;
  };
  std::vector<double> path(static_cast<std::size_t>(states));
  for (int i = 0; i < states; ++i)
    path[static_cast<std::size_t>(i)] = emission(i, 0) - std::log(states);
  for (Eigen::Index t = 1; t < x.rows(); ++t)
  {
    std::vector<double> next(path.size());
    for (int j = 0; j < states; ++j)
    {
      double sum = -std::numeric_limits<double>::infinity();
      for (int i = 0; i < states; ++i)
      {
        const double a = (1.0 - leak) * hmm.parameters().transition(i, j) + leak / states;
        if (a > 0.0)
          sum = logAdd(sum, path[static_cast<std::size_t>(i)] + std::log(a));
      }
      next[static_cast<std::size_t>(j)] = sum + emission(j, t);
    }
    path = next;
  }
  double total = -std::numeric_limits<double>::infinity();
  for (const double p : path)
    total = logAdd(total, p);
  return total;
}

TEST(PrimitiveRecogniser, windowIsTheDifferenceOfTwoDenseLikelihoods)
{
  // log P(last W | all before) = log P(all) - log P(all but the last W)
  constexpr int kWindow = 7;
  constexpr double kLeak = 0.03;
  const std::vector<RecognisedModel> models{ { randomHmm(1), 0.0 }, { randomHmm(2, 8, 1), 0.0 } };
  PrimitiveRecogniser recogniser(models, unlimited(kWindow, kLeak));
  const Eigen::MatrixXd x = testing::randomSamples(3, 40, 3, 1.0) * 0.2;
  for (Eigen::Index t = 0; t < x.rows(); ++t)
  {
    const auto& entries = recogniser.filter(x.row(t).transpose());
    const Eigen::Index old = std::max<Eigen::Index>(0, t + 1 - kWindow);
    for (std::size_t i = 0; i < models.size(); ++i)
    {
      const double expected = denseLikelihood(*models[i].hmm, x.topRows(t + 1), kLeak) -
                              denseLikelihood(*models[i].hmm, x.topRows(old), kLeak);
      EXPECT_NEAR(entries[i].log_likelihood, expected, kRounding * std::max(1.0, std::abs(expected))) << t;
    }
  }
}

TEST(PrimitiveRecogniser, isTheThesisLikelihoodUntilTheWindowIsFullIfNothingLeaks)
{
  const auto hmm = randomHmm(4, 6, 1);
  PrimitiveRecogniser recogniser({ { hmm, 0.0 } }, unlimited(30, 0.0));
  const Eigen::MatrixXd x = testing::randomSamples(5, 30, 3, 1.0) * 0.2;
  for (Eigen::Index t = 0; t < x.rows(); ++t)
  {
    const double score = hmm->score(x.topRows(t + 1), Start::kAnywhere);
    EXPECT_NEAR(recogniser.filter(x.row(t).transpose())[0].log_likelihood, score, kRounding * std::abs(score));
  }
}

struct Learned
{
  Eigen::MatrixXd example;
  RecognisedModel model;
};

/// A movement [p; v], moved by (x, y) [m].
Learned learned(std::uint64_t seed, double x, double y)
{
  std::vector<Eigen::MatrixXd> examples = testing::movements(seed, 5);
  for (Eigen::MatrixXd& example : examples)
  {
    example.col(0).array() += x;
    example.col(1).array() += y;
  }
  TrainingOptions o;
  o.dt = testing::kDt;
  const auto hmm = std::make_shared<const TimeHmm>(train(examples, o).model);
  return { examples[0], { hmm, typicalIncrement(*hmm, examples, RecogniserOptions().leak) } };
}

TEST(PrimitiveRecogniser, progressRisesAlongAMovementAndTypicalIsWhatItScores)
{
  const Learned a = learned(1, 0.0, 0.0);
  EXPECT_NEAR(typicalIncrement(*a.model.hmm, { a.example }, 0.01),
              denseLikelihood(*a.model.hmm, a.example, 0.01) / static_cast<double>(a.example.rows()), kRounding * 1e2);
  PrimitiveRecogniser recogniser({ a.model });
  std::vector<double> progress;
  for (Eigen::Index t = 0; t < a.example.rows(); ++t)
    progress.push_back(recogniser.filter(a.example.row(t).transpose())[0].progress);
  EXPECT_LT(progress[10], 0.2);
  EXPECT_GT(progress.back(), 0.85);
  for (std::size_t t = 20; t < progress.size(); ++t)  // left to right, apart from the leak
    EXPECT_GT(progress[t], progress[t - 10] - 0.02);
  EXPECT_EQ(recogniser.entries()[0].state, a.model.hmm->states() - 1);
}

TEST(PrimitiveRecogniser, winnerChangesOnceAndExactlyAfterConfirmation)
{
  // the same movement 8 mm aside: near enough for both models to stay known
  const Learned a = learned(1, 0.0, 0.0), b = learned(1, 0.008, 0.0);
  RecogniserOptions o;
  o.confirm = 4;
  PrimitiveRecogniser recogniser({ a.model, b.model }, o);
  for (Eigen::Index t = 0; t < 60; ++t)
    recogniser.filter(a.example.row(t).transpose());
  ASSERT_EQ(recogniser.winner(), 0);
  int likelier = 0;
  for (Eigen::Index t = 60; t < 120; ++t)
  {
    const auto& e = recogniser.filter(b.example.row(t).transpose());
    likelier += e[1].log_likelihood > e[0].log_likelihood;
    if (likelier > 0)
    {
      ASSERT_GT(e[1].log_likelihood, e[0].log_likelihood) << "likelier for good, or the count says nothing";
    }
    EXPECT_EQ(recogniser.winner(), likelier >= o.confirm ? 1 : 0) << t;
  }
  EXPECT_GT(likelier, o.confirm);
}

TEST(PrimitiveRecogniser, whatIsLikeNothingLearnedIsNotKnownAndWhatComesBackIs)
{
  const Learned a = learned(1, 0.0, 0.0);
  PrimitiveRecogniser recogniser({ a.model });
  for (Eigen::Index t = 0; t < 60; ++t)
    recogniser.filter(a.example.row(t).transpose());
  EXPECT_EQ(recogniser.winner(), 0);
  int unknown_after = 0;
  for (Eigen::Index t = 60; t < 100; ++t)  // the same places, the other way round
  {
    Eigen::VectorXd backwards = a.example.row(120 - t).transpose();
    backwards.tail(2) *= -1.0;
    recogniser.filter(backwards);
    unknown_after += recogniser.winner() >= 0;
  }
  EXPECT_EQ(recogniser.winner(), -1);
  EXPECT_LE(unknown_after, RecogniserOptions().window);
  // an increment costs at most `outlier`: after a window without outliers nothing is left of them
  for (Eigen::Index t = 60; t < 60 + RecogniserOptions().window; ++t)
    recogniser.filter(a.example.row(t).transpose());
  EXPECT_EQ(recogniser.winner(), 0);
}

TEST(PrimitiveRecogniser, aSingleOutlierDoesNotEndRecognition)
{
  const Learned a = learned(1, 0.0, 0.0);
  PrimitiveRecogniser recogniser({ a.model });
  for (Eigen::Index t = 0; t < 100; ++t)
  {
    Eigen::VectorXd x = a.example.row(t).transpose();
    if (t == 50)
      x.array() += 100.0;
    const double before = recogniser.samples() > 0 ? recogniser.entries()[0].log_likelihood : 0.0;
    recogniser.filter(x);
    if (t == 50)
    {
      EXPECT_LT(recogniser.entries()[0].log_likelihood, before - 10.0);
    }
    if (t >= RecogniserOptions().least)
    {
      EXPECT_EQ(recogniser.winner(), 0) << t;
    }
  }
}

TEST(PrimitiveRecogniser, everyExampleBeginsAnewAndEverySampleCountsAlike)
{
  const Learned a = learned(1, 0.0, 0.0);
  const Eigen::MatrixXd first = a.example.topRows(70), second = a.example.bottomRows(40);
  const auto typical = [&](const std::vector<Eigen::MatrixXd>& examples) {
    return typicalIncrement(*a.model.hmm, examples, 0.01);
  };
  const double expected = (70.0 * typical({ first }) + 40.0 * typical({ second })) / 110.0;
  EXPECT_NEAR(typical({ second, first }), expected, kRounding * std::abs(expected));
}

TEST(PrimitiveRecogniser, nothingIsLeftAfterAReset)
{
  const Learned a = learned(1, 0.0, 0.0), b = learned(1, 0.008, 0.0);
  PrimitiveRecogniser used({ a.model, b.model }), fresh({ a.model, b.model });
  for (Eigen::Index t = 0; t < 17; ++t)
    used.filter(b.example.row(t).transpose());
  ASSERT_EQ(used.winner(), 1);
  used.reset();
  EXPECT_EQ(used.winner(), -1);
  for (Eigen::Index t = 60; t < 120; ++t)
  {
    const auto& expected = fresh.filter(a.example.row(t).transpose());
    const auto& found = used.filter(a.example.row(t).transpose());
    for (std::size_t i = 0; i < 2; ++i)
      ASSERT_EQ(found[i].log_likelihood, expected[i].log_likelihood) << t;
    ASSERT_EQ(used.winner(), fresh.winner()) << t;
  }
}

TEST(PrimitiveRecogniser, refusesWhatItCannotUseAndThenStaysAsItWas)
{
  const auto hmm = randomHmm(1);
  EXPECT_THROW(PrimitiveRecogniser({ { nullptr, 0.0 } }), std::invalid_argument);
  EXPECT_THROW(PrimitiveRecogniser({ { hmm, 0.0 }, { randomHmm(1, 5, 2, 2), 0.0 } }), std::invalid_argument);
  EXPECT_THROW(typicalIncrement(*hmm, {}, 0.01), std::invalid_argument);
  for (const auto& spoil : std::vector<void (*)(RecogniserOptions*)>{
           [](RecogniserOptions* o) { o->window = 0; }, [](RecogniserOptions* o) { o->leak = 0.6; },
           [](RecogniserOptions* o) { o->confirm = 0; }, [](RecogniserOptions* o) { o->gate = 0.0; },
           [](RecogniserOptions* o) { o->outlier = o->gate / 2; }, [](RecogniserOptions* o) { o->least = 31; } })
  {
    RecogniserOptions o;
    spoil(&o);
    EXPECT_THROW(checkOptions(o), std::invalid_argument);
  }
  PrimitiveRecogniser one({ { hmm, 0.0 } }, unlimited(10, 0.01)), other({ { hmm, 0.0 } }, unlimited(10, 0.01));
  const Eigen::Vector3d first(0.1, 0.2, 0.3), second(0.2, 0.2, 0.2);
  one.filter(first);
  other.filter(first);
  EXPECT_THROW(one.filter(Eigen::Vector3d(0.0, NAN, 0.0)), std::invalid_argument);
  EXPECT_THROW(one.filter(Eigen::Vector2d(0.0, 0.0)), std::invalid_argument);
  EXPECT_EQ(one.filter(second)[0].log_likelihood, other.filter(second)[0].log_likelihood);
  EXPECT_TRUE(PrimitiveRecogniser({}).filter(second).empty());
}

TEST(PrimitiveRecogniser, allocatesNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP();
  const Learned a = learned(1, 0.0, 0.0), b = learned(2, 0.1, -0.3);
  PrimitiveRecogniser recogniser({ a.model, b.model });
  const Eigen::MatrixXd columns = a.example.transpose();
  EXPECT_EQ(phri_core::testing::countAllocations([&] {
              for (Eigen::Index t = 0; t < 100; ++t)
                recogniser.filter(columns.col(t));
              recogniser.reset();
              recogniser.filter(columns.col(0));
            }),
            0);
}
}  // namespace
}  // namespace phri_learning
