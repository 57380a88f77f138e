#include "metadata.hpp"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

namespace phri_sim
{
namespace
{
using nlohmann::json;

json pair(const Eigen::Vector2d& x)
{
  return { x(0), x(1) };
}

json list(const phri_core::VectorDof& x)
{
  return std::vector<double>(x.data(), x.data() + x.size());
}

/// As text, the way the tables print them: what was in force, defaults included.
void addTable(json& parameters, const std::string& prefix, const phri_core::ParameterTable& table)
{
  for (const auto& entry : table.entries())
    parameters[prefix + entry.key] = entry.initial;
}

json parametersInForce(const NodeSetup& setup)
{
  Experiment experiment = *setup.experiment;
  json parameters;
  Parameters given = loadYaml(experiment.path);
  for (const auto& [key, value] : setup.overrides)
    given[key] = value;
  for (const auto& [key, value] : given)
    std::visit([&parameters, name = key](const auto& v) { parameters[name] = v; }, value);
  phri_core::ParameterTable robot;
  if (experiment.planar())
    addParameters(robot, experiment.sensors);
  else
  {
    addParameters(robot, experiment.robot);
    addParameters(robot, experiment.force_sensor);
  }
  addTable(parameters, "robot/", robot);
  parameters["robot/admittance/mass"] = list(experiment.loop.mass);
  parameters["robot/admittance/damping"] = list(experiment.loop.damping);
  parameters["robot/loop/replan_blend"] = experiment.loop.replan_blend;
  addTable(parameters, "safety/", phri_core::parameterTable(experiment.loop.safety));
  addTable(parameters, "assistance/", phri_control::parameterTable(experiment.assistance));
  addTable(parameters, "participants/",
           experiment.planar() ? experiment.population.table() : experiment.carriers.table());
  return parameters;
}

/// A recording may be one of a simulated person: what is not known to be a person counts as simulated.
bool simulated(const std::string& human)
{
  return human == "simulated" || human == "replay";
}

/// As in a table without ROS (phri_sim.run_block).
void addScene(json& attributes, const Experiment& experiment)
{
  const Scene& scene = *experiment.scene;
  attributes["scene"] = scene.name;
  attributes["start"] = pair(scene.start);
  attributes["goal"] = pair(scene.goal);
  attributes["units"] = "SI: m, s, kg, N, J; wrenches are exerted BY the named agent ON the object, in frame maze";
  if (std::isfinite(scene.turning_x))
    attributes["turning_point_x"] = scene.turning_x;
  if (!scene.path.empty())
  {
    attributes["path"] = json::array();
    for (const Eigen::Vector2d& x : scene.path)
      attributes["path"].push_back(pair(x));
    attributes["pace"] = experiment.pace;
  }
  json boxes = json::array();
  for (const MovingObstacle& obstacle : scene.obstacles)
    boxes.push_back({ { "center", pair(obstacle.center) },
                      { "half_size", pair(obstacle.half_size) },
                      { "amplitude", obstacle.amplitude } });
  attributes["obstacles"] = boxes;
}

/// The room, what was carried, and the way that the person took.
void addLab(json& attributes, const Experiment& experiment, const TrialSpec& spec)
{
  const Lab& lab = *experiment.lab;
  attributes["scene"] = lab.name;
  attributes["start"] = { lab.start(0), lab.start(1), lab.start_yaw };
  attributes["goal"] = { lab.goal(0), lab.goal(1), lab.goal_axis };
  attributes["units"] =
      "SI: m, rad, s, kg, N, Nm, J; wrenches are exerted BY the named agent ON the object, in and about "
      "the origin of frame grasp: at the robot's grasp, axes of odom; object_states are in odom";
  attributes["room"] = pair(lab.size);
  attributes["object"] = { { "length", lab.object_length },
                           { "grasp_distance", lab.grasp_distance },
                           { "mass", lab.object_mass } };
  const LabRoute& route = lab.route(experiment.routes[std::size_t(spec.trial - 1) % experiment.routes.size()]);
  json waypoints = json::array();
  for (const Eigen::Vector2d& x : route.waypoints)
    waypoints.push_back(pair(x));
  attributes["route"] = { { "name", route.name }, { "waypoints", waypoints }, { "passes", route.passes } };
  attributes["turning_radius"] = lab.turning_radius;
  json boxes = json::array();
  for (const LabBox& box : lab.boxes)
    boxes.push_back({ { "name", box.name },
                      { "center", pair(box.center) },
                      { "size", pair(box.size) },
                      { "yaw", box.yaw },
                      { "height", box.height } });
  attributes["obstacles"] = boxes;
  attributes["robot"] = { { "model", experiment.robot.model }, { "arm", experiment.robot.arm } };
}
}  // namespace

std::string metadata(const NodeSetup& setup, const TrialSpec& spec, bool completed, int failed_plans,
                     const std::vector<Change>& changes)
{
  const Experiment& experiment = *setup.experiment;
  const char* revision = std::getenv("PHRI_GIT_REVISION");
  json attributes = {
    { "experiment", experiment.name },
    { "task", experiment.task },
    { "participant", spec.participant },
    { "controller", spec.controller },
    { "trial", spec.trial },
    { "practice", spec.practice },
    { "evaluated", spec.evaluated && changes.empty() },  // a changed trial speaks for no controller
    { "seed", spec.study_seed },
    { "trial_seed", spec.seed },
    { "completed", completed },
    { "failed_plans", failed_plans },
    { "human", setup.settings.human },
    { "simulated_participants", simulated(setup.settings.human) },
    { "clock", setup.settings.clock },
    { "git_revision", revision && *revision ? revision : "unknown" },
    { "parameters", parametersInForce(setup) },
  };
  attributes["changes"] = json::array();
  for (const Change& change : changes)
    attributes["changes"].push_back({ { "t", change.t }, { "what", change.what } });
  if (!experiment.assistance_off.empty())
    attributes["assistance_off"] = !experiment.assists(spec.trial);
  experiment.planar() ? addScene(attributes, experiment) : addLab(attributes, experiment, spec);
  return attributes.dump();
}
}  // namespace phri_sim
