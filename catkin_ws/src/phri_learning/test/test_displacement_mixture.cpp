#include "phri_learning/displacement_mixture.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "fixtures.hpp"
#include "phri_core/testing.hpp"

namespace phri_learning
{
namespace
{
using testing::kDt;
using Demonstrations = std::vector<Eigen::MatrixXd>;

/// Positions (T, 2) only.
Demonstrations places(std::uint64_t seed, int count)
{
  Demonstrations all = testing::movements(seed, count);
  for (Eigen::MatrixXd& x : all)
    x = x.leftCols(2).eval();
  return all;
}

std::shared_ptr<const DisplacementRegression> learned(const Demonstrations& demonstrations, double horizon = 0.3)
{
  DisplacementOptions o;
  o.horizon = horizon;
  return std::make_shared<const DisplacementRegression>(trainDisplacements(demonstrations, o));
}

struct Outcome
{
  double error = 0.0, still = 0.0, straight = 0.0;  // mean errors [m]: forecast, no motion, constant velocity
  double inside = 0.0;                              // share in the 95 % region
};

/// Judges forecasts k samples ahead from sample `from` on.
Outcome judged(const std::shared_ptr<const DisplacementRegression>& model, const Demonstrations& tests, int k,
               Eigen::Index from = 10)
{
  constexpr double kRegion = 5.991;  // 95 % of chi squared with 2 degrees of freedom
  Outcome o;
  double count = 0.0;
  for (const Eigen::MatrixXd& x : tests)
  {
    DisplacementMixture mixture(model);
    phri_core::Gaussian forecast;
    for (Eigen::Index t = 0; t + k < x.rows(); ++t)
    {
      mixture.observe(x.row(t).transpose());
      mixture.forecast(k * kDt, &forecast);
      if (t < from)
        continue;
      const Eigen::Vector2d e = forecast.mean - x.row(t + k).transpose();
      o.error += e.norm();
      o.still += (x.row(t) - x.row(t + k)).norm();
      o.straight += (x.row(t) + k * (x.row(t) - x.row(t - 1)) - x.row(t + k)).norm();
      o.inside += e.dot(forecast.covariance.llt().solve(e)) < kRegion ? 1.0 : 0.0;
      count += 1.0;
    }
  }
  return { o.error / count, o.still / count, o.straight / count, o.inside / count };
}

TEST(DisplacementMixture, predictsStraightMotionOfConstantVelocityExactly)
{
  // the base is a ridge about constant velocity: demonstrations that agree with it leave it as it is, and leave nothing
  // to the local model; so any other line, speed and place is exact too
  constexpr double kExact = 1e-9;  // [m], of 0.3 m travelled
  const auto line = [](double angle, double speed, int samples) {
    Eigen::MatrixXd x(samples, 2);
    for (int t = 0; t < samples; ++t)
      x.row(t) << 0.1 + speed * std::cos(angle) * kDt * t, speed * std::sin(angle) * kDt * t;
    return x;
  };
  const auto model = learned({ line(0.3, 0.2, 100), line(0.4, 0.3, 80), line(0.2, 0.5, 90) });
  const Outcome o = judged(model, { line(2.0, 1.0, 60) }, 15, 1);
  EXPECT_LT(o.error, kExact);
  EXPECT_GT(o.still, 0.2);
}

TEST(DisplacementMixture, demonstrationsWithoutSpreadReproduceThemselves)
{
  // only the ridge keeps it from being exact: at most 2 % of a feature's variance where nothing speaks against less
  const Demonstrations one = places(1, 1);
  const Outcome o = judged(learned({ one[0], one[0], one[0] }), one, 15);
  EXPECT_LT(o.error, 0.15 * o.straight);
  EXPECT_LT(o.error, 0.05 * o.still);
}

TEST(DisplacementMixture, beatsConstantVelocityAndIsHonestOnDemonstrationsItHasNotSeen)
{
  const Outcome o = judged(learned(places(1, 6)), places(2, 20), 15);
  EXPECT_LT(o.error, 0.7 * o.straight);
  EXPECT_GT(o.inside, 0.90);
  EXPECT_LT(o.inside, 0.985);
}

/// What the model assumes: changes of velocity are Gaussian and independent, everywhere the same.
Demonstrations drift(std::uint64_t seed, int count, int samples)
{
  phri_core::Random random(seed);
  Demonstrations all;
  for (int e = 0; e < count; ++e)
  {
    Eigen::MatrixXd x(samples, 2);
    Eigen::RowVector2d p(0.0, 0.0), v(0.002, 0.0);
    for (int t = 0; t < samples; ++t)
    {
      x.row(t) = p += v;
      v(0) += 0.02 * (0.002 - v(0)) + 1e-4 * random.normal();
      v(1) += 0.02 * (0.0 - v(1)) + 1e-4 * random.normal();
    }
    all.push_back(x);
  }
  return all;
}

TEST(DisplacementMixture, regionsHoldTheirShareOnDataOfItsOwnAssumptions)
{
  // one sample ahead errors are independent: 40 * 190 of them, standard error 0.0025. Everything else only widens: the
  // scale, never below 1, whose estimate from a second has a standard deviation of 0.2; 40 / 39 for the number of
  // demonstrations; the spread among states and experts, here all equal but for what they learned. Together the
  // variance grows by a quarter, which a share of 0.976 says; a variance that is double would give 0.9975.
  constexpr double kFourSigma = 0.01, kWidened = 0.026;
  const Outcome o = judged(learned(drift(3, 40, 200), 0.1), drift(4, 40, 200), 1);
  EXPECT_GT(o.inside, 0.95 - kFourSigma);
  EXPECT_LT(o.inside, 0.95 + kFourSigma + kWidened);
}

TEST(DisplacementRegression, covariancesAreThoseOfTheNoiseThatMadeTheData)
{
  // one sample ahead nothing but the last change of velocity is unknown, 1e-4 m per axis; 40 demonstrations widen it by
  // 40 / 39. 15200 numbers: four standard errors are 4.6 %; the local model adds what its own parameters are unsure of.
  constexpr double kVariance = 1e-8 * 40.0 / 39.0, kFourSigma = 0.046, kOwn = 0.1;
  const auto model = learned(drift(3, 40, 200), 0.1);
  double base = 0.0, local = 0.0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(model->states()); ++i)
  {
    base += model->base_covariance[i].trace() / (2.0 * model->states());
    local += model->local_covariance[i].trace() / (2.0 * model->states());
  }
  EXPECT_NEAR(base, kVariance, kFourSigma * kVariance);
  EXPECT_GT(local, (1.0 - kFourSigma) * kVariance);
  EXPECT_LT(local, (1.0 + kFourSigma + kOwn) * kVariance);
}

TEST(DisplacementMixture, weightsSumToOneAndFollowTheExpertThatIsRight)
{
  const auto model = learned(places(1, 6));
  DisplacementMixture mixture(model);
  const Eigen::MatrixXd known = places(2, 1)[0];
  double local = 0.0;
  for (Eigen::Index t = 0; t < known.rows(); ++t)
  {
    mixture.observe(known.row(t).transpose());
    for (const double horizon : { 0.0, 0.02, 0.11, 0.2, 0.3 })
    {
      const auto weight = mixture.weights(horizon);
      ASSERT_NEAR(weight[0] + weight[1], 1.0, 1e-12);
      ASSERT_GE(std::min(weight[0], weight[1]), 0.0);
    }
    local += mixture.weights(0.3)[1] / static_cast<double>(known.rows());
    ASSERT_NEAR(mixture.states().sum(), 1.0, 1e-12);
  }
  EXPECT_GT(local, 0.6);
  // the same place, crossed in a way that nobody demonstrated
  mixture.reset();
  for (int t = 0; t < 100; ++t)
    mixture.observe(Eigen::Vector2d(0.1 - 0.002 * t, -0.1 + 0.002 * t));
  EXPECT_GT(mixture.weights(0.3)[0], 0.9);
}

TEST(DisplacementMixture, aForecastStartsAtThePresentAndGrowsWithoutJumps)
{
  DisplacementMixture mixture(learned(places(1, 6)));
  const Eigen::MatrixXd x = places(2, 1)[0];
  phri_core::Gaussian before, after, middle;
  for (Eigen::Index t = 0; t < 120; ++t)
  {
    mixture.observe(x.row(t).transpose());
    mixture.forecast(0.0, &before);
    ASSERT_EQ(before.mean, x.row(t).transpose());
    const double fastest = 2.0 * 0.02;  // [m] twice what any demonstration moves in a sample
    for (int k = 1; k <= 15; ++k)
    {
      mixture.forecast(k * kDt, &after);
      mixture.forecast((k - 0.5) * kDt, &middle);
      ASSERT_EQ(after.covariance, after.covariance.transpose());
      ASSERT_EQ(after.covariance.llt().info(), Eigen::Success);
      ASSERT_LT((after.mean - before.mean).norm(), fastest);
      ASSERT_LT((middle.mean - 0.5 * (before.mean + after.mean)).norm(), 1e-12);
      before = after;
    }
  }
}

TEST(DisplacementMixture, unitsDoNotMatter)
{
  constexpr double kUnit = 1000.0, kRounding = 1e-6;  // sums of squares and a ridge chosen among equals
  Demonstrations metres = places(1, 4), millimetres = metres;
  for (Eigen::MatrixXd& x : millimetres)
    x *= kUnit;
  const Eigen::MatrixXd x = places(2, 1)[0];
  DisplacementMixture a(learned(metres)), b(learned(millimetres));
  phri_core::Gaussian in_m, in_mm;
  for (Eigen::Index t = 0; t < x.rows(); ++t)
  {
    a.observe(x.row(t).transpose());
    b.observe(kUnit * x.row(t).transpose());
    a.forecast(0.3, &in_m);
    b.forecast(0.3, &in_mm);
    ASSERT_LT((kUnit * in_m.mean - in_mm.mean).norm(), kRounding * kUnit);
    ASSERT_LT((kUnit * kUnit * in_m.covariance - in_mm.covariance).norm(), kRounding * in_mm.covariance.norm());
  }
}

TEST(DisplacementMixture, followsWithoutAllocating)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "AddressSanitizer replaces malloc";
  DisplacementMixture mixture(learned(testing::movements(1, 4)));  // with velocity as companion
  const Eigen::MatrixXd x = testing::movements(2, 1)[0];
  Eigen::VectorXd sample = x.row(0).transpose();
  phri_core::Gaussian forecast;
  mixture.observe(sample);
  mixture.forecast(0.3, &forecast);
  for (Eigen::Index t = 1; t < 60; ++t)
  {
    sample = x.row(t).transpose();
    EXPECT_EQ(phri_core::testing::countAllocations([&] {
                mixture.observe(sample);
                for (int k = 0; k <= 15; ++k)
                  mixture.forecast(k * kDt, &forecast);
                mixture.forecast(0.111, &forecast);
              }),
              0);
  }
}

TEST(DisplacementMixture, oneDemonstrationIsEnoughAndStarvedStatesDoNoHarm)
{
  DisplacementOptions o;
  o.states = 60;
  const Demonstrations one = places(1, 1);
  const auto model = std::make_shared<const DisplacementRegression>(trainDisplacements(one, o));
  const Outcome o1 = judged(model, places(2, 4), 15);
  EXPECT_LT(o1.error, o1.straight);
}

TEST(DisplacementMixture, refusesWhatDoesNotFit)
{
  DisplacementOptions o;
  EXPECT_THROW(trainDisplacements({}, o), std::invalid_argument);
  EXPECT_THROW(trainDisplacements({ Eigen::MatrixXd::Zero(100, 3) }, o), std::invalid_argument);
  EXPECT_THROW(trainDisplacements({ Eigen::MatrixXd::Zero(10, 2) }, o), std::invalid_argument);
  EXPECT_THROW(trainDisplacements({ Eigen::MatrixXd::Constant(100, 2, std::nan("")) }, o), std::invalid_argument);
  o.horizon = 0.0;
  EXPECT_THROW(trainDisplacements(places(1, 2), o), std::invalid_argument);
  EXPECT_THROW(DisplacementMixture(nullptr), std::invalid_argument);
  EXPECT_THROW(DisplacementModel(learned(places(1, 2))), std::invalid_argument);
  DisplacementMixture mixture(learned(places(1, 2)));
  phri_core::Gaussian forecast;
  EXPECT_THROW(mixture.forecast(0.1, &forecast), std::invalid_argument);
  EXPECT_THROW(mixture.observe(Eigen::Vector2d(0.0, std::nan(""))), std::invalid_argument);
  EXPECT_FALSE(mixture.started());
  mixture.observe(Eigen::Vector2d(0.0, 0.0));
  EXPECT_THROW(mixture.forecast(0.4, &forecast), std::invalid_argument);
}

TEST(DisplacementModel, predictsMotionAndWrenchAndResets)
{
  // u = 200 xdot in all demonstrations: the predicted wrench must stay close to what belongs to the predicted velocity
  Demonstrations demonstrations;
  for (const Eigen::MatrixXd& x : testing::movements(1, 5))
  {
    demonstrations.emplace_back(x.rows(), 6);
    demonstrations.back() << x, 200.0 * x.rightCols(2);
  }
  DisplacementModel model(learned(demonstrations));
  EXPECT_FALSE(model.predict(0.3, kDt).has_value());
  const Eigen::MatrixXd x = testing::movements(2, 1)[0];
  const auto run = [&] {
    std::optional<phri_core::Prediction> prediction;
    for (Eigen::Index t = 0; t < 80; ++t)
    {
      phri_core::Observation o;
      o.t = static_cast<double>(t) * kDt;
      o.state = x.row(t).transpose();
      o.human_wrench = 200.0 * o.state.tail(2);
      model.observe(o);
      prediction = model.predict(0.3, kDt);
      EXPECT_EQ(prediction->t0, o.t);
    }
    return *prediction;
  };
  const phri_core::Prediction first = run();
  ASSERT_EQ(first.desired_state.size(), 16u);
  ASSERT_EQ(first.human_wrench.size(), 16u);
  EXPECT_EQ(first.desired_state[0].mean, x.row(79).transpose());
  for (std::size_t k = 0; k < 16; ++k)
  {
    EXPECT_EQ(first.desired_state[k].covariance.llt().info(), Eigen::Success);
    EXPECT_EQ(first.human_wrench[k].covariance.llt().info(), Eigen::Success);
    EXPECT_LT((first.human_wrench[k].mean - 200.0 * first.desired_state[k].mean.tail(2)).norm(),
              1e-6 * 200.0 * first.desired_state[k].mean.tail(2).norm());
  }
  model.reset();
  EXPECT_FALSE(model.predict(0.3, kDt).has_value());
  EXPECT_EQ(run().desired_state[15].mean, first.desired_state[15].mean);
  EXPECT_THROW(model.predict(0.5, kDt), std::invalid_argument);
}
}  // namespace
}  // namespace phri_learning
