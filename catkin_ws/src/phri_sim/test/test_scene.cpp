#include <gtest/gtest.h>

#include <cmath>

#include "phri_core/random.hpp"
#include "phri_sim/scene.hpp"

using namespace phri_sim;
using Eigen::Vector2d;

namespace
{
GrayImage randomImage(int width, int height, std::uint64_t seed)
{
  phri_core::Random random(seed);
  GrayImage image{ width, height, std::vector<std::uint8_t>(width * height) };
  for (std::uint8_t& pixel : image.pixels)
    pixel = random.uniform() < 0.1 ? 0 : 255;
  return image;
}
}  // namespace

// At pixel centres the field is the distance to the nearest pixel of the other kind, less half a pixel: brute force.
TEST(DistanceField, EqualsBruteForce)
{
  const int w = 23, h = 17;
  const double resolution = 0.01;
  const GrayImage image = randomImage(w, h, 5);
  const DistanceField field(image, resolution, Vector2d(-0.1, 0.2), 0.65);
  const auto wall = [&](int i, int j) {
    return i < 0 || j < 0 || i >= w || j >= h || image.pixels[(h - 1 - j) * w + i] == 0;
  };
  for (int j = 0; j < h; ++j)
    for (int i = 0; i < w; ++i)
    {
      double nearest = 1e9;
      for (int b = -1; b <= h; ++b)
        for (int a = -1; a <= w; ++a)
          if (wall(a, b) != wall(i, j))
            nearest = std::min(nearest, std::hypot(a - i, b - j));
      const double expected = (wall(i, j) ? -1 : 1) * (nearest - 0.5) * resolution;
      const Vector2d center(-0.1 + (i + 0.5) * resolution, 0.2 + (j + 0.5) * resolution);
      EXPECT_NEAR(field.distance(center), expected, 1e-8) << i << ' ' << j;
    }
}

TEST(DistanceField, OutsideThePictureIsWall)
{
  const GrayImage free{ 10, 10, std::vector<std::uint8_t>(100, 255) };
  const DistanceField field(free, 0.01, Vector2d(0, 0), 0.65);
  EXPECT_NEAR(field.distance({ 0.05, 0.001 }), 0.001, 1e-6);
  EXPECT_NEAR(field.gradient({ 0.05, 0.003 })(1), 1.0, 1e-6);
  EXPECT_LE(field.distance({ 5.0, 5.0 }), 0.0);
}

// Surfaces push away from themselves, in proportion to depth, and never pull: 1e4 random contacts in the shipped maze.
TEST(ContactForce, PushesAndNeverPulls)
{
  const Scene scene = loadScene("maze");
  phri_core::Random random(3);
  int contacts = 0;
  for (int k = 0; k < 10000; ++k)
  {
    const Vector2d x(random.uniform(-0.15, 0.15), random.uniform(-0.15, 0.15));
    const Vector2d v(random.normal(0, 0.1), random.normal(0, 0.1));
    const Vector2d force = contactForce(scene, {}, x, v, 0.0);
    const double depth = scene.object_radius - scene.walls.distance(x);
    EXPECT_TRUE(force.allFinite());
    EXPECT_TRUE(depth > 0.0 || force.norm() == 0.0);
    EXPECT_GE(force.dot(scene.walls.gradient(x)), -1e-12);
    contacts += force.norm() > 0.0;
  }
  EXPECT_GT(contacts, 1000);
  EXPECT_EQ(contactForce(scene, {}, scene.start, Vector2d(1, 1), 0.0).norm(), 0.0);
}

TEST(MovingObstacle, DistanceNormalAndVelocityFitTogether)
{
  MovingObstacle box;
  box.half_size = { 0.02, 0.01 };
  box.phase = 0.7;
  phri_core::Random random(4);
  constexpr double kStep = 1e-6;
  for (int k = 0; k < 1000; ++k)
  {
    const double t = random.uniform(0, 10);
    const Vector2d x(random.uniform(-0.1, 0.1), random.uniform(0.011, 0.05));  // above the box: a smooth region
    Vector2d normal;
    const double d = box.distance(x, t, &normal);
    const Vector2d slope((box.distance(x + Vector2d(kStep, 0), t) - d) / kStep,
                         (box.distance(x + Vector2d(0, kStep), t) - d) / kStep);
    EXPECT_NEAR((slope - normal).norm(), 0.0, 1e-3);
    EXPECT_NEAR((box.position(t + kStep) - box.position(t))(0) / kStep, box.velocity(t)(0), 1e-5);
  }
  EXPECT_LT(box.distance(box.position(1.0), 1.0), 0.0);
}

TEST(Obstacles, DependOnTheTrialSeedOnly)
{
  const Scene scene = loadScene("maze");
  const auto a = obstaclesOfTrial(scene, 1), b = obstaclesOfTrial(scene, 1), c = obstaclesOfTrial(scene, 2);
  ASSERT_EQ(a.size(), 2u);
  EXPECT_EQ(a[0].phase, b[0].phase);
  EXPECT_NE(a[0].phase, c[0].phase);
  for (const auto& obstacle : a)
  {
    EXPECT_GE(obstacle.period, 3.0);
    EXPECT_LE(obstacle.period, 5.0);
  }
}
