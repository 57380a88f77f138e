// Time per step of 1 ms of the dual LWR 4+: alone; carrying the bumper with a human's spring at its far end and wrist
// wrenches read; and, further, the bumper pressed on a wall. Every joint is held by a drive.
// "points" counts contact points, "sweeps" those of the contact solver.
#include <benchmark/benchmark.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>

#include "phri_sim/configuration.hpp"
#include "phri_sim/world.hpp"

namespace
{
using namespace phri_sim;
using Eigen::Vector3d;
using Eigen::VectorXd;

enum class Scenario
{
  Robot,
  Bumper,
  Contact
};

VectorXd posture(const TreeModel& model)
{
  const YAML::Node zeros = YAML::LoadFile(shareFolder() + "/urdf/postures.yaml")["zeros"];
  VectorXd q = VectorXd::Zero(model.dofs());
  for (int i = 0; i < model.dofs(); ++i)
  {
    const YAML::Node value = zeros[model.joints()[std::size_t(i)].description.name];
    if (value)
      q(i) = value.as<double>();
  }
  return q;
}

World makeWorld(Scenario scenario)
{
  std::vector<TreePart> parts = { { loadRobot("dual_lwr"), "", Eigen::Isometry3d::Identity() } };
  WorldOptions options;
  options.sensors = { "lwr_left_ft_joint", "lwr_right_ft_joint" };
  if (scenario == Scenario::Robot)
    return World(parts, {}, options);
  parts.push_back({ loadRobot("bumper"), "lwr_left_gripper_tcp", Eigen::Isometry3d::Identity() });
  for (const char* side : { "left", "right" })  // jaws that hold it
  {
    for (const LinkDescription& link : parts[1].description.links)
      options.apart.emplace_back(std::string("lwr_left_gripper_") + side + "_finger_link", link.name);
  }
  if (scenario == Scenario::Bumper)
    return World(parts, {}, options);
  // a wall just below the lowest corner of the bumper, 1 mm inside
  World look(parts, {}, options);
  look.setState(posture(look.model()), VectorXd::Zero(look.model().dofs()));
  Vector3d lowest(0, 0, 1e9);
  for (const LinkDescription& description : parts[1].description.links)
  {
    const Eigen::Isometry3d pose = look.linkPose(look.model().link(description.name));
    for (const ShapeDescription& shape : description.collision)
    {
      for (int corner = 0; corner < 8; ++corner)
      {
        const Vector3d sign(corner & 1 ? 0.5 : -0.5, corner & 2 ? 0.5 : -0.5, corner & 4 ? 0.5 : -0.5);
        const Vector3d size = shape.kind == ShapeKind::Box        ? shape.size
                              : shape.kind == ShapeKind::Cylinder ? Vector3d(0, 0, shape.size.y())
                                                                  : Vector3d::Zero();
        const Vector3d point = pose * shape.origin * Vector3d(sign.cwiseProduct(size)) -
                               Vector3d(0, 0, shape.kind == ShapeKind::Box ? 0.0 : shape.size.x());
        if (point.z() < lowest.z())
          lowest = point;
      }
    }
  }
  StaticShape wall{ "wall", {}, { 2e4, 0.3, 0.5 } };
  wall.shape.size = { 0.2, 0.2, 0.1 };
  wall.shape.origin.translation() = lowest + Vector3d(0, 0, 1e-3 - 0.05);
  return World(parts, { wall }, options);
}

void step(benchmark::State& state, Scenario scenario)
{
  World world = makeWorld(scenario);
  const int dofs = world.model().dofs();
  const VectorXd q = posture(world.model()), zero = VectorXd::Zero(dofs);
  world.setState(q, zero);
  VectorXd tau(dofs);
  world.dynamics().inverseDynamics(zero, tau);
  for (int i = 0; i < dofs; ++i)
    world.dynamics().drives()[std::size_t(i)] = { 1e3, 100.0, q(i), 0.0 };
  const bool bumper = scenario != Scenario::Robot;
  const int held = bumper ? int(world.model().links().size()) - 1 : 0;
  const Vector3d grasp(0.55, 0, 0);  // of the human, from the bumper's origin, whichever its long axis
  const Vector3d anchor = world.linkPose(held) * grasp;
  double touching = 0.0, sweeps = 0.0;
  const auto tick = [&] {
    if (bumper)
    {
      const Vector3d point = world.linkPose(held) * grasp;
      world.addForce(held, point, 500.0 * (anchor - point) - 40.0 * world.dynamics().pointVelocity(held, point));
    }
    world.step(1e-3, tau);
    benchmark::DoNotOptimize(world.sensorWrench(0).sum());
  };
  for (int i = 0; i < 1000; ++i)
    tick();
  for (auto _ : state)
  {
    tick();
    touching += double(world.contacts().size());
    sweeps += world.sweeps();
  }
  state.counters["dofs"] = dofs;
  state.counters["points"] = touching / double(state.iterations());
  state.counters["sweeps"] = sweeps / double(state.iterations());
}

BENCHMARK_CAPTURE(step, robot, Scenario::Robot)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(step, robot_bumper_human, Scenario::Bumper)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(step, robot_bumper_human_contact, Scenario::Contact)->Unit(benchmark::kMicrosecond);
}  // namespace

BENCHMARK_MAIN();
