#include "phri_control/planar_scene.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
[[noreturn]] void fail(const PlanarScene& scene, const std::string& text)
{
  throw std::invalid_argument("scene \"" + scene.name + "\": " + text);
}

void requireBody(const PlanarScene& scene, const std::string& name, const std::shared_ptr<const Plant>& plant,
                 const Eigen::VectorXd& start, const Eigen::MatrixXd& diffusion)
{
  const std::string field = "scene \"" + scene.name + "\": " + name;
  if (!plant)
    fail(scene, name + " has no plant");
  phri_core::requireShape(field + ": start", start, plant->stateSize(), 1);
  phri_core::requireFinite(field + ": start", start);
  if (diffusion.cols() == 0)
    return;
  phri_core::requireShape(field + ": diffusion", diffusion, plant->stateSize(), diffusion.cols());
  phri_core::requireFinite(field + ": diffusion", diffusion);
}
}  // namespace

Eigen::Index PlanarScene::stateSize() const
{
  return offset(movers.size());
}

Eigen::Index PlanarScene::offset(std::size_t mover) const
{
  Eigen::Index sum = robot->stateSize();
  for (std::size_t i = 0; i < mover; ++i)
    sum += movers.at(i).plant->stateSize();
  return sum;
}

Eigen::VectorXd PlanarScene::start() const
{
  Eigen::VectorXd z(stateSize());
  z.head(robot_start.size()) = robot_start;
  for (std::size_t i = 0; i < movers.size(); ++i)
    z.segment(offset(i), movers[i].start.size()) = movers[i].start;
  return z;
}

void validate(const PlanarScene& scene)
{
  const std::string prefix = "scene \"" + scene.name + "\": ";
  requireBody(scene, "robot", scene.robot, scene.robot_start, scene.robot_diffusion);
  for (const Mover& mover : scene.movers)
    requireBody(scene, "mover \"" + mover.name + "\"", mover.plant, mover.start, mover.diffusion);
  const auto require_mover = [&](const std::string& name, std::size_t mover) {
    if (mover >= scene.movers.size())
      fail(scene,
           name + " is mover " + std::to_string(mover) + ", expected below " + std::to_string(scene.movers.size()));
  };
  for (const TrackedGoal& goal : scene.goals)
  {
    require_mover("a goal", goal.mover);
    phri_core::requireCovariance(prefix + "weight of a goal", goal.weight);
  }
  for (const AvoidedObstacle& obstacle : scene.obstacles)
  {
    require_mover("an obstacle", obstacle.mover);
    phri_core::requireCovariance(prefix + "weight of an obstacle", obstacle.weight);
    if (!std::isfinite(obstacle.amplitude))
      fail(scene, "amplitude of an obstacle = " + std::to_string(obstacle.amplitude) + ", expected a finite number");
  }
  for (const StaticGoal& goal : scene.static_goals)
    if (goal.belief.mean().size() != 2 && goal.belief.mean().size() != 4)
      fail(scene, "a static goal has size " + std::to_string(goal.belief.mean().size()) +
                      ", expected 2 (position) or 4 (position and velocity)");
  for (const StaticObstacle& obstacle : scene.static_obstacles)
    if (obstacle.belief.mean().size() != 2)
      fail(scene, "a static obstacle has size " + std::to_string(obstacle.belief.mean().size()) + ", expected 2");
  phri_core::requireCovariance(prefix + "control_weight", scene.control_weight);
  if (!(scene.control_weight.llt().info() == Eigen::Success))
    fail(scene, "control_weight is singular, expected positive definite");
  if (!(scene.dt > 0.0) || !std::isfinite(scene.dt))
    fail(scene, "dt = " + std::to_string(scene.dt) + " s, expected above 0");
  if (scene.horizon < 1)
    fail(scene, "horizon = " + std::to_string(scene.horizon) + ", expected at least 1");
}

double obstacleSpread(const PlanarScene& scene, const AvoidedObstacle& obstacle)
{
  const Mover& mover = scene.movers.at(obstacle.mover);
  const Plant& plant = *mover.plant;
  const Eigen::Index n = plant.stateSize();
  PlantState x = mover.start, next;
  PlantMatrix A, covariance = PlantMatrix::Zero(n, n), step_covariance = PlantMatrix::Zero(n, n);
  PlantInput B;
  if (mover.diffusion.cols() > 0)
    step_covariance = scene.dt * mover.diffusion * mover.diffusion.transpose();
  for (int k = 0; k < scene.horizon; ++k)
  {
    linearise(plant, scene.integrator, scene.dt, x, Eigen::Vector2d::Zero(), A, B);
    step(plant, scene.integrator, scene.dt, x, Eigen::Vector2d::Zero(), next);
    covariance = (A * covariance * A.transpose() + step_covariance).eval();
    x = next;
  }
  MotionJacobian jacobian;
  plant.motionJacobian(x, jacobian);
  const double variance = (jacobian.topRows<2>() * covariance * jacobian.topRows<2>().transpose()).trace();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(obstacle.weight, Eigen::EigenvaluesOnly);
  return std::sqrt(variance * std::max(0.0, eigen.eigenvalues().maxCoeff()));
}
}  // namespace phri_control
