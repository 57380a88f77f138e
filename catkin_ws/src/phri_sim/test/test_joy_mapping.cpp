#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "../ros/joy_mapping.hpp"

using namespace phri_sim;
using Eigen::Vector2d;

namespace
{
constexpr double kSpeed = 0.2;      // [m/s]
constexpr double kRounding = 1e-7;  // axes are floats
}  // namespace

TEST(JoyMapping, SignsAreThoseOfTheMaze)
{
  // Joy: +1 is left and forward; maze: +x is right, +y is forward
  EXPECT_LT((stickVelocity({ -1.0f, 0.0f }, kSpeed) - Vector2d(kSpeed, 0)).norm(), kRounding) << "stick right";
  EXPECT_LT((stickVelocity({ 1.0f, 0.0f }, kSpeed) - Vector2d(-kSpeed, 0)).norm(), kRounding) << "stick left";
  EXPECT_LT((stickVelocity({ 0.0f, 1.0f }, kSpeed) - Vector2d(0, kSpeed)).norm(), kRounding) << "stick forward";
  EXPECT_LT((stickVelocity({ 0.0f, -1.0f }, kSpeed) - Vector2d(0, -kSpeed)).norm(), kRounding) << "stick back";
}

TEST(JoyMapping, NoStepAtTheDeadZoneAndNoMoreThanTheSpeed)
{
  const float edge = float(kStickDeadZone);
  EXPECT_EQ(stickVelocity({ 0.0f, 0.99f * edge }, kSpeed), Vector2d(0, 0));
  const double just_outside = stickVelocity({ 0.0f, 1.01f * edge }, kSpeed).norm();
  EXPECT_GT(just_outside, 0.0);
  EXPECT_LT(just_outside, 0.002 * kSpeed);
  // the corner of a square gate, and a device that overshoots
  EXPECT_NEAR(stickVelocity({ 1.0f, 1.0f }, kSpeed).norm(), kSpeed, kRounding);
  EXPECT_NEAR(stickVelocity({ 3.0f, -4.0f }, kSpeed).norm(), kSpeed, kRounding);
}

TEST(JoyMapping, NothingForWhatIsNoStick)
{
  const float nan = std::nanf(""), inf = std::numeric_limits<float>::infinity();
  for (const std::vector<float>& axes : std::vector<std::vector<float>>{ {}, { 1.0f }, { nan, 1.0f }, { 0.0f, inf } })
    EXPECT_EQ(stickVelocity(axes, kSpeed), Vector2d(0, 0));
}

TEST(JoyMapping, AButtonCountsWhenItGoesDown)
{
  EXPECT_TRUE(pressed({ 0, 0 }, { 1, 0 }, 0));
  EXPECT_FALSE(pressed({ 1, 0 }, { 1, 0 }, 0)) << "held";
  EXPECT_FALSE(pressed({ 1, 0 }, { 0, 0 }, 0)) << "going up";
  EXPECT_TRUE(pressed({}, { 0, 1 }, 1)) << "in the first message";
  EXPECT_FALSE(pressed({}, { 1 }, 1)) << "a device with one button";
}
