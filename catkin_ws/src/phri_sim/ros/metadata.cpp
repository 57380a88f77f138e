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
  phri_core::ParameterTable sensors;
  addParameters(sensors, experiment.sensors);
  addTable(parameters, "robot/", sensors);
  parameters["robot/admittance/mass"] = pair(experiment.loop.mass);
  parameters["robot/admittance/damping"] = pair(experiment.loop.damping);
  parameters["robot/loop/replan_blend"] = experiment.loop.replan_blend;
  addTable(parameters, "safety/", phri_core::parameterTable(experiment.loop.safety));
  addTable(parameters, "assistance/", phri_control::parameterTable(experiment.assistance));
  addTable(parameters, "participants/", experiment.population.table());
  return parameters;
}

/// A recording may be one of a simulated person: what is not known to be a person counts as simulated.
bool simulated(const std::string& human)
{
  return human == "simulated" || human == "replay";
}

/// As in a table without ROS (phri_sim.run_block).
void addPath(json& attributes, const Experiment& experiment, const TrialSpec& spec)
{
  if (!experiment.scene->path.empty())
  {
    attributes["path"] = json::array();
    for (const Eigen::Vector2d& x : experiment.scene->path)
      attributes["path"].push_back(pair(x));
    attributes["pace"] = experiment.pace;
  }
  if (!experiment.assistance_off.empty())
    attributes["assistance_off"] = !experiment.assists(spec.trial);
}

json obstacles(const Scene& scene)
{
  json boxes = json::array();
  for (const MovingObstacle& obstacle : scene.obstacles)
    boxes.push_back({ { "center", pair(obstacle.center) },
                      { "half_size", pair(obstacle.half_size) },
                      { "amplitude", obstacle.amplitude } });
  return boxes;
}
}  // namespace

std::string metadata(const NodeSetup& setup, const TrialSpec& spec, bool completed, int failed_plans,
                     const std::vector<Change>& changes)
{
  const Experiment& experiment = *setup.experiment;
  const Scene& scene = *experiment.scene;
  const char* revision = std::getenv("PHRI_GIT_REVISION");
  json attributes = {
    { "experiment", experiment.name },
    { "scene", scene.name },
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
    { "start", pair(scene.start) },
    { "goal", pair(scene.goal) },
    { "git_revision", revision && *revision ? revision : "unknown" },
    { "units", "SI: m, s, kg, N, J; wrenches are exerted BY the named agent ON the object, in frame maze" },
    { "parameters", parametersInForce(setup) },
  };
  if (std::isfinite(scene.turning_x))
    attributes["turning_point_x"] = scene.turning_x;
  attributes["changes"] = json::array();
  for (const Change& change : changes)
    attributes["changes"].push_back({ { "t", change.t }, { "what", change.what } });
  addPath(attributes, experiment, spec);
  attributes["obstacles"] = obstacles(scene);
  return attributes.dump();
}
}  // namespace phri_sim
