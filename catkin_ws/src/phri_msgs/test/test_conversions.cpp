#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "phri_core/random.hpp"
#include "phri_msgs/conversions.hpp"

namespace
{
phri_core::Gaussian gaussian(phri_core::Random& random, int size)
{
  phri_core::Gaussian g{ Eigen::VectorXd(size), Eigen::MatrixXd(size, size) };
  for (int i = 0; i < size; ++i)
  {
    g.mean(i) = random.normal();
    for (int j = 0; j < size; ++j)
      g.covariance(i, j) = random.normal();  // not symmetric: a transposed matrix must not pass unnoticed
  }
  return g;
}

phri_core::Prediction prediction(bool with_wrench)
{
  phri_core::Random random(5);
  phri_core::Prediction p;
  p.t0 = 0.1 + 0.2;  // not representable exactly: 0.30000000000000004
  p.dt = 0.02;
  p.model = "time_hmm";
  for (int k = 0; k < 11; ++k)
  {
    p.desired_state.push_back(gaussian(random, 4));
    if (with_wrench)
      p.human_wrench.push_back(gaussian(random, 2));
  }
  return p;
}

void expectEqual(const std::vector<phri_core::Gaussian>& a, const std::vector<phri_core::Gaussian>& b)
{
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t k = 0; k < a.size(); ++k)
  {
    EXPECT_EQ(a[k].mean, b[k].mean) << k;
    EXPECT_EQ(a[k].covariance, b[k].covariance) << k;
  }
}
}  // namespace

// Lockstep over topics gives the same numbers as in process only if a message changes no bit.
TEST(Conversions, PredictionCrossesBitForBit)
{
  for (const bool with_wrench : { true, false })
  {
    const phri_core::Prediction before = prediction(with_wrench);
    const auto after = phri_msgs::fromMessage(phri_msgs::toMessage(before));
    ASSERT_TRUE(after);
    EXPECT_EQ(after->t0, before.t0);
    EXPECT_EQ(after->dt, before.dt);
    EXPECT_EQ(after->model, before.model);
    expectEqual(after->desired_state, before.desired_state);
    expectEqual(after->human_wrench, before.human_wrench);
  }
}

TEST(Conversions, CovarianceIsRowMajor)
{
  phri_core::Prediction p;
  phri_core::Gaussian g{ Eigen::Vector2d(1, 2), Eigen::MatrixXd(2, 2) };
  g.covariance << 1, 2, 3, 4;
  p.desired_state = { g };
  EXPECT_EQ(phri_msgs::toMessage(p).covariance, (std::vector<double>{ 1, 2, 3, 4 }));
}

TEST(Conversions, ObservationCrossesBitForBit)
{
  phri_core::Observation before;
  before.t = 12.34;
  before.state = Eigen::Vector4d(0.1, -0.2, std::numeric_limits<double>::denorm_min(), -0.0);
  before.human_wrench = Eigen::Vector2d(1.0 / 3.0, 7.0);
  before.environment_wrench = Eigen::Vector2d(-1e300, 0.0);
  const phri_core::Observation after = phri_msgs::fromMessage(phri_msgs::toMessage(before));
  EXPECT_EQ(after.t, before.t);
  EXPECT_EQ(after.state, before.state);
  EXPECT_TRUE(std::signbit(after.state(3)));
  EXPECT_EQ(after.human_wrench, before.human_wrench);
  EXPECT_EQ(after.environment_wrench, before.environment_wrench);
}

TEST(Conversions, NoElementMeansThatTheModelCannotTell)
{
  EXPECT_FALSE(phri_msgs::fromMessage(phri_msgs::Prediction()));
}

TEST(Conversions, WrongLengthsAreRefusedByName)
{
  const auto refusal = [](auto&& message) -> std::string {
    try
    {
      phri_msgs::fromMessage(message);
    }
    catch (const std::invalid_argument& error)
    {
      return error.what();
    }
    return "accepted";
  };
  phri_msgs::Prediction message = phri_msgs::toMessage(prediction(true));
  message.covariance.pop_back();
  EXPECT_NE(refusal(message).find("175 covariances: expected K x 4 and K x 4^2"), std::string::npos)
      << refusal(message);
  message = phri_msgs::toMessage(prediction(true));
  message.wrench_mean.resize(2);
  message.wrench_covariance.resize(4);
  EXPECT_NE(refusal(message).find("wrench_mean speaks of 1 times"), std::string::npos) << refusal(message);
  message = phri_msgs::toMessage(prediction(false));
  message.state_size = 0;
  EXPECT_NE(refusal(message).find("44 means"), std::string::npos) << refusal(message);
  phri_msgs::Observation observation;
  observation.state.resize(13);
  EXPECT_NE(refusal(observation).find("state has 13 elements"), std::string::npos) << refusal(observation);
}
