#pragma once
#include <Eigen/Geometry>
#include <memory>
#include <utility>
#include <vector>

#include "phri_sim/robot_description.hpp"

namespace phri_sim
{
/// What a surface is made of. A pair of surfaces acts like two springs in series: 1/K = 1/K_a + 1/K_b; its damping
/// ratio is the mean of the two weighted by compliance (the softer one decides), its friction the geometric mean.
struct Material
{
  double stiffness = 2e4;      ///< K [N/m] of a whole contact of two shapes, at most 1e6
  double damping_ratio = 0.1;  ///< against sqrt(K x effective mass at the contact) [-]
  double friction = 0.5;       ///< Coulomb [-]
};

Material combine(const Material& a, const Material& b) noexcept;

/// One primitive and who carries it.
struct CollisionShape
{
  ShapeDescription shape;  ///< its origin is in the frame of the pose given to CollisionScene::setPose
  int link = -1;           ///< index for the caller; -1: the environment
  Material material;
};

/// Two shapes near or inside each other, at one point.
struct Proximity
{
  int shape_a = -1, shape_b = -1;
  Eigen::Vector3d point;   ///< in the world, half way between the two surfaces [m]
  Eigen::Vector3d normal;  ///< unit, from b to a
  double distance = 0.0;   ///< negative: depth of penetration [m]
  double share = 1.0;      ///< of the pair's stiffness that acts at this point
};

/// Distances between primitives by Bullet's double-precision narrow phase: btBoxBoxDetector for two boxes (up to four
/// points), btGjkPairDetector for all else (one point). Only what is computed from the present poses comes out: no
/// manifold is carried from step to step, so that a state alone decides the forces, depth is exact, and nothing is
/// pooled or allocated. (btCollisionWorld keeps manifolds whose points and depths depend on the past.)
///
/// Every shape is grown by kSkin for the search and the growth subtracted from the distance again: contacts come out
/// kSkin x 2 before the surfaces meet, so that no speed below kSkin x 2 / step enters a surface without a force.
/// Flat contact of two boxes gives four points, hence a quarter of the stiffness each, also where fewer touch:
/// stiffness is then continuous when an edge lifts off. Other pairs have one point: a cylinder that lies along a plane
/// rocks; use boxes for what lies or wipes. Edges of boxes and cylinders met by GJK are rounded by up to kMargin; pairs
/// deeper than kMargin (and the radius of a sphere) are solved by expanding polytopes, to about 1e-4 m.
class CollisionScene
{
public:
  static constexpr double kSkin = 0.25e-3;  ///< [m]
  static constexpr double kMargin = 2e-3;   ///< [m]

  /// `pairs` are indices into `shapes`. Throws std::invalid_argument on sizes that are not positive.
  CollisionScene(std::vector<CollisionShape> shapes, const std::vector<std::pair<int, int>>& pairs);
  ~CollisionScene();
  CollisionScene(CollisionScene&&) noexcept;
  CollisionScene& operator=(CollisionScene&&) noexcept;

  const std::vector<CollisionShape>& shapes() const;
  int pairs() const;
  /// `link` is the pose of the shape's link in the world.
  void setPose(int shape, const Eigen::Isometry3d& link) noexcept;
  /// Overwrites `found`, up to its capacity; the rest is counted in the return value, which is 0 if all had room.
  int detect(std::vector<Proximity>& found) noexcept;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};
}  // namespace phri_sim
