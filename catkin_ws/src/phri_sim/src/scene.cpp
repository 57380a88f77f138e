#include "phri_sim/scene.hpp"

#include <algorithm>
#include <cmath>

#include "phri_core/random.hpp"

namespace phri_sim
{
Eigen::Vector2d MovingObstacle::position(double t) const
{
  return { center(0) + amplitude * std::sin(2.0 * M_PI * t / period + phase), center(1) };
}

Eigen::Vector2d MovingObstacle::velocity(double t) const
{
  const double rate = 2.0 * M_PI / period;
  return { amplitude * rate * std::cos(rate * t + phase), 0.0 };
}

double MovingObstacle::distance(const Eigen::Vector2d& x, double t, Eigen::Vector2d* normal) const
{
  const Eigen::Vector2d local = x - position(t);
  const Eigen::Vector2d sign(local(0) < 0 ? -1.0 : 1.0, local(1) < 0 ? -1.0 : 1.0);
  const Eigen::Vector2d beyond = local.cwiseAbs() - half_size, outside = beyond.cwiseMax(0.0);
  const double length = outside.norm();
  const bool inside = length == 0.0;
  if (normal)
  {
    const Eigen::Vector2d face = beyond(0) > beyond(1) ? Eigen::Vector2d(1, 0) : Eigen::Vector2d(0, 1);
    *normal = sign.cwiseProduct(inside ? face : Eigen::Vector2d(outside / length));
  }
  return inside ? beyond.maxCoeff() : length;
}

Eigen::Vector2d contactForce(const Scene& scene, const std::vector<MovingObstacle>& obstacles, const Eigen::Vector2d& x,
                             const Eigen::Vector2d& v, double t) noexcept
{
  const auto push = [&](double distance, const Eigen::Vector2d& normal, const Eigen::Vector2d& relative) {
    const double depth = scene.object_radius - distance;
    return Eigen::Vector2d(std::max(0.0, scene.stiffness * depth - scene.damping * normal.dot(relative)) * normal);
  };
  Eigen::Vector2d force = Eigen::Vector2d::Zero();
  const double wall = scene.walls.distance(x);
  if (wall < scene.object_radius)
    force += push(wall, scene.walls.gradient(x), v);
  for (const MovingObstacle& obstacle : obstacles)
  {
    Eigen::Vector2d normal;
    const double distance = obstacle.distance(x, t, &normal);
    if (distance < scene.object_radius)
      force += push(distance, normal, v - obstacle.velocity(t));
  }
  return force;
}

std::vector<MovingObstacle> obstaclesOfTrial(const Scene& scene, std::uint64_t trial_seed)
{
  phri_core::Random random = phri_core::Random::stream(trial_seed, "obstacles");
  std::vector<MovingObstacle> obstacles = scene.obstacles;
  for (MovingObstacle& obstacle : obstacles)
  {
    obstacle.period = random.uniform(scene.period_low, scene.period_high);
    obstacle.phase = random.uniform(0.0, 2.0 * M_PI);
  }
  return obstacles;
}
}  // namespace phri_sim
