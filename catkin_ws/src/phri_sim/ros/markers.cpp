#include "markers.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <cstdio>

#include "trial_messages.hpp"

namespace phri_sim
{
namespace
{
using visualization_msgs::Marker;
using visualization_msgs::MarkerArray;

struct Color
{
  float r, g, b, a = 1.0f;
};
constexpr Color kObject{ 0.15f, 0.15f, 0.18f }, kStart{ 0.18f, 0.62f, 0.31f }, kGoal{ 0.80f, 0.13f, 0.13f },
    kObstacle{ 0.45f, 0.47f, 0.52f }, kTrail{ 0.35f, 0.38f, 0.45f, 0.8f }, kHuman{ 0.12f, 0.42f, 0.80f },
    kAssistance{ 0.90f, 0.45f, 0.05f }, kEnvironment{ 0.75f, 0.12f, 0.20f }, kPrediction{ 0.55f, 0.25f, 0.70f },
    kText{ 0.15f, 0.15f, 0.18f }, kPath{ 0.55f, 0.60f, 0.66f }, kDot{ 0.0f, 0.0f, 0.0f };

constexpr double kDotRadius = 0.0045;  // [m]
constexpr double kMetresPerNewton = 0.002;
constexpr double kShown = 0.2;           // [N] smaller forces are not drawn
constexpr double kChiSquared95 = 5.991;  // 2 degrees of freedom
constexpr int kEllipsePoints = 48;
constexpr int kEllipseEvery = 5;                      // elements of a prediction between ellipses
constexpr double kTextHeight = 0.0085;                // [m]
constexpr double kLegendY = -0.163, kTitleY = 0.163;  // [m] below and above the maze
constexpr double kLine = 0.014;                       // [m]

Marker marker(const std::string& name, int id, int type, const Color& color, const ros::Time& stamp)
{
  Marker m;
  m.header.frame_id = kFrame;
  m.header.stamp = stamp;
  m.ns = name;
  m.id = id;
  m.type = type;
  m.color.r = color.r;
  m.color.g = color.g;
  m.color.b = color.b;
  m.color.a = color.a;
  m.pose.orientation.w = 1.0;
  return m;
}

Marker disc(const std::string& name, int id, const Color& color, const ros::Time& stamp, const Eigen::Vector2d& x,
            double radius, double z)
{
  Marker m = marker(name, id, Marker::CYLINDER, color, stamp);
  m.pose.position = point(x, z);
  m.scale.x = m.scale.y = 2.0 * radius;
  m.scale.z = 0.0005;
  return m;
}

Marker text(int id, const Color& color, const ros::Time& stamp, const Eigen::Vector2d& x, const std::string& words)
{
  Marker m = marker("text", id, Marker::TEXT_VIEW_FACING, color, stamp);
  m.pose.position = point(x, 0.03);
  m.scale.z = kTextHeight;
  m.text = words;
  return m;
}

Marker arrow(const std::string& name, const Color& color, const ros::Time& stamp, const Eigen::Vector2d& from,
             const Eigen::Vector2d& force, double z)
{
  Marker m = marker(name, 0, Marker::ARROW, color, stamp);
  if (force.norm() < kShown)
  {
    m.action = Marker::DELETE;
    return m;
  }
  m.points = { point(from, z), point(from + kMetresPerNewton * force, z) };
  m.scale.x = 0.0022;
  m.scale.y = 0.006;
  m.scale.z = std::min(0.008, 0.5 * kMetresPerNewton * force.norm());
  return m;
}

/// The rim of the 95 % region; nothing visible where the covariance is not positive definite.
Marker ellipse(int id, const ros::Time& stamp, const phri_core::Gaussian& belief, double z)
{
  Marker m = marker("prediction", id, Marker::LINE_STRIP, kPrediction, stamp);
  m.scale.x = 0.0008;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(belief.covariance.topLeftCorner<2, 2>().eval());
  const Eigen::Vector2d radii = (kChiSquared95 * solver.eigenvalues()).cwiseMax(0.0).cwiseSqrt();
  for (int k = 0; k <= kEllipsePoints; ++k)
  {
    const double angle = 2.0 * M_PI * k / kEllipsePoints;
    const Eigen::Vector2d on_circle(radii(0) * std::cos(angle), radii(1) * std::sin(angle));
    m.points.push_back(point(belief.mean.head<2>() + solver.eigenvectors() * on_circle, z));
  }
  return m;
}

std::string forceLine(const char* name, double newton)
{
  char line[64];
  std::snprintf(line, sizeof(line), "%s  %4.1f N", name, newton);
  return line;
}

void addForces(const phri_control::TickRecord& record, const ros::Time& stamp, MarkerArray& out)
{
  const Eigen::Vector2d x = record.position;
  out.markers.push_back(arrow("environment force", kEnvironment, stamp, x, record.environment_wrench, 0.012));
  out.markers.push_back(arrow("human force", kHuman, stamp, x, record.human_wrench, 0.015));
  out.markers.push_back(arrow("assistance force", kAssistance, stamp, x, record.assistance_wrench, 0.018));
  out.markers.push_back(text(1, kHuman, stamp, { -0.098, kLegendY }, forceLine("human", record.human_wrench.norm())));
  out.markers.push_back(
      text(2, kAssistance, stamp, { 0.002, kLegendY }, forceLine("assistance", record.assistance_wrench.norm())));
  out.markers.push_back(text(3, kEnvironment, stamp, { 0.103, kLegendY },
                             forceLine("walls, obstacles", record.environment_wrench.norm())));
}

void addPrediction(const phri_core::Prediction& prediction, const ros::Time& stamp, MarkerArray& out)
{
  const std::size_t count = prediction.desired_state.size();
  for (std::size_t k = 0; k < count; k += kEllipseEvery)
    out.markers.push_back(ellipse(int(k), stamp, prediction.desired_state[k], 0.006));
  char line[80];
  std::snprintf(line, sizeof(line), "prediction: mean and 95 %% regions up to %.1f s ahead",
                prediction.dt * double(count > 0 ? count - 1 : 0));
  out.markers.push_back(text(4, kPrediction, stamp, { 0.0, kLegendY - kLine }, line));
}
}  // namespace

geometry_msgs::Point point(const Eigen::Vector2d& x, double z)
{
  geometry_msgs::Point p;
  p.x = x(0);
  p.y = x(1);
  p.z = z;
  return p;
}

MarkerArray markers(const Scene& scene, const LivePicture& picture, const ros::Time& stamp)
{
  const phri_control::TickRecord& record = *picture.record;
  MarkerArray out;
  if (!scene.path.empty())
  {
    Marker path = marker("path", 0, Marker::LINE_STRIP, kPath, stamp);
    path.scale.x = 0.0016;
    for (const Eigen::Vector2d& x : scene.path)
      path.points.push_back(point(x, 0.0015));
    out.markers.push_back(path);
  }
  if (picture.dot)
    out.markers.push_back(disc("dot", 0, kDot, stamp, *picture.dot, kDotRadius, 0.011));
  out.markers.push_back(disc("start", 0, kStart, stamp, scene.start, scene.goal_radius, 0.001));
  out.markers.push_back(disc("goal", 0, kGoal, stamp, scene.goal, scene.goal_radius, 0.001));
  out.markers.push_back(disc("object", 0, kObject, stamp, record.position, scene.object_radius, 0.010));
  for (std::size_t i = 0; i < picture.obstacles->size(); ++i)
  {
    const MovingObstacle& obstacle = (*picture.obstacles)[i];
    Marker box = marker("obstacles", int(i), Marker::CUBE, kObstacle, stamp);
    box.pose.position = point(obstacle.position(record.time_ns * 1e-9), 0.002);
    box.scale.x = 2.0 * obstacle.half_size(0);
    box.scale.y = 2.0 * obstacle.half_size(1);
    box.scale.z = 0.002;
    out.markers.push_back(box);
  }
  Marker trail = marker("trail", 0, Marker::LINE_STRIP, kTrail, stamp);
  trail.scale.x = 0.0012;
  for (const Eigen::Vector2d& x : *picture.trail)
    trail.points.push_back(point(x, 0.003));
  if (trail.points.size() < 2)
    trail.action = Marker::DELETE;
  out.markers.push_back(trail);
  if (picture.prediction)
    addPrediction(*picture.prediction, stamp, out);
  addForces(record, stamp, out);
  char line[160];
  std::snprintf(line, sizeof(line), "%s     %5.1f s     %s", picture.title.c_str(), record.time_ns * 1e-9,
                phri_core::stateName(record.state));
  out.markers.push_back(text(0, kText, stamp, { 0.0, kTitleY }, line));
  return out;
}

nav_msgs::Path predictedPath(const phri_core::Prediction& prediction, const ros::Time& stamp)
{
  nav_msgs::Path path;
  path.header.frame_id = kFrame;
  path.header.stamp = stamp;
  for (std::size_t k = 0; k < prediction.desired_state.size(); ++k)
  {
    geometry_msgs::PoseStamped pose;
    pose.header = path.header;
    pose.header.stamp += ros::Duration(double(k) * prediction.dt);
    pose.pose.position = point(prediction.desired_state[k].mean.head<2>(), 0.008);
    pose.pose.orientation.w = 1.0;
    path.poses.push_back(pose);
  }
  return path;
}

nav_msgs::OccupancyGrid occupancyGrid(const Scene& scene, const ros::Time& stamp)
{
  nav_msgs::OccupancyGrid grid;
  const double resolution = scene.walls.resolution();
  grid.header.frame_id = kFrame;
  grid.header.stamp = grid.info.map_load_time = stamp;
  grid.info.resolution = float(resolution);
  grid.info.width = scene.image.width;
  grid.info.height = scene.image.height;
  // the field has one pixel of wall around the picture
  grid.info.origin.position.x = scene.walls.origin()(0) + resolution;
  grid.info.origin.position.y = scene.walls.origin()(1) + resolution;
  grid.info.origin.orientation.w = 1.0;
  grid.data.resize(scene.image.pixels.size());
  for (int row = 0; row < scene.image.height; ++row)
    for (int column = 0; column < scene.image.width; ++column)
    {
      const double darkness = (255 - scene.image.pixels[row * scene.image.width + column]) / 255.0;
      grid.data[(scene.image.height - 1 - row) * scene.image.width + column] = darkness > scene.occupied ? 100 : 0;
    }
  return grid;
}
}  // namespace phri_sim
