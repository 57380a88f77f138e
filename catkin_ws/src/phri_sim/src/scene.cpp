#include "phri_sim/scene.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "phri_core/random.hpp"
#include "phri_sim/configuration.hpp"

namespace phri_sim
{
namespace
{
/// The keys of a scene file, as they stand in it.
struct SceneFile
{
  std::string image;
  double resolution = 0.0005, occupied = 0.65, free = 0.2;
  int negate = 0;
  std::vector<double> origin{ -0.15, -0.15, 0.0 }, start{ 0.0, 0.0 }, goal{ 0.0, 0.0 };
  double goal_radius = 0.006, object_radius = 0.003, turning_x = -0.04, stiffness = 2e4, damping = 1500.0;
  std::vector<double> obstacle_x, obstacle_y, obstacle_size{ 0.02, 0.01 }, period{ 3.0, 5.0 };
  double amplitude = 0.05;

  phri_core::ParameterTable table()
  {
    phri_core::ParameterTable t;
    t.text("image", &image, {}, "picture, relative to this file; dark is wall")
        .number("resolution", &resolution, "m/pixel", 1e-5, 1.0, "size of a pixel")
        .list("origin", &origin, 3, "m, m, rad", -100.0, 100.0, "lower left corner and yaw (which must be 0)")
        .number("occupied_thresh", &occupied, "-", 0.0, 1.0, "darkness above which a pixel is wall")
        .number("free_thresh", &free, "-", 0.0, 1.0, "kept for ROS; not used")
        .integer("negate", &negate, "", 0, 1, "1: bright is wall")
        .list("start", &start, 2, "m", -100.0, 100.0, "where the object starts")
        .list("goal", &goal, 2, "m", -100.0, 100.0, "where it shall go")
        .number("goal_radius", &goal_radius, "m", 1e-4, 1.0, "how near counts as reached")
        .number("object_radius", &object_radius, "m", 1e-4, 1.0, "radius of the object")
        .number("turning_x", &turning_x, "m", -100.0, 100.0, "left of it the subtask narrow channel begins")
        .number("wall/stiffness", &stiffness, "N/m", 10.0, 5e4, "of walls and obstacles")
        .number("wall/damping", &damping, "Ns/m", 0.0, 1e4, "of walls and obstacles, while approaching")
        .list("obstacles/x", &obstacle_x, 0, "m", -100.0, 100.0, "centres of the moving boxes")
        .list("obstacles/y", &obstacle_y, 0, "m", -100.0, 100.0, "centres of the moving boxes")
        .list("obstacles/half_size", &obstacle_size, 2, "m", 1e-3, 10.0, "half width and height of the moving boxes")
        .number("obstacles/amplitude", &amplitude, "m", 0.0, 10.0, "of their motion along x")
        .list("obstacles/period", &period, 2, "s", 0.1, 1000.0, "range that the period is drawn from, per trial");
    return t;
  }
};
}  // namespace

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

Scene loadScene(const std::string& name_or_path)
{
  const std::string path = findConfiguration("scenes", name_or_path);
  SceneFile file;
  file.table().assign(path, loadYaml(path));
  std::vector<std::string> errors;
  if (file.image.empty())
    errors.push_back("image: missing; expected the name of a picture");
  if (file.obstacle_x.size() != file.obstacle_y.size())
    errors.push_back("obstacles/x has " + std::to_string(file.obstacle_x.size()) + " elements, obstacles/y " +
                     std::to_string(file.obstacle_y.size()) + ": expected equally many");
  if (file.origin[2] != 0.0)
    errors.push_back("origin: yaw " + std::to_string(file.origin[2]) + " rad: expected 0");
  if (!errors.empty())
    throw phri_core::ParameterError(path, errors);

  const std::string image_path = (std::filesystem::path(path).parent_path() / file.image).string();
  GrayImage image = readImage(image_path);
  if (file.negate)
    for (std::uint8_t& pixel : image.pixels)
      pixel = static_cast<std::uint8_t>(255 - pixel);
  const Eigen::Vector2d origin(file.origin[0], file.origin[1]);
  Scene scene{ std::filesystem::path(path).stem().string(), image_path, image,
               DistanceField(image, file.resolution, origin, file.occupied) };
  scene.occupied = file.occupied;
  scene.start = Eigen::Vector2d(file.start[0], file.start[1]);
  scene.goal = Eigen::Vector2d(file.goal[0], file.goal[1]);
  scene.goal_radius = file.goal_radius;
  scene.object_radius = file.object_radius;
  scene.turning_x = file.turning_x;
  scene.stiffness = file.stiffness;
  scene.damping = file.damping;
  scene.period_low = std::min(file.period[0], file.period[1]);
  scene.period_high = std::max(file.period[0], file.period[1]);
  for (std::size_t i = 0; i < file.obstacle_x.size(); ++i)
  {
    MovingObstacle obstacle;
    obstacle.center = { file.obstacle_x[i], file.obstacle_y[i] };
    obstacle.half_size = { file.obstacle_size[0], file.obstacle_size[1] };
    obstacle.amplitude = file.amplitude;
    scene.obstacles.push_back(obstacle);
  }
  for (const auto& [what, x] : { std::pair("start", scene.start), std::pair("goal", scene.goal) })
    if (scene.clearance(x) <= 0.0)
      throw std::invalid_argument(path + ": the " + what + " (" + std::to_string(x(0)) + ", " + std::to_string(x(1)) +
                                  ") m lies " + std::to_string(-scene.clearance(x)) +
                                  " m inside a wall or too near to one: expected a clearance above 0");
  return scene;
}
}  // namespace phri_sim
