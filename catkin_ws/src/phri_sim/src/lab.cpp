#include "phri_sim/lab.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <sstream>
#include <stdexcept>

#include "phri_sim/configuration.hpp"

namespace phri_sim
{
namespace
{
using Eigen::Vector2d;
constexpr double kPerson = 0.2;     // [m] a route keeps at least this far from obstacles
constexpr double kNear = 0.02;      // [m] of what shall be the same place
constexpr double kParallel = 0.02;  // [rad] of what shall be the same direction

template <typename... Parts>
std::string text(const Parts&... parts)
{
  std::ostringstream out;
  (out << ... << parts);
  return out.str();
}

/// The second part of all keys `<kind>/<name>/...`.
std::set<std::string> namesOf(const Parameters& all, const std::string& kind)
{
  std::set<std::string> names;
  for (const auto& [key, value] : underPrefix(all, kind))
    if (const std::size_t slash = key.find('/'); slash != std::string::npos && slash > 0)
      names.insert(key.substr(0, slash));
  return names;
}

struct BoxKeys
{
  std::string name;
  std::vector<double> center, size;
  double yaw = 0.0, height = 1.0;
};

struct RouteKeys
{
  std::string name;
  std::vector<double> x, y;
  std::vector<std::string> passes;
};

/// The keys of a lab file, as they stand in it.
struct LabFile
{
  std::vector<double> size{ 10.0, 10.0 }, start, goal;
  Lab lab;
  std::vector<BoxKeys> boxes;
  std::vector<RouteKeys> routes;

  phri_core::ParameterTable table()
  {
    phri_core::ParameterTable t;
    t.list("size", &size, 2, "m", 1.0, 100.0, "of the room, from the origin")
        .number("turning_radius", &lab.turning_radius, "m", 0.1, 10.0, "tightest of the far grasp's path")
        .number("object/length", &lab.object_length, "m", 0.1, 10.0, "of what is carried")
        .number("object/grasp_distance", &lab.grasp_distance, "m", 0.1, 10.0, "from the robot's grasp to the person's")
        .number("object/mass", &lab.object_mass, "kg", 0.0, 100.0, "of what is carried")
        .list("start/position", &start, 2, "m", -100.0, 100.0, "far grasp")
        .number("start/yaw", &lab.start_yaw, "rad", -3.15, 3.15,
                "of the object, from the robot's grasp to the person's")
        .list("goal/position", &goal, 2, "m", -100.0, 100.0, "middle of the object")
        .number("goal/axis", &lab.goal_axis, "rad", -3.15, 3.15, "of the object, either way round");
    for (BoxKeys& box : boxes)
    {
      const std::string at = "obstacles/" + box.name + '/';
      t.list(at + "center", &box.center, 2, "m", -100.0, 100.0, "in the plane")
          .list(at + "size", &box.size, 2, "m", 0.01, 100.0, "along the box's x and y")
          .number(at + "yaw", &box.yaw, "rad", -3.15, 3.15, "of the box")
          .number(at + "height", &box.height, "m", 0.01, 10.0, "above the floor");
    }
    for (RouteKeys& route : routes)
    {
      const std::string at = "routes/" + route.name + '/';
      t.list(at + "x", &route.x, 0, "m", -100.0, 100.0, "waypoints of the far grasp")
          .list(at + "y", &route.y, 0, "m", -100.0, 100.0, "waypoints of the far grasp")
          .names(at + "passes", &route.passes, {}, "what it passes, in words");
    }
    return t;
  }
};

/// Obstacles and routes, as far as they make sense.
void build(LabFile& file, std::vector<std::string>& errors)
{
  Lab& lab = file.lab;
  lab.size = { file.size[0], file.size[1] };
  for (const BoxKeys& box : file.boxes)
  {
    if (box.center.empty() || box.size.empty())
      errors.push_back(text("obstacles/", box.name, ": ", box.center.empty() ? "center" : "size", " is missing"));
    else
      lab.boxes.push_back(
          { box.name, { box.center[0], box.center[1] }, { box.size[0], box.size[1] }, box.yaw, box.height });
  }
  for (const RouteKeys& keys : file.routes)
  {
    if (keys.x.size() != keys.y.size())
      errors.push_back(text("routes/", keys.name, ": x has ", keys.x.size(), " elements, y ", keys.y.size(),
                            ": expected equally many"));
    else if (keys.x.size() < 2)
      errors.push_back(text("routes/", keys.name, ": ", keys.x.size(), " waypoints: expected at least 2"));
    else
    {
      LabRoute route;
      route.name = keys.name;
      route.passes = keys.passes;
      for (std::size_t k = 0; k < keys.x.size(); ++k)
        route.waypoints.emplace_back(keys.x[k], keys.y[k]);
      const Vector2d last = route.waypoints.back() - route.waypoints[route.waypoints.size() - 2];
      route.goal_yaw = std::atan2(last(1), last(0));
      lab.routes.push_back(std::move(route));
    }
  }
  if (file.routes.empty())
    errors.push_back("routes: there is none; expected at least one");
  if (file.start.empty())
    errors.push_back("start/position: missing");
  else
    lab.start = { file.start[0], file.start[1] };
  if (file.goal.empty())
    errors.push_back("goal/position: missing");
  else
    lab.goal = { file.goal[0], file.goal[1] };
}

void checkRoute(const Lab& lab, const LabRoute& route, std::vector<std::string>& errors)
{
  const Vector2d first = route.waypoints.front(), last = route.waypoints.back();
  const std::string where = "routes/" + route.name + ": ";
  if ((first - lab.start).norm() > kNear)
    errors.push_back(
        text(where, "begins at [", first.transpose(), "] m: expected start/position [", lab.start.transpose(), "]"));
  const Vector2d grasp =
      lab.goal + 0.5 * lab.grasp_distance * Vector2d(std::cos(route.goal_yaw), std::sin(route.goal_yaw));
  if (std::abs(std::sin(route.goal_yaw - lab.goal_axis)) > kParallel)
    errors.push_back(text(where, "its last leg heads for ", route.goal_yaw, " rad: expected goal/axis ", lab.goal_axis,
                          ", either way round"));
  else if ((last - grasp).norm() > kNear)
    errors.push_back(text(where, "ends at [", last.transpose(), "] m: expected [", grasp.transpose(),
                          "], half a grasp distance beyond goal/position"));
  try
  {
    const WalkingPath path = lab.path(route);
    double nearest = kPerson, at = 0.0;
    for (double s = 0.0; s <= path.length(); s += 0.01)
      if (const double gap = lab.clearance(path.at(s).position); gap < nearest)
      {
        nearest = gap;
        at = s;
      }
    if (nearest < kPerson)
      errors.push_back(text(where, "at [", path.at(at).position.transpose(), "] m it is ", nearest,
                            " m from an obstacle or the room's edge: expected at least ", kPerson));
  }
  catch (const std::invalid_argument& error)
  {
    errors.push_back(where + error.what());
  }
}
}  // namespace

double LabBox::distance(const Vector2d& x) const noexcept
{
  const double c = std::cos(yaw), s = std::sin(yaw);
  const Vector2d d = x - center, outside = Vector2d(c * d(0) + s * d(1), c * d(1) - s * d(0)).cwiseAbs() - 0.5 * size;
  return outside.maxCoeff() > 0.0 ? outside.cwiseMax(0.0).norm() : outside.maxCoeff();
}

double Lab::clearance(const Vector2d& x) const noexcept
{
  double nearest = std::min({ x(0), x(1), size(0) - x(0), size(1) - x(1) });
  for (const LabBox& box : boxes)
    nearest = std::min(nearest, box.distance(x));
  return nearest;
}

const LabRoute& Lab::route(const std::string& wanted) const
{
  std::string known;
  for (const LabRoute& candidate : routes)
  {
    if (candidate.name == wanted)
      return candidate;
    known += (known.empty() ? "" : ", ") + candidate.name;
  }
  throw std::invalid_argument("lab " + name + ": no route \"" + wanted + "\"; known: " + known);
}

Lab loadLab(const std::string& name_or_path)
{
  const std::string path = findConfiguration("scenes", name_or_path);
  const Parameters given = loadYaml(path);
  LabFile file;
  for (const std::string& name : namesOf(given, "obstacles"))
    file.boxes.push_back({ name, {}, {} });
  for (const std::string& name : namesOf(given, "routes"))
    file.routes.push_back({ name, {}, {}, {} });
  std::vector<std::string> errors;
  file.table().assign(path, given);
  build(file, errors);
  if (errors.empty())
    for (const LabRoute& route : file.lab.routes)
      checkRoute(file.lab, route, errors);
  if (!errors.empty())
    throw phri_core::ParameterError(path, errors);
  file.lab.name = std::filesystem::path(path).stem().string();
  return file.lab;
}
}  // namespace phri_sim
