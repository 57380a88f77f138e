#include "phri_sim/collision.hpp"

#include <BulletCollision/CollisionDispatch/btBoxBoxDetector.h>
#include <BulletCollision/CollisionShapes/btBoxShape.h>
#include <BulletCollision/CollisionShapes/btCylinderShape.h>
#include <BulletCollision/CollisionShapes/btSphereShape.h>
#include <BulletCollision/NarrowPhaseCollision/btGjkEpaPenetrationDepthSolver.h>
#include <BulletCollision/NarrowPhaseCollision/btGjkPairDetector.h>
#include <BulletCollision/NarrowPhaseCollision/btVoronoiSimplexSolver.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

static_assert(sizeof(btScalar) == sizeof(double), "Bullet in double precision: pkg-config bullet-float64");

namespace phri_sim
{
namespace
{
using Eigen::Vector3d;

btVector3 toBullet(const Vector3d& v)
{
  return { v.x(), v.y(), v.z() };
}

Vector3d fromBullet(const btVector3& v)
{
  return { v.x(), v.y(), v.z() };
}

btTransform toBullet(const Eigen::Isometry3d& pose)
{
  const auto& m = pose.matrix();
  return btTransform(btMatrix3x3(m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2)),
                     btVector3(m(0, 3), m(1, 3), m(2, 3)));
}

/// Half edges of a box; radius, radius, half length of a cylinder; three radii of a sphere; all grown by the skin.
Vector3d grownHalfSize(const ShapeDescription& shape)
{
  const Vector3d& s = shape.size;
  const Vector3d half = shape.kind == ShapeKind::Box        ? Vector3d(0.5 * s)
                        : shape.kind == ShapeKind::Cylinder ? Vector3d(s.x(), s.x(), 0.5 * s.y())
                                                            : Vector3d::Constant(s.x());
  if (!(half.minCoeff() > 0.0) || !half.allFinite())
    throw std::invalid_argument("collision shape: sizes must be positive and finite [m]");
  return half + Vector3d::Constant(CollisionScene::kSkin);
}

std::unique_ptr<btConvexShape> makeShape(ShapeKind kind, const Vector3d& half)
{
  if (kind == ShapeKind::Sphere)
    return std::make_unique<btSphereShape>(half.x());
  std::unique_ptr<btConvexShape> shape;
  if (kind == ShapeKind::Box)
    shape = std::make_unique<btBoxShape>(toBullet(half));
  else
    shape = std::make_unique<btCylinderShapeZ>(toBullet(half));
  shape->setMargin(std::min(CollisionScene::kMargin, 0.5 * half.minCoeff()));
  return shape;
}

struct PlacedShape
{
  ShapeKind kind;
  Vector3d half;
  std::unique_ptr<btConvexShape> bullet;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  Vector3d reach = Vector3d::Zero();  // half size of the box in world axes around it

  /// Half width of the shadow on the unit direction d.
  double extent(const Vector3d& d) const
  {
    if (kind == ShapeKind::Sphere)
      return half.x();
    const Vector3d local = pose.linear().transpose() * d;
    if (kind == ShapeKind::Box)
      return half.dot(local.cwiseAbs());
    return half.z() * std::abs(local.z()) + half.x() * std::hypot(local.x(), local.y());
  }
};

struct Pair
{
  int a, b;
  Vector3d axis;  // direction in which they were last found apart; only used to prove that they still are
};

bool apart(const PlacedShape& a, const PlacedShape& b, const Vector3d& axis)
{
  return std::abs(axis.dot(a.pose.translation() - b.pose.translation())) > a.extent(axis) + b.extent(axis);
}

/// Collects what a detector finds; normals from b to a, points on b.
struct Collector final : btDiscreteCollisionDetectorInterface::Result
{
  struct Point
  {
    btVector3 normal, on_b;
    btScalar distance;
  };
  std::array<Point, 8> points;
  int count = 0;

  void setShapeIdentifiersA(int, int) override {}
  void setShapeIdentifiersB(int, int) override {}
  void addContactPoint(const btVector3& normal, const btVector3& on_b, btScalar distance) override
  {
    if (count < int(points.size()))
      points[std::size_t(count++)] = { normal, on_b, distance };
  }
};

double inSeries(double a, double b)
{
  return a * b / (a + b);
}
}  // namespace

Material combine(const Material& a, const Material& b) noexcept
{
  const double share_a = b.stiffness / (a.stiffness + b.stiffness);  // of the compliance
  return { inSeries(a.stiffness, b.stiffness), share_a * a.damping_ratio + (1.0 - share_a) * b.damping_ratio,
           std::sqrt(a.friction * b.friction) };
}

struct CollisionScene::Impl
{
  std::vector<CollisionShape> shapes;
  std::vector<PlacedShape> placed;
  std::vector<Pair> pairs;
  btVoronoiSimplexSolver simplex;
  btGjkEpaPenetrationDepthSolver penetration;

  void examine(Pair& pair, Collector& found)
  {
    const PlacedShape& a = placed[std::size_t(pair.a)];
    const PlacedShape& b = placed[std::size_t(pair.b)];
    found.count = 0;
    if (((a.pose.translation() - b.pose.translation()).cwiseAbs().array() > (a.reach + b.reach).array()).any() ||
        apart(a, b, pair.axis))
      return;
    btDiscreteCollisionDetectorInterface::ClosestPointInput input;
    input.m_transformA = toBullet(a.pose);
    input.m_transformB = toBullet(b.pose);
    if (a.kind == ShapeKind::Box && b.kind == ShapeKind::Box)
    {
      btBoxBoxDetector(static_cast<const btBoxShape*>(a.bullet.get()), static_cast<const btBoxShape*>(b.bullet.get()))
          .getClosestPoints(input, found, nullptr);
      return;
    }
    btGjkPairDetector gjk(a.bullet.get(), b.bullet.get(), &simplex, &penetration);
    gjk.getClosestPoints(input, found, nullptr);
    if (found.count > 0 && found.points[0].distance > 0.0)
    {
      pair.axis = fromBullet(found.points[0].normal);
      found.count = 0;
    }
  }
};

CollisionScene::CollisionScene(std::vector<CollisionShape> shapes, const std::vector<std::pair<int, int>>& pairs)
  : impl_(std::make_unique<Impl>())
{
  impl_->shapes = std::move(shapes);
  for (const CollisionShape& shape : impl_->shapes)
  {
    PlacedShape placed{ shape.shape.kind, grownHalfSize(shape.shape), nullptr };
    placed.bullet = makeShape(placed.kind, placed.half);
    impl_->placed.push_back(std::move(placed));
  }
  for (const auto& [a, b] : pairs)
    impl_->pairs.push_back({ a, b, Vector3d::UnitX() });
  for (int i = 0; i < int(impl_->shapes.size()); ++i)
    setPose(i, Eigen::Isometry3d::Identity());
}

CollisionScene::~CollisionScene() = default;
CollisionScene::CollisionScene(CollisionScene&&) noexcept = default;
CollisionScene& CollisionScene::operator=(CollisionScene&&) noexcept = default;

const std::vector<CollisionShape>& CollisionScene::shapes() const
{
  return impl_->shapes;
}

int CollisionScene::pairs() const
{
  return int(impl_->pairs.size());
}

void CollisionScene::setPose(int shape, const Eigen::Isometry3d& link) noexcept
{
  PlacedShape& placed = impl_->placed[std::size_t(shape)];
  placed.pose = link * impl_->shapes[std::size_t(shape)].shape.origin;
  for (int axis = 0; axis < 3; ++axis)
    placed.reach[axis] = placed.extent(Vector3d::Unit(axis));
}

int CollisionScene::detect(std::vector<Proximity>& found) noexcept
{
  found.clear();
  int dropped = 0;
  Collector collector;
  for (Pair& pair : impl_->pairs)
  {
    impl_->examine(pair, collector);
    const bool boxes = impl_->placed[std::size_t(pair.a)].kind == ShapeKind::Box &&
                       impl_->placed[std::size_t(pair.b)].kind == ShapeKind::Box;
    for (int i = 0; i < collector.count; ++i)
    {
      const Collector::Point& p = collector.points[std::size_t(i)];
      const Vector3d normal = fromBullet(p.normal);
      const Proximity point{ pair.a,
                             pair.b,
                             fromBullet(p.on_b) + 0.5 * p.distance * normal,
                             normal,
                             p.distance + 2.0 * kSkin,
                             boxes ? 0.25 : 1.0 };
      if (found.size() < found.capacity())
      {
        found.push_back(point);
        continue;
      }
      ++dropped;
      const auto shallowest = std::max_element(
          found.begin(), found.end(), [](const Proximity& a, const Proximity& b) { return a.distance < b.distance; });
      if (shallowest != found.end() && shallowest->distance > point.distance)
        *shallowest = point;
    }
  }
  return dropped;
}
}  // namespace phri_sim
