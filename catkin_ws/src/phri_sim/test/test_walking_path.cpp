#include <gtest/gtest.h>

#include <cmath>

#include "phri_sim/walking_path.hpp"

using namespace phri_sim;
using Eigen::Vector2d;

namespace
{
constexpr double kRadius = 0.6;
// [m] Simpson's rule over samples of 5 mm; at a corner's ends the heading's third derivative jumps
constexpr double kIntegration = 1e-8;
const std::vector<Vector2d> kZigzag = { { 0, 0 }, { 3, 0 }, { 3, 3 }, { 7, 4 }, { 4, 6 } };

std::string refusal(const std::vector<Vector2d>& waypoints, double radius)
{
  try
  {
    WalkingPath path(waypoints, radius);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}
}  // namespace

TEST(WalkingPath, BeginsAndEndsAtTheOutermostWaypoints)
{
  const WalkingPath path(kZigzag, kRadius);
  EXPECT_LT((path.at(0.0).position - kZigzag.front()).norm(), 1e-12);
  EXPECT_LT((path.at(path.length()).position - kZigzag.back()).norm(), kIntegration);
  EXPECT_EQ(path.at(-1.0).position, path.at(0.0).position);
  EXPECT_EQ(path.at(path.length() + 1.0).position, path.at(path.length()).position);
}

// Arc length means |dp/ds| = 1; heading and curvature are its first and second derivative.
TEST(WalkingPath, IsParametrisedByArcLengthWithItsOwnDerivatives)
{
  const WalkingPath path(kZigzag, kRadius);
  constexpr double h = 1e-4, kDifference = 1e-5;  // O(h^2) of a central difference, and the cubic's 1e-9 / h
  for (double s = h; s < path.length() - h; s += 0.0137)
  {
    const PathPoint left = path.at(s - h), here = path.at(s), right = path.at(s + h);
    const Vector2d tangent = (right.position - left.position) / (2.0 * h);
    EXPECT_NEAR(tangent.norm(), 1.0, kDifference) << s;
    EXPECT_LT((tangent - Vector2d(std::cos(here.heading), std::sin(here.heading))).norm(), kDifference) << s;
    EXPECT_NEAR((right.heading - left.heading) / (2.0 * h), here.curvature, kDifference) << s;
  }
}

TEST(WalkingPath, TurnsNoTighterThanTheRadiusAndReachesItInEveryCorner)
{
  const WalkingPath path(kZigzag, kRadius);
  double tightest = 0.0, change = 0.0;
  int corners = 0;
  for (double s = 0.0; s < path.length(); s += 0.001)
  {
    const double k = std::abs(path.at(s).curvature), next = std::abs(path.at(s + 0.001).curvature);
    tightest = std::max(tightest, k);
    change = std::max(change, std::abs(next - k));
    corners += k < 0.999 / kRadius && next >= 0.999 / kRadius;
  }
  EXPECT_LE(tightest, 1.0 / kRadius * (1.0 + 1e-12));
  EXPECT_EQ(corners, 3);
  // continuous curvature: its slope is at most 5.77 / (1.875 l), l the length of the shortest corner
  EXPECT_LT(change, 0.001 * 5.78 / 1.875 / (1.875 * std::atan2(1.0, 4.0) * kRadius) / kRadius);
}

// A mirrored path turns the other way; a path walked backwards is the same path.
TEST(WalkingPath, IsTheSameBackwards)
{
  const WalkingPath path(kZigzag, kRadius), back({ kZigzag.rbegin(), kZigzag.rend() }, kRadius);
  ASSERT_NEAR(path.length(), back.length(), 1e-9);
  for (double s = 0.0; s < path.length(); s += 0.1)
  {
    EXPECT_LT((path.at(s).position - back.at(path.length() - s).position).norm(), kIntegration);
    EXPECT_NEAR(path.at(s).curvature, -back.at(path.length() - s).curvature, 1e-9);
  }
}

// Velocity and acceleration of motion() against differences of the position along a made-up s(t).
TEST(WalkingPath, MotionIsTheDerivativeOfThePlaceInTime)
{
  const WalkingPath path(kZigzag, kRadius);
  const auto s = [](double t) { return 0.16 * t + 0.05 * t * t / 20.0; };
  constexpr double h = 1e-2;
  for (double t = 1.0; t < 40.0; t += 0.37)
  {
    const PathMotion motion = path.motion(s(t), 0.16 + 0.1 * t / 20.0, 0.1 / 20.0);
    const Vector2d left = path.at(s(t - h)).position, right = path.at(s(t + h)).position;
    EXPECT_LT((motion.velocity - (right - left) / (2.0 * h)).norm(), 1e-4) << t;
    EXPECT_LT((motion.acceleration - (left - 2.0 * motion.position + right) / (h * h)).norm(), 1e-3) << t;
    EXPECT_NEAR(motion.heading_rate, (path.at(s(t + h)).heading - path.at(s(t - h)).heading) / (2.0 * h), 1e-4);
  }
}

TEST(WalkingPath, ProjectsToTheNearestPoint)
{
  const WalkingPath path(kZigzag, kRadius);
  for (double s = 0.2; s < path.length() - 0.2; s += 0.113)
  {
    const PathPoint point = path.at(s);
    const Vector2d aside = 0.05 * Vector2d(-std::sin(point.heading), std::cos(point.heading));
    EXPECT_NEAR(path.project(point.position + aside, s - 0.04, 0.1), s, 1e-4) << s;
  }
  EXPECT_NEAR(path.project(path.at(1.0).position, 0.5, 0.2), 0.7, 1e-12) << "no farther than its reach";
}

TEST(WalkingPath, PaceKeepsItsPromises)
{
  const WalkingPath path(kZigzag, kRadius);
  const WalkingPace wanted;
  const AlongPath pace = paceAlong(path, wanted);
  double fastest = 0.0, in_bend = 1.0;
  for (std::size_t k = 0; k + 1 < pace.values.size(); ++k)
  {
    const double v = pace.values[k], next = pace.values[k + 1], s = double(k) * pace.step;
    fastest = std::max(fastest, v);
    EXPECT_LE(std::abs(next * next - v * v) / (2.0 * pace.step), wanted.acceleration * (1.0 + 1e-9)) << s;
    if (std::abs(path.at(s).curvature) > 0.99 / kRadius)
      in_bend = std::min(in_bend, v);
  }
  EXPECT_DOUBLE_EQ(fastest, wanted.speed);
  // two-thirds power law in its 1/3 form, against the numbers by hand: (1 / 0.6 / 0.5)^-0.33, above the least share
  EXPECT_NEAR(in_bend, wanted.speed * std::max(wanted.slowest, std::pow(1.0 / kRadius / wanted.straight, -0.33)), 1e-4);
  EXPECT_LE(pace.values.front(), 0.01);
  EXPECT_LE(pace.values.back(), 0.01);
}

// The tractrix of a straight line is known: tan(a / 2) falls with exp(-s / length).
TEST(TrailingYaw, IsTheTractrixOnAStraight)
{
  const WalkingPath path({ { 0, 0 }, { 4, 0 } }, kRadius);
  const AlongPath yaw = trailingYaw(path, 1.1, 1.5);
  for (double s = 0.0; s <= 4.0; s += 0.3)
    EXPECT_NEAR(yaw.at(s), 2.0 * std::atan(std::tan(0.75) * std::exp(-s / 1.1)), 2e-6) << s;  // linear interpolation
}

// Its definition: the rear end moves along the rod only.
TEST(TrailingYaw, RearEndNeverMovesSideways)
{
  const WalkingPath path(kZigzag, kRadius);
  const AlongPath yaw = trailingYaw(path, 1.1, 0.4);
  for (double s = 0.1; s < path.length() - 0.1; s += 0.05)
  {
    const PathPoint front = path.at(s);
    const double a = yaw.at(s),
                 sideways = -std::sin(a) * std::cos(front.heading) + std::cos(a) * std::sin(front.heading);
    EXPECT_NEAR(sideways - 1.1 * yaw.slope(s), 0.0, 1e-4) << s;
  }
  EXPECT_THROW(trailingYaw(path, 0.0, 0.0), std::invalid_argument);
}

TEST(WalkingPath, RefusesWhatIsNoPathNamingAllOfIt)
{
  EXPECT_NE(refusal({ { 0, 0 } }, 0.6).find("1 waypoints"), std::string::npos);
  EXPECT_NE(refusal({ { 0, 0 }, { 1, 0 } }, 0.0).find("tightest radius 0"), std::string::npos);
  EXPECT_NE(refusal({ { 0, 0 }, { 1, 0 }, { 0, 0.01 } }, 0.1).find("turns by 179"), std::string::npos);
  const std::string same = refusal({ { 0, 0 }, { 0, 0 }, { 1, 0 }, { 1, 0 } }, 0.6);
  EXPECT_NE(same.find("0 and 1 are the same"), std::string::npos) << same;
  EXPECT_NE(same.find("2 and 3 are the same"), std::string::npos) << same;
  const std::string brief = refusal({ { 0, 0 }, { 1, 0 }, { 1, 1 }, { 2, 1 } }, 0.6);
  EXPECT_NE(brief.find("waypoint 0 to 1 is 1 m long"), std::string::npos) << brief;
  EXPECT_NE(brief.find("waypoint 1 to 2 is 1 m long"), std::string::npos) << brief;
  EXPECT_NE(refusal({ { 0, 0 }, { 1, 0 } }, NAN).find("tightest radius"), std::string::npos);
  EXPECT_NE(refusal({ { 0, 0 }, { NAN, 0 } }, 0.6).find("0 and 1"), std::string::npos);
}
