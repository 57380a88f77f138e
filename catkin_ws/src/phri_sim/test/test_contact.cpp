// Distances between primitives against closed forms, and the contact solver against an independent solver and against
// the conditions that define its solution.
#include <BulletDynamics/MLCPSolvers/btDantzigSolver.h>
#include <gtest/gtest.h>
#include <Eigen/QR>

#include <cmath>

#include "mechanisms.hpp"
#include "phri_core/random.hpp"
#include "phri_sim/collision.hpp"

namespace
{
using namespace phri_sim;
using namespace phri_sim::testing;
using Eigen::Vector3d;

constexpr double kExact = 1e-9;    // box-box and spheres are closed forms: rounding of 1 m numbers
constexpr double kGjk = 1e-7;      // [m] GJK stops at a relative change of 1e-12 of the squared distance
constexpr double kAbove = 0.4e-3;  // [m] within the skin, not touching yet

std::vector<Proximity> between(const ShapeDescription& a, const Eigen::Isometry3d& pose_a, const ShapeDescription& b,
                               const Eigen::Isometry3d& pose_b)
{
  CollisionScene scene({ { a, 0, {} }, { b, 1, {} } }, { { 0, 1 } });
  scene.setPose(0, pose_a);
  scene.setPose(1, pose_b);
  std::vector<Proximity> found;
  found.reserve(8);
  EXPECT_EQ(scene.detect(found), 0);
  return found;
}

Eigen::Isometry3d at(double x, double y, double z)
{
  return Eigen::Isometry3d(Eigen::Translation3d(x, y, z));
}

/// Anything, rotated by the same turn, must come out the same: exact numbers must not depend on aligned axes.
Eigen::Isometry3d turned()
{
  return Eigen::Translation3d(0.3, -0.2, 0.7) * Eigen::AngleAxisd(0.9, Vector3d(1, 2, -3).normalized());
}

struct Stack
{
  const char* name;
  ShapeDescription shape;
  double half_height, tolerance;
  std::size_t points;
  double share;
  Eigen::Isometry3d lying = Eigen::Isometry3d::Identity();
};

TEST(Collision, DepthOnAFaceIsExact)
{
  const Eigen::Isometry3d side(Eigen::AngleAxisd(M_PI / 2, Vector3d::UnitX()));
  const std::vector<Stack> stacks = { { "box", box(0.1, 0.06, 0.04), 0.02, kExact, 4, 0.25 },
                                      { "sphere", sphere(0.03), 0.03, kGjk, 1, 1.0 },
                                      { "cylinder upright", cylinder(0.02, 0.05), 0.025, kGjk, 1, 1.0 },
                                      { "cylinder on its side", cylinder(0.02, 0.05), 0.02, kGjk, 1, 1.0, side } };
  const ShapeDescription slab = box(1.0, 1.0, 0.1);
  for (const Stack& s : stacks)
  {
    for (const double distance : { kAbove, 1e-5, -1e-5, -1e-3, -2.5e-3 })
    {
      const auto found =
          between(s.shape, turned() * at(0.05, 0.02, 0.05 + s.half_height + distance) * s.lying, slab, turned());
      ASSERT_EQ(found.size(), s.points) << s.name << " at " << distance;
      for (const Proximity& p : found)
      {
        EXPECT_NEAR(p.distance, distance, s.tolerance) << s.name;
        EXPECT_LT((p.normal - turned().linear().col(2)).norm(), 1e-6) << s.name;
        EXPECT_NEAR((turned().inverse() * p.point).z(), 0.05 + 0.5 * distance, 1e-6) << s.name << ": half way";
        EXPECT_EQ(p.share, s.share);
      }
    }
    EXPECT_TRUE(between(s.shape, turned() * at(0, 0, 0.05 + s.half_height + 0.6e-3) * s.lying, slab, turned()).empty())
        << s.name << ": beyond the skin nothing is near";
  }
}

TEST(Collision, SpheresTouchExactlyWhereTheirCentresSay)
{
  phri_core::Random random(7);
  int touching = 0;
  CollisionScene scene({ { sphere(0.1), 0, {} }, { sphere(0.15), 1, {} } }, { { 0, 1 } });
  std::vector<Proximity> found;
  found.reserve(4);
  for (int i = 0; i < 2000; ++i)  // one scene all along: what it remembers must not hide a contact
  {
    const Vector3d a(random.uniform(-0.25, 0.25), random.uniform(-0.25, 0.25), random.uniform(-0.25, 0.25)),
        b(random.uniform(-0.25, 0.25), random.uniform(-0.25, 0.25), random.uniform(-0.25, 0.25));
    scene.setPose(0, at(a.x(), a.y(), a.z()));
    scene.setPose(1, at(b.x(), b.y(), b.z()));
    scene.detect(found);
    const double distance = (a - b).norm() - 0.25;
    if (std::abs(distance - 2.0 * CollisionScene::kSkin) < kGjk)
      continue;
    ASSERT_EQ(found.size(), distance < 2.0 * CollisionScene::kSkin ? 1u : 0u) << distance;
    if (found.empty())
      continue;
    ++touching;
    EXPECT_NEAR(found[0].distance, distance, kGjk);
    EXPECT_LT((found[0].normal - (a - b).normalized()).norm(), 1e-6);
  }
  EXPECT_GT(touching, 300);
  EXPECT_LT(touching, 1700);
}

TEST(Collision, OnlyThePresentPosesCount)
{
  phri_core::Random random(3);
  const std::vector<CollisionShape> shapes = { { box(0.2, 0.1, 0.1), 0, {} },
                                               { cylinder(0.05, 0.2), 1, {} },
                                               { box(0.1, 0.1, 0.3), 2, {} },
                                               { sphere(0.08), 3, {} } };
  const std::vector<std::pair<int, int>> pairs = { { 0, 1 }, { 0, 2 }, { 0, 3 }, { 1, 2 }, { 1, 3 }, { 2, 3 } };
  CollisionScene used(shapes, pairs);
  std::vector<Proximity> a, b;
  a.reserve(32);
  b.reserve(32);
  std::size_t seen = 0;
  for (int i = 0; i < 300; ++i)
  {
    CollisionScene fresh(shapes, pairs);
    for (int s = 0; s < 4; ++s)
    {
      const Eigen::Isometry3d pose =
          Eigen::Translation3d(2.5 * random.normal(0.0, 0.05), 2.5 * random.normal(0.0, 0.05),
                               2.5 * random.normal(0.0, 0.05)) *
          Eigen::AngleAxisd(40.0 * random.normal(0.0, 0.05),
                            Vector3d(random.normal(0.0, 0.05), random.normal(0.0, 0.05), 0.05).normalized());
      used.setPose(s, pose);
      fresh.setPose(s, pose);
    }
    used.detect(a);
    fresh.detect(b);
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t p = 0; p < a.size(); ++p)
      EXPECT_TRUE(a[p].distance == b[p].distance && a[p].point == b[p].point && a[p].normal == b[p].normal);
    seen += a.size();
  }
  EXPECT_GT(seen, 300u);
}

TEST(Collision, KeepsTheDeepestWhereThereIsNoRoom)
{
  CollisionScene scene({ { sphere(0.1), 0, {} }, { box(1, 1, 0.1), 1, {} }, { box(1, 0.1, 1), 2, {} } },
                       { { 0, 1 }, { 0, 2 } });
  scene.setPose(0, at(0, 0, 0.149));    // 1 mm into the first
  scene.setPose(2, at(0, 0.148, 0.2));  // 2 mm into the second
  std::vector<Proximity> found;
  found.reserve(1);
  EXPECT_EQ(scene.detect(found), 1);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_NEAR(found[0].distance, -2e-3, kGjk);
}

TEST(Collision, RefusesShapesWithoutSize)
{
  EXPECT_THROW(CollisionScene({ { sphere(0.0), 0, {} } }, {}), std::invalid_argument);
  EXPECT_THROW(CollisionScene({ { box(1, NAN, 1), 0, {} } }, {}), std::invalid_argument);
}

TEST(Materials, ActAsSpringsInSeries)
{
  const Material soft{ 1e3, 0.4, 0.2 }, hard{ 9e3, 0.1, 0.8 };
  const Material pair = combine(soft, hard);
  EXPECT_DOUBLE_EQ(pair.stiffness, 900.0);
  EXPECT_DOUBLE_EQ(pair.damping_ratio, 0.9 * 0.4 + 0.1 * 0.1);  // the softer one yields nine times as much
  EXPECT_DOUBLE_EQ(pair.friction, 0.4);
}
}  // namespace
