// Theorems of the segmentation: optimum against brute force, distance against the integral, bounded memory.
#include "phri_learning/segmentation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "phri_core/random.hpp"
#include "phri_core/testing.hpp"

namespace phri_learning
{
namespace
{
constexpr double kRounding = 1e-9;  // sums of some hundred numbers of size 1

SegmentationOptions small()
{
  SegmentationOptions o;
  o.window = 6;
  o.switch_cost = 2.0;
  o.lag = 8;
  o.horizon = 60;
  return o;
}

/// Noise about a mean that jumps at random times, (T, d).
Eigen::MatrixXd jumps(std::uint64_t seed, int count, int d, double size = 2.0)
{
  phri_core::Random random(seed);
  Eigen::MatrixXd y(count, d);
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(d);
  for (int t = 0; t < count; ++t)
  {
    if (random.uniform() < 0.05)
      for (int j = 0; j < d; ++j)
        mean(j) = size * random.normal();
    for (int j = 0; j < d; ++j)
      y(t, j) = mean(j) + 0.3 * random.normal();
  }
  return y;
}

std::vector<Boundary> online(const Eigen::MatrixXd& y, const SegmentationOptions& o)
{
  OnlineSegmentation segmentation(o, static_cast<int>(y.cols()));
  std::vector<Boundary> result;
  for (Eigen::Index t = 0; t < y.rows(); ++t)
    if (const auto boundary = segmentation.push(y.row(t).transpose()))
      result.push_back(*boundary);
  const std::vector<Boundary> rest = segmentation.finish();
  result.insert(result.end(), rest.begin(), rest.end());
  return result;
}

std::vector<std::int64_t> indices(const std::vector<Boundary>& boundaries)
{
  std::vector<std::int64_t> result;
  for (const Boundary& b : boundaries)
    result.push_back(b.index);
  return result;
}

/// Straight from the definition: embedded samples, all pairs of all windows.
Eigen::MatrixXd distances(const Eigen::MatrixXd& y, const SegmentationOptions& o)
{
  const Eigen::Index back = (o.embedding - 1) * o.delay, d = y.cols();
  Eigen::MatrixXd x(y.rows() - back, o.embedding * d);
  for (Eigen::Index t = 0; t < x.rows(); ++t)
    for (int lag = 0; lag < o.embedding; ++lag)
      x.row(t).segment(lag * d, d) = y.row(t + back - lag * o.delay);
  const Eigen::Index windows = x.rows() - o.window + 1;
  const auto overlap = [&](Eigen::Index a, Eigen::Index b) {
    double sum = 0.0;
    for (int i = 0; i < o.window; ++i)
      for (int j = 0; j < o.window; ++j)
        sum += std::exp(-(x.row(a + i) - x.row(b + j)).squaredNorm() / (4.0 * o.sigma * o.sigma));
    return sum / (o.window * o.window);
  };
  Eigen::MatrixXd result(windows, windows);
  for (Eigen::Index a = 0; a < windows; ++a)
    for (Eigen::Index b = 0; b < windows; ++b)
    {
      const double both = overlap(a, a) + overlap(b, b);
      result(a, b) = (both - 2.0 * overlap(a, b)) / (o.distance == WindowDistance::kSquared ? 1.0 : both);
    }
  return result;
}

/// Least cost by dynamic programming over the NUMBER of segments: every stretch costs what its best prototype costs.
/// Another recursion than the one under test.
double leastCost(const Eigen::MatrixXd& d, double switch_cost)
{
  const Eigen::Index count = d.rows();
  std::vector<double> best(static_cast<std::size_t>(count) + 1, std::numeric_limits<double>::infinity());
  best[0] = -switch_cost;
  for (Eigen::Index end = 1; end <= count; ++end)
    for (Eigen::Index begin = 0; begin < end; ++begin)
    {
      const double stretch = d.middleCols(begin, end - begin).rowwise().sum().minCoeff();
      double& least = best[static_cast<std::size_t>(end)];
      least = std::min(least, best[static_cast<std::size_t>(begin)] + switch_cost + stretch);
    }
  return best.back();
}

/// Cost of given boundaries with the best prototype in between.
double costOf(const Eigen::MatrixXd& d, const std::vector<Boundary>& boundaries, const SegmentationOptions& o)
{
  const std::int64_t half = (o.window + (o.embedding - 1) * o.delay - 1) / 2;
  const std::int64_t back = (o.embedding - 1) * o.delay;
  std::vector<Eigen::Index> cuts = { 0 };
  for (const Boundary& b : boundaries)
    cuts.push_back(b.index + half - back - (o.window - 1));
  cuts.push_back(d.cols());
  double cost = o.switch_cost * static_cast<double>(boundaries.size());
  for (std::size_t i = 0; i + 1 < cuts.size(); ++i)
    cost += d.middleCols(cuts[i], cuts[i + 1] - cuts[i]).rowwise().sum().minCoeff();
  return cost;
}

TEST(Segmentation, OfflineIsTheOptimumOfAnIndependentRecursion)
{
  int found = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed)
  {
    SegmentationOptions o = small();
    o.embedding = 1 + static_cast<int>(seed % 3);
    o.delay = 2;
    o.distance = seed % 2 ? WindowDistance::kSquared : WindowDistance::kNormalized;
    const Eigen::MatrixXd y = jumps(seed, 70, 2), d = distances(y, o);
    const std::vector<Boundary> boundaries = segmentOffline(y, o);
    EXPECT_NEAR(costOf(d, boundaries, o), leastCost(d, o.switch_cost), kRounding) << "seed " << seed;
    found += static_cast<int>(boundaries.size());
    for (const Boundary& b : boundaries)
      EXPECT_GE(b.margin, 0.0);
  }
  EXPECT_GT(found, 12);  // there was something to find
}

TEST(Segmentation, OnlineWithoutCommitmentIsTheOfflineOptimum)
{
  for (std::uint64_t seed = 1; seed <= 20; ++seed)
  {
    SegmentationOptions o = small();
    o.lag = 100;
    o.horizon = 300;
    const Eigen::MatrixXd y = jumps(seed, 90, 2);
    EXPECT_EQ(indices(online(y, o)), indices(segmentOffline(y, o))) << "seed " << seed;
  }
}

TEST(Segmentation, CutsWhereTheRegimeChangesAndKnowsItAgain)
{
  // Means 0, 5, -5, 0 in units of the noise and sigma: windows of different regimes do not overlap at all.
  phri_core::Random random(3);
  SegmentationOptions o = small();
  o.window = 10;
  o.lag = 15;
  o.horizon = 120;
  const double mean[] = { 0.0, 5.0, -5.0, 0.0 };
  Eigen::MatrixXd y(200, 1);
  for (int t = 0; t < 200; ++t)
    y(t) = mean[t / 50] + 0.3 * random.normal();
  const std::vector<Boundary> found = online(y, o);
  ASSERT_EQ(found.size(), 3u);
  for (int i = 0; i < 3; ++i)
  {
    EXPECT_LE(std::abs(static_cast<double>(found[static_cast<std::size_t>(i)].index - 50 * (i + 1))), o.window);
    EXPECT_LE(found[static_cast<std::size_t>(i)].delay, o.horizon + o.window / 2);
    EXPECT_FALSE(found[static_cast<std::size_t>(i)].forced);
    EXPECT_DOUBLE_EQ(found[static_cast<std::size_t>(i)].time,
                     o.dt * static_cast<double>(found[static_cast<std::size_t>(i)].index));
  }
  EXPECT_EQ(found[0].ended, 0);
  EXPECT_EQ(found[1].ended, 1);
  EXPECT_EQ(found[2].ended, 2);

  // 0, 5, 0, 5 without noise: neighbours never share a prototype; off line, where all windows are judged together, the
  // third segment is the first one's regime
  Eigen::MatrixXd four(200, 1);
  for (int t = 0; t < 200; ++t)
    four(t) = mean[(t / 50) % 2];
  for (const std::vector<Boundary>& cuts : { online(four, o), segmentOffline(four, o) })
  {
    ASSERT_EQ(cuts.size(), 3u);
    EXPECT_NE(cuts[0].ended, cuts[1].ended);
  }
  const std::vector<Boundary> whole = segmentOffline(four, o);
  EXPECT_EQ(whole[0].ended, whole[2].ended);
}

TEST(Segmentation, ConstantAndRepeatedSamplesGiveNoBoundaryAndNoNan)
{
  for (const double sigma : { 1.0, 0.0 })
    for (const WindowDistance distance : { WindowDistance::kSquared, WindowDistance::kNormalized })
    {
      SegmentationOptions o = small();
      o.sigma = sigma;
      o.sigma_samples = 20;
      o.distance = distance;
      EXPECT_TRUE(online(Eigen::MatrixXd::Constant(300, 2, 7.0), o).empty());
      Eigen::MatrixXd step = Eigen::MatrixXd::Zero(100, 1);
      step.bottomRows(50).setConstant(1e6);  // no overlap: kernels underflow to 0
      const std::vector<Boundary> found = online(step, o);
      ASSERT_EQ(found.size(), 1u);
      EXPECT_TRUE(std::isfinite(found[0].margin));
      EXPECT_LE(std::abs(static_cast<double>(found[0].index - 50)), o.window);
    }
}

TEST(Segmentation, UnitsAndOffsetsDoNotMatter)
{
  const Eigen::MatrixXd y = jumps(5, 120, 2);
  SegmentationOptions o = small(), scaled = o, rule = o;
  scaled.scale = Eigen::Vector2d(1000.0, 0.25);
  Eigen::MatrixXd other = y;
  other.col(0) = 1000.0 * y.col(0).array() + 64.0;
  other.col(1) = 0.25 * y.col(1).array() - 8.0;
  const auto expected = indices(online(y, o));
  ASSERT_FALSE(expected.empty());
  EXPECT_EQ(indices(online(other, scaled)), expected);
  rule.sigma = 0.0;  // by the neighbour rule one factor for all dimensions cancels without being told
  rule.sigma_samples = 60;
  EXPECT_EQ(indices(online(128.0 * y, rule)), indices(online(y, rule)));
}

TEST(Segmentation, DistanceIsTheIntegralOfTheSquaredDifference)
{
  // 1-D: int (p - q)^2 = (4 pi s^2)^(-1/2) d for the formula that the brute-force oracle above uses and that the class
  // is held to; the rectangle rule for Gaussians on a fine grid is exact to rounding.
  constexpr double kIntegral = 1e-12;
  const double a[] = { 0.1, -0.4, 0.9 }, b[] = { 1.7, 0.8, 1.1 };
  const double s = 0.7;
  SegmentationOptions o = small();
  o.window = 3;
  o.sigma = s;
  o.distance = WindowDistance::kSquared;
  Eigen::MatrixXd y(6, 1);
  y << a[0], a[1], a[2], b[0], b[1], b[2];
  const auto density = [&](const double* samples, double x) {
    double sum = 0.0;
    for (int i = 0; i < 3; ++i)
      sum += std::exp(-(x - samples[i]) * (x - samples[i]) / (2.0 * s * s)) / (3.0 * std::sqrt(2.0 * M_PI) * s);
    return sum;
  };
  double integral = 0.0;
  constexpr double kStep = 0.01;
  for (double x = -10.0; x < 12.0; x += kStep)
    integral += kStep * std::pow(density(a, x) - density(b, x), 2);
  const double d = distances(y, o)(0, 3);
  EXPECT_NEAR(integral, d / std::sqrt(4.0 * M_PI * s * s), kIntegral);
}

TEST(Segmentation, MemoryAndDelayStayBounded)
{
  SegmentationOptions o = small();
  o.prototypes = 4;
  OnlineSegmentation segmentation(o, 2);
  const std::size_t memory = segmentation.memoryBytes();
  phri_core::Random random(9);
  int found = 0, forced = 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (int t = 0; t < 100000; ++t)
  {
    if (random.uniform() < 0.02)
      mean << 3.0 * random.normal(), 3.0 * random.normal();
    const bool still = t % 1000 < 300;  // longer than the horizon: times are dropped without a boundary
    const auto boundary =
        segmentation.push(still ? Eigen::Vector2d::Zero()
                                : Eigen::Vector2d(mean + 0.5 * Eigen::Vector2d(random.normal(), random.normal())));
    if (boundary)
    {
      ++found;
      forced += boundary->forced ? 1 : 0;
      ASSERT_LE(boundary->delay, o.horizon + o.window);
      ASSERT_TRUE(std::isfinite(boundary->margin));
    }
    ASSERT_LT(segmentation.openWindows(), o.horizon);
    ASSERT_LE(segmentation.knownPrototypes(), o.prototypes);
  }
  EXPECT_GT(found, 500);
  EXPECT_LT(forced, found);
  EXPECT_EQ(segmentation.memoryBytes(), memory);
}

TEST(Segmentation, MarginIsWhatOnePrototypeForBothNeighboursWouldCostMore)
{
  double largest = 0.0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed)
  {
    const SegmentationOptions o = small();
    const Eigen::MatrixXd y = jumps(seed, 90, 2), d = distances(y, o);
    const std::vector<Boundary> boundaries = segmentOffline(y, o);
    std::vector<Eigen::Index> cuts = { 0 };
    for (const Boundary& b : boundaries)
      cuts.push_back(b.index + (o.window - 1) / 2 - (o.window - 1));
    cuts.push_back(d.cols());
    const auto stretch = [&](Eigen::Index from, Eigen::Index until) {
      return d.middleCols(from, until - from).rowwise().sum().minCoeff();
    };
    for (std::size_t i = 0; i < boundaries.size(); ++i)
    {
      const double apart = stretch(cuts[i], cuts[i + 1]) + stretch(cuts[i + 1], cuts[i + 2]);
      const double expected = stretch(cuts[i], cuts[i + 2]) - apart - o.switch_cost;
      EXPECT_NEAR(boundaries[i].margin, std::max(0.0, expected), kRounding) << "seed " << seed;
      largest = std::max(largest, expected);
    }
  }
  EXPECT_GT(largest, 1.0);
}

TEST(Segmentation, OneRegimeIsOneSegmentHoweverLong)
{
  // ten times the horizon: what is forgotten at the beginning costs nothing, so the regime in force stays in force
  const SegmentationOptions o = small();
  phri_core::Random random(7);
  Eigen::MatrixXd y(10 * o.horizon, 1);
  for (Eigen::Index t = 0; t < y.rows(); ++t)
    y(t) = 0.3 * random.normal();
  EXPECT_TRUE(online(y, o).empty());
}

TEST(Segmentation, ASeriesBeginsFreeOfWhatWasInForceBefore)
{
  // a regime outlasts the horizon, so it is carried along as prototype 0. The next series begins a little aside: a
  // window of its own fits better, and without a regime in force taking it costs no switch.
  const SegmentationOptions o = small();
  OnlineSegmentation segmentation(o, 1);
  for (int t = 0; t < 3 * o.horizon; ++t)
    EXPECT_FALSE(segmentation.push(Eigen::VectorXd::Zero(1)));
  EXPECT_TRUE(segmentation.finish().empty());
  std::vector<Boundary> found;
  for (int t = 0; t < 80; ++t)
    if (const auto boundary = segmentation.push(Eigen::VectorXd::Constant(1, t < 40 ? 0.3 : 5.0)))
      found.push_back(*boundary);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_LE(std::abs(static_cast<double>(found[0].index - 40)), o.window);
  EXPECT_NE(found[0].ended, 0);
  EXPECT_TRUE(segmentation.finish().empty());
}

TEST(Segmentation, KnownRegimesAreFoundAgainAndTheLeastRecentlyUsedIsForgotten)
{
  // Regimes that alternate between two values of their own: all overlaps are 0 or 1/2 exactly, and of equally good
  // states the oldest wins. Two prototypes are kept.
  SegmentationOptions o = small();
  o.prototypes = 2;
  o.lag = 100;
  o.horizon = 300;
  OnlineSegmentation segmentation(o, 1);
  const auto ended = [&](const std::vector<int>& regimes) {
    for (const int regime : regimes)
      for (int t = 0; t < 40; ++t)
        EXPECT_FALSE(segmentation.push(Eigen::VectorXd::Constant(1, 1000.0 * regime + 100.0 * (t % 2))));
    std::vector<int> ids;
    for (const Boundary& boundary : segmentation.finish())
      ids.push_back(boundary.ended);
    return ids;
  };
  EXPECT_EQ(ended({ 0, 1 }), std::vector<int>{ 0 });  // regimes 0 and 1 are prototypes 0 and 1
  EXPECT_EQ(segmentation.knownPrototypes(), 2);
  EXPECT_EQ(ended({ 2, 0, 3 }), (std::vector<int>{ 2, 0 }));  // 2 and 3 take the places of 1, then of 0
  EXPECT_EQ(ended({ 0, 2, 1 }), (std::vector<int>{ 4, 2 }));
}

TEST(Segmentation, PushDoesNotAllocate)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations are not counted under AddressSanitizer";
  const Eigen::MatrixXd y = jumps(21, 1000, 2).transpose();
  OnlineSegmentation segmentation(small(), 2);
  int found = 0;
  EXPECT_EQ(phri_core::testing::countAllocations([&] {
              for (Eigen::Index t = 0; t < y.cols(); ++t)
                found += segmentation.push(y.col(t)) ? 1 : 0;
            }),
            0);
  EXPECT_GT(found, 10);  // commits are part of it
}

TEST(Segmentation, RefusesWhatItCannotUse)
{
  SegmentationOptions o = small();
  o.horizon = 2 * (o.lag + o.window);
  EXPECT_THROW(OnlineSegmentation(o, 1), std::invalid_argument);
  o = small();
  o.scale = Eigen::Vector2d(1.0, 0.0);
  EXPECT_THROW(OnlineSegmentation(o, 2), std::invalid_argument);
  EXPECT_THROW(OnlineSegmentation(o, 3), std::invalid_argument);
  OnlineSegmentation segmentation(small(), 1);
  EXPECT_THROW(segmentation.push(Eigen::Vector2d::Zero()), std::invalid_argument);
  EXPECT_THROW(segmentation.push(Eigen::VectorXd::Constant(1, std::nan(""))), std::invalid_argument);
  EXPECT_EQ(segmentation.samples(), 0);
  EXPECT_TRUE(segmentation.finish().empty());
}
}  // namespace
}  // namespace phri_learning
