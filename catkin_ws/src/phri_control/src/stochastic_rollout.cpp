#include "phri_control/stochastic_rollout.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace phri_control
{
namespace
{
/// A root of a covariance, singular ones included.
CostMatrix rootOf(const CostMatrix& covariance)
{
  const Eigen::SelfAdjointEigenSolver<CostMatrix> eigen(covariance);
  const CostVector deviations = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  return eigen.eigenvectors() * deviations.asDiagonal();
}
}  // namespace

Eigen::VectorXd RollOuts::clearance() const
{
  if (distances.cols() == 0)
    return Eigen::VectorXd::Constant(costs.size(), std::numeric_limits<double>::infinity());
  return distances.rowwise().minCoeff();
}

Eigen::Array<bool, Eigen::Dynamic, 1> RollOuts::collided() const
{
  return clearance().array() < 1.0;
}

namespace detail
{
void requireRollOut(const RollOutOptions& options, std::size_t sources)
{
  if (options.count < 1)
    throw std::invalid_argument("rollOuts: count = " + std::to_string(options.count) + ", expected at least 1");
  if (options.source < -1 || options.source >= static_cast<int>(sources))
    throw std::invalid_argument("rollOuts: source = " + std::to_string(options.source) + ", expected below " +
                                std::to_string(sources) + ", or -1 for all");
}

SceneWorld::SceneWorld(const PlanarScene& scene) : robot_(scene.robot), dt_(scene.dt)
{
  validate(scene);
  for (const AvoidedObstacle& obstacle : scene.obstacles)
    moving_.push_back({ scene.movers[obstacle.mover].plant, scene.offset(obstacle.mover), obstacle.weight });
  const auto place = [](const auto& belief) -> Place {
    return { belief.mean(), belief.mean(), rootOf(belief.covariance()), belief.weight() };
  };
  for (const StaticGoal& goal : scene.static_goals)
    goals_.push_back({ place(goal.belief), goal.belief.riskSensitive(goal.theta) });
  for (const StaticObstacle& obstacle : scene.static_obstacles)
    obstacles_.push_back(
        { place(obstacle.belief), obstacle.belief.amplitude(), obstacle.belief.cumulants(obstacle.gamma) });
}

void SceneWorld::Place::draw(phri_core::Random& random)
{
  CostVector normals(mean.size());
  for (double& normal : normals)
    normal = random.normal();
  centre = mean + root.lazyProduct(normals);
}

double SceneWorld::Place::square(const Eigen::Vector4d& y) const
{
  const CostVector d = y.head(centre.size()) - centre;
  return d.dot(weight.lazyProduct(d));
}

void SceneWorld::draw(phri_core::Random random)
{
  for (Goal& goal : goals_)
    goal.draw(random);
  for (Obstacle& obstacle : obstacles_)
    obstacle.draw(random);
}

double SceneWorld::excess(const Eigen::Ref<const Eigen::VectorXd>& z, bool running, double* squares) const
{
  const PlantState robot = z.head(robot_->stateSize());
  const Eigen::Vector4d y = robot_->motion(robot);
  for (const Moving& obstacle : moving_)
  {
    const PlantState x = z.segment(obstacle.offset, obstacle.plant->stateSize());
    const Eigen::Vector2d d = (y - obstacle.plant->motion(x)).head<2>();
    *squares = std::min(*squares, d.dot(obstacle.weight * d));
    ++squares;
  }
  double sum = 0.0;
  for (const Goal& goal : goals_)
    sum += 0.5 * goal.square(y) - goal.closed_form.value(y.head(goal.centre.size()));
  for (const Obstacle& obstacle : obstacles_)
  {
    const double square = obstacle.square(y);
    *squares = std::min(*squares, square);
    ++squares;
    if (running)
      sum += obstacle.amplitude * std::exp(-0.5 * square) - value(obstacle.closed_form, y.head<2>());
  }
  return running ? dt_ * sum : sum;
}
}  // namespace detail
}  // namespace phri_control
