#include "phri_learning/hmm_chain.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "fixtures.hpp"
#include "phri_learning/hmm_training.hpp"

namespace phri_learning
{
namespace
{
using testing::kDt;
using testing::randomModel;

constexpr double kRounding = 1e-12;  // of sums of a few numbers of size 1

/// A model of plateaus at first, first + step, .. of `samples` samples each.
TimeHmm staircase(double first, double step, int states, int samples, Formulas formulas = Formulas::kCorrected)
{
  phri_core::Random random(3);
  std::vector<Eigen::MatrixXd> demonstrations;
  for (int e = 0; e < 3; ++e)
  {
    Eigen::MatrixXd x(states * samples, 1);
    for (int t = 0; t < x.rows(); ++t)
      x(t, 0) = first + step * (t / samples) + 0.01 * random.normal();
    demonstrations.push_back(x);
  }
  TrainingOptions o;
  o.states = states;
  o.dt = kDt;
  o.formulas = formulas;
  return train(demonstrations, o).model;
}

TEST(HmmChain, lastStateIsLeftAfterItsDurationAndTimesGoOn)
{
  for (const Formulas formulas : { Formulas::kCorrected, Formulas::kThesis })
  {
    const TimeHmm first = staircase(0.0, 1.0, 3, 20, formulas), second = staircase(3.0, 1.0, 4, 30, formulas);
    const TimeHmm chain = concatenate(first, second);
    ASSERT_EQ(chain.states(), 7);
    // (3.13); a geometric dwell time with this probability has the mean d
    const Eigen::MatrixXd& a = chain.parameters().transition;
    EXPECT_NEAR(1.0 / (1.0 - a(2, 2)), first.durations()(2), 1e-9);
    EXPECT_NEAR(a(2, 2) + a(2, 3), 1.0, kRounding);
    EXPECT_EQ(a(6, 6), 1.0);
    for (int i = 0; i < 4; ++i)
      EXPECT_NEAR(chain.stateTime(3 + i), second.stateTime(i) + first.length(), kRounding);
    EXPECT_NEAR(chain.length(), first.length() + second.length(), kRounding);
    EXPECT_EQ(chain.durations().head(3), first.durations());
    EXPECT_EQ(chain.durations().tail(4), second.durations());
  }
}

TEST(HmmChain, regressionFarFromTheSeamIsThatOfItsParts)
{
  const TimeHmm first = staircase(0.0, 1.0, 3, 20), second = staircase(9.0, -1.0, 4, 30);
  const TimeHmm chain = concatenate(first, second);
  // 20 samples are 3.5 standard deviations of the times of a state: the other side of the seam weighs nothing here
  const Eigen::VectorXd early = Eigen::VectorXd::LinSpaced(9, 0.0, 19 * kDt),
                        late = Eigen::VectorXd::LinSpaced(9, 60 * kDt, 110 * kDt);
  constexpr double kOtherSide = 1e-5;
  const auto near = [&](const Eigen::VectorXd& times, const TimeHmm& part, double shift) {
    const auto a = chain.regress((times.array() + shift).matrix()), b = part.regress(times);
    EXPECT_LT((a.means - b.means).cwiseAbs().maxCoeff(), kOtherSide);
  };
  near(early, first, 0.0);
  near(late, second, first.length());
}

TEST(HmmChain, isAssociative)
{
  const TimeHmm a(randomModel(1, 3, 2, 2)), b(randomModel(2, 2, 2, 2)), c(randomModel(3, 4, 2, 2));
  const TimeHmmParameters left = concatenate(concatenate(a, b), c).parameters(),
                          right = concatenate(a, concatenate(b, c)).parameters();
  EXPECT_LT((left.transition - right.transition).cwiseAbs().maxCoeff(), kRounding);
  EXPECT_LT((left.mean_t - right.mean_t).cwiseAbs().maxCoeff(), kRounding);
  EXPECT_LT((left.between_tt - right.between_tt).cwiseAbs().maxCoeff(), kRounding);
  EXPECT_EQ(left.mean_s, right.mean_s);
  EXPECT_LT((left.memory - right.memory).cwiseAbs().maxCoeff(), kRounding);
}

TEST(HmmChain, variancesBetweenDemonstrationsAdd)
{
  TimeHmmParameters p = randomModel(4, 2, 1, 1), q = randomModel(5, 2, 1, 1);
  p.between_tt << 0.01, 0.04;
  q.between_tt << 0.02, 0.05;
  const Eigen::Vector4d expected(0.01, 0.04, 0.06, 0.09);  // the successor starts when the predecessor ends
  EXPECT_LT((concatenate(TimeHmm(p), TimeHmm(q)).parameters().between_tt - expected).cwiseAbs().maxCoeff(), kRounding);
}

TEST(HmmChain, windowIsPartOfTheChain)
{
  const TimeHmm chain = concatenate(TimeHmm(randomModel(6, 5, 2, 2)), TimeHmm(randomModel(7, 6, 2, 2)));
  struct
  {
    int center, states, first, count;
  } const cases[] = {
    { 5, 5, 3, 5 }, { 5, 4, 4, 4 }, { 0, 5, 0, 5 }, { 10, 5, 6, 5 }, { 3, 20, 0, 11 }, { 4, 1, 4, 1 }
  };
  for (const auto& given : cases)
  {
    const WindowHmm window = windowHmm(chain, given.center, given.states);
    ASSERT_EQ(window.first, given.first);
    ASSERT_EQ(window.model.states(), given.count);
    const TimeHmmParameters &p = window.model.parameters(), &all = chain.parameters();
    EXPECT_EQ(p.mean_s, all.mean_s.middleRows(2 * given.first, 2 * given.count));
    EXPECT_EQ(p.ss.front(), all.ss[static_cast<std::size_t>(2 * given.first)]);
    EXPECT_EQ(p.mean_t, all.mean_t.segment(2 * given.first, 2 * given.count));
    EXPECT_EQ(p.transition(given.count - 1, given.count - 1), 1.0);
    const Eigen::Index inner = given.count - 1;
    EXPECT_EQ(p.transition.topRows(inner),
              all.transition.block(given.first, given.first, given.count, given.count).topRows(inner));
  }
}

TEST(HmmChain, windowFollowsAMovementAcrossTheSeam)
{
  // why the window HMM exists: neither part explains samples from both
  const TimeHmm first = staircase(0.0, 1.0, 3, 20), second = staircase(3.0, 1.0, 4, 20);
  Eigen::MatrixXd x(30, 1);
  for (int t = 0; t < 30; ++t)
    x(t, 0) = t < 15 ? 2.0 : 3.0;
  const WindowHmm window = windowHmm(concatenate(first, second), 2, 4);
  const double across = window.model.score(x, Start::kAnywhere);
  EXPECT_GT(across, first.score(x, Start::kAnywhere) + 100.0);
  EXPECT_GT(across, second.score(x, Start::kAnywhere) + 100.0);
  const std::vector<int> path = window.model.viterbi(x, Start::kAnywhere);
  for (int t = 0; t < 30; ++t)
    EXPECT_EQ(path[static_cast<std::size_t>(t)] + window.first, t < 15 ? 2 : 3);
}

TEST(HmmChain, refusesModelsThatDoNotFitAndNamesWhy)
{
  const TimeHmm model(randomModel(1, 3, 1, 2));
  const auto refusal = [&](const TimeHmm& other) {
    try
    {
      concatenate(model, other);
    }
    catch (const std::invalid_argument& error)
    {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_EQ(refusal(model), "accepted");
  EXPECT_NE(refusal(TimeHmm(randomModel(1, 3, 1, 3))).find("dimension 2 and 3"), std::string::npos);
  EXPECT_NE(refusal(TimeHmm(randomModel(1, 3, 2, 2))).find("components 1 and 2"), std::string::npos);
  EXPECT_NE(refusal(TimeHmm(randomModel(1, 3, 1, 2), Formulas::kThesis)).find("formulas"), std::string::npos);
  TimeHmmParameters slower = randomModel(1, 3, 1, 2);
  slower.dt *= 2.0;
  EXPECT_NE(refusal(TimeHmm(slower)).find("dt"), std::string::npos);
  EXPECT_THROW(windowHmm(model, 3, 2), std::invalid_argument);
  EXPECT_THROW(windowHmm(model, -1, 2), std::invalid_argument);
  EXPECT_THROW(windowHmm(model, 0, 0), std::invalid_argument);
}
}  // namespace
}  // namespace phri_learning
