#include "lab_markers.hpp"

#include <cmath>

namespace phri_sim
{
namespace
{
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr Color kSkirting{ 0.45f, 0.48f, 0.52f }, kWall{ 0.85f, 0.86f, 0.88f, 0.25f }, kOther{ 0.60f, 0.62f, 0.65f },
    kBody{ 0.16f, 0.50f, 0.42f }, kRoof{ 0.98f, 0.98f, 0.95f }, kGlass{ 0.20f, 0.25f, 0.30f },
    kTyre{ 0.10f, 0.10f, 0.11f }, kHub{ 0.75f, 0.76f, 0.78f }, kLamp{ 0.98f, 0.95f, 0.75f },
    kShelf{ 0.80f, 0.62f, 0.40f }, kFrameColor{ 0.45f, 0.48f, 0.52f }, kRoute{ 0.60f, 0.64f, 0.70f, 0.55f },
    kStart{ 0.18f, 0.62f, 0.31f, 0.8f }, kGoal{ 0.80f, 0.13f, 0.13f, 0.8f }, kText{ 0.20f, 0.22f, 0.25f };

/// A car of the sixties that fills the box; its front is the box's +x.
void addCar(const LabBox& box, MarkerShapes& shapes)
{
  const Eigen::Isometry3d at = upright({ box.center(0), box.center(1), 0.0 }, box.yaw);
  const double l = box.size(0), w = box.size(1), h = box.height;
  const auto block = [&](const Color& color, const Vector3d& middle, const Vector3d& size) {
    Eigen::Isometry3d pose = at;
    pose.translation() = at * middle;
    shapes.box("car", color, pose, size);
  };
  block(kBody, { 0.0, 0.0, 0.37 * h }, { l, 0.96 * w, 0.34 * h });
  block(kBody, { -0.03 * l, 0.0, 0.50 * h }, { 0.86 * l, 0.92 * w, 0.12 * h });
  block(kGlass, { -0.09 * l, 0.0, 0.74 * h }, { 0.56 * l, 0.82 * w, 0.36 * h });
  block(kRoof, { -0.09 * l, 0.0, 0.96 * h }, { 0.50 * l, 0.80 * w, 0.08 * h });
  for (const double x : { -0.36, -0.08, 0.18 })
    block(kBody, { x * l, 0.0, 0.74 * h }, { 0.03 * l, 0.84 * w, 0.36 * h });
  for (const double side : { -1.0, 1.0 })
  {
    for (const double x : { -0.33, 0.33 })
    {
      const Vector3d hub(x * l, 0.42 * side * w, 0.19 * h);
      shapes.rod("car", kTyre, at * hub, at * (hub + Vector3d(0.0, 0.08 * side * w, 0.0)), 0.19 * h);
      shapes.rod("car", kHub, at * hub, at * (hub + Vector3d(0.0, 0.085 * side * w, 0.0)), 0.10 * h);
    }
    shapes.sphere("car", kLamp, at * Vector3d(0.49 * l, 0.33 * side * w, 0.42 * h), Vector3d::Constant(0.13 * h));
  }
}

void addTrolley(const LabBox& box, MarkerShapes& shapes)
{
  const Eigen::Isometry3d at = upright({ box.center(0), box.center(1), 0.0 }, box.yaw);
  const double l = box.size(0), w = box.size(1), h = box.height;
  for (const double z : { 0.24, 0.60, 0.97 })
  {
    Eigen::Isometry3d pose = at;
    pose.translation() = at * Vector3d(0.0, 0.0, z * h);
    shapes.box("trolley", kShelf, pose, { l, w, 0.05 * h });
  }
  for (const double x : { -0.47, 0.47 })
    for (const double y : { -0.45, 0.45 })
    {
      shapes.rod("trolley", kFrameColor, at * Vector3d(x * l, y * w, 0.12 * h), at * Vector3d(x * l, y * w, h), 0.02);
      shapes.sphere("trolley", kTyre, at * Vector3d(x * l, y * w, 0.07 * h), Vector3d::Constant(0.14 * h));
    }
}

/// Where the object is to stand, on the floor.
void addPlace(const std::string& name, const Color& color, const Vector2d& a, const Vector2d& b, MarkerShapes& shapes)
{
  const Vector2d middle = 0.5 * (a + b), along = b - a;
  shapes.box("places", color, upright({ middle(0), middle(1), 0.004 }, std::atan2(along(1), along(0))),
             { along.norm() + 0.1, 0.12, 0.004 });
  shapes.text("places", kText, { middle(0), middle(1), 0.08 }, 0.18, name);
}
}  // namespace

visualization_msgs::MarkerArray labMarkers(const Lab& lab, const ros::Time& stamp)
{
  MarkerShapes shapes("world", stamp);
  const double length = lab.size(0), width = lab.size(1);
  const std::vector<Vector3d> edge = {
    { 0, 0, 0 }, { length, 0, 0 }, { length, width, 0 }, { 0, width, 0 }, { 0, 0, 0 }
  };
  shapes.line("room", kSkirting, edge, 0.05);
  for (const LabBox& box : lab.boxes)
  {
    if (box.name == "car")
      addCar(box, shapes);
    else if (box.name == "trolley")
      addTrolley(box, shapes);
    else
      shapes.box(box.name, box.name == "wall" ? kWall : kOther,
                 upright({ box.center(0), box.center(1), 0.5 * box.height }, box.yaw),
                 { box.size(0), box.size(1), box.height });
    shapes.text("names", kText, { box.center(0), box.center(1), box.height + 0.18 }, 0.18, box.name);
  }
  for (const LabRoute& route : lab.routes)
  {
    const WalkingPath path = lab.path(route);
    std::vector<Vector3d> points;
    for (double s = 0.0; s <= path.length(); s += 0.05)
      points.emplace_back(path.at(s).position(0), path.at(s).position(1), -0.005);
    shapes.line("routes", kRoute, points, 0.015);
  }
  const Vector2d held(std::cos(lab.start_yaw), std::sin(lab.start_yaw));
  const Vector2d wanted(std::cos(lab.goal_axis), std::sin(lab.goal_axis));
  addPlace("start", kStart, lab.start - lab.grasp_distance * held, lab.start, shapes);
  addPlace("goal", kGoal, lab.goal - 0.5 * lab.object_length * wanted, lab.goal + 0.5 * lab.object_length * wanted,
           shapes);
  visualization_msgs::MarkerArray out;
  shapes.moveInto(out);
  return out;
}
}  // namespace phri_sim
