// The policy's contract with the tick: holds, fades to passive, never throws, never allocates.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "phri_control/feedback_policy.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;
using phri_core::VectorDof;
using phri_core::VectorState;

namespace
{
constexpr double kT0 = 3.0, kDt = 1e-3;
constexpr int kStages = 200;

/// One degree of freedom; the force at xi = 0 is that of the stage, 1 + 0.01 k [N].
FeedbackPolicy rampPolicy()
{
  std::vector<FeedbackPolicy::Stage> stages;
  for (int k = 0; k < kStages; ++k)
  {
    FeedbackPolicy::Stage stage;
    stage.gain = Eigen::RowVector2d(-100.0, -10.0);
    stage.reference = Eigen::Vector2d(0.01, 0.0);
    stage.feedforward = Eigen::Matrix<double, 1, 1>(0.01 * k);
    stages.push_back(stage);
  }
  return { kT0, kDt, stages, 7 };
}

double force(const FeedbackPolicy& policy, double t, const VectorState& xi = VectorState::Zero(2))
{
  VectorDof u;
  policy.act(t, xi, u);
  return u(0);
}
}  // namespace

TEST(FeedbackPolicy, isTheAffineLawOfTheStageThatHolds)
{
  const FeedbackPolicy policy = rampPolicy();
  const VectorState xi = Eigen::Vector2d(0.03, 0.2);
  for (int k = 0; k < kStages; ++k)
    for (const double within : { 0.0, 0.5e-3, 0.999e-3 })  // zero-order hold, t0 + k dt belongs to stage k
      EXPECT_DOUBLE_EQ(force(policy, kT0 + k * kDt + within, xi), -100.0 * 0.02 - 10.0 * 0.2 + 0.01 * k);
  EXPECT_DOUBLE_EQ(force(policy, kT0 - 1.0), 1.0);
  EXPECT_EQ(policy.source(), 7);
}

// Valid to the horizon's end, then cross-faded to passive in 0.2 s by a C1 smoothstep: neither the force nor its
// derivative jumps, and nothing is left after it.
TEST(FeedbackPolicy, fadesToPassiveWithoutAJump)
{
  const FeedbackPolicy policy = rampPolicy();
  const double end = policy.horizonEnd(), last = 1.0 + 0.01 * (kStages - 1);
  EXPECT_DOUBLE_EQ(end, kT0 + kStages * kDt);
  EXPECT_DOUBLE_EQ(force(policy, end), last);
  EXPECT_DOUBLE_EQ(force(policy, end - 0.5 * kDt), last);
  EXPECT_NEAR(force(policy, end + 0.5 * FeedbackPolicy::kFade), 0.5 * last, 1e-12);

  constexpr double kStep = 1e-5;
  const auto slope = [&](double t) { return (force(policy, t + kStep) - force(policy, t - kStep)) / (2.0 * kStep); };
  double steepest = 0.0;
  for (double t = end + kStep; t < end + FeedbackPolicy::kFade + 0.05; t += kDt)
  {
    EXPECT_LT(std::abs(force(policy, t + kDt) - force(policy, t)), 1.6 * last * kDt / FeedbackPolicy::kFade);
    // |weight''| <= 6 / fade^2 bounds how much the slope changes in a tick
    EXPECT_LT(std::abs(slope(t + kDt) - slope(t)), 1.01 * 6.0 * last * kDt / std::pow(FeedbackPolicy::kFade, 2));
    steepest = std::max(steepest, std::abs(slope(t)));
  }
  EXPECT_NEAR(steepest, 1.5 * last / FeedbackPolicy::kFade, 1e-3 * steepest);  // of 3x^2 - 2x^3, in its middle
  EXPECT_LT(std::abs(slope(end + 2.0 * kStep)), 0.01 * steepest);
  EXPECT_LT(std::abs(slope(end + FeedbackPolicy::kFade - 2.0 * kStep)), 0.01 * steepest);

  EXPECT_FALSE(policy.expired(end + FeedbackPolicy::kFade - kDt));
  for (const double after : { 1e-9, 0.1, 1e6 })
  {
    EXPECT_TRUE(policy.expired(end + FeedbackPolicy::kFade + after));
    EXPECT_EQ(force(policy, end + FeedbackPolicy::kFade + after), 0.0);
  }
}

// While it fades it still is a feedback law, of the last gain.
TEST(FeedbackPolicy, holdsTheLastGainWhileFading)
{
  const FeedbackPolicy policy = rampPolicy();
  const double t = policy.horizonEnd() + 0.08;
  const double difference = force(policy, t, Eigen::Vector2d(0.05, 0.0)) - force(policy, t);
  EXPECT_NEAR(difference, policy.weight(t) * -100.0 * 0.05, 1e-12);
}

TEST(FeedbackPolicy, givesZeroForWhatItCannotUse)
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  VectorDof u = VectorDof::Ones(1);
  EXPECT_FALSE(rampPolicy().act(kT0, Eigen::Vector2d(nan, 0.0), u));
  EXPECT_EQ(u, VectorDof::Zero(1));
  EXPECT_FALSE(rampPolicy().act(nan, Eigen::Vector2d::Zero(), u));
  EXPECT_EQ(u, VectorDof::Zero(1));
  EXPECT_FALSE(rampPolicy().act(kT0, Eigen::Vector4d::Ones(), u));
  EXPECT_EQ(u, VectorDof::Zero(2));
  EXPECT_FALSE(FeedbackPolicy().act(0.0, Eigen::Vector4d::Ones(), u));
  EXPECT_EQ(u, VectorDof::Zero(2));
  EXPECT_TRUE(FeedbackPolicy().expired(0.0));
}

TEST(FeedbackPolicy, refusesBadStages)
{
  std::vector<FeedbackPolicy::Stage> stages = rampPolicy().stages();
  EXPECT_THROW(FeedbackPolicy(0.0, 0.0, stages), std::invalid_argument);
  EXPECT_THROW(FeedbackPolicy(0.0, kDt, {}), std::invalid_argument);
  EXPECT_THROW(FeedbackPolicy(std::numeric_limits<double>::infinity(), kDt, stages), std::invalid_argument);
  stages[4].reference = Eigen::Vector4d::Zero();
  EXPECT_THROW(FeedbackPolicy(0.0, kDt, stages), std::invalid_argument);
  stages = rampPolicy().stages();
  stages[4].gain(0, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(FeedbackPolicy(0.0, kDt, stages), std::invalid_argument);
}

TEST(FeedbackPolicy, actsWithoutAllocation)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations are not counted under AddressSanitizer";
  for (const Eigen::Index dof : { 1, 2, 6 })
  {
    const FeedbackPolicy::Stage stage{ MatrixGain::Ones(dof, 2 * dof), VectorState::Ones(2 * dof),
                                       VectorDof::Ones(dof) };
    const FeedbackPolicy policy(0.0, kDt, std::vector<FeedbackPolicy::Stage>(50, stage));
    const VectorState xi = VectorState::Zero(2 * dof);
    EXPECT_EQ(phri_core::testing::countAllocations([&] {
                VectorDof u;
                for (double t = -0.01; t < 0.3; t += kDt)
                  policy.act(t, xi, u);
              }),
              0);
  }
}
