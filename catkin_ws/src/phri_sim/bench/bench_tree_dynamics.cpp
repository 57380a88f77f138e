// Time of the multibody engine for a dual-arm robot: omni base, two arms of seven joints, four fingers (21 degrees of
// freedom), armature, damping, dry friction, a bumper held in the right hand.
#include <benchmark/benchmark.h>

#include "../test/tree_cases.hpp"

namespace
{
constexpr double kStep = 1e-3;

struct Robot
{
  phri_sim::TreeDynamics dynamics{ tree_cases::dualArmWithBumper() };
  Eigen::VectorXd tau = Eigen::VectorXd::Zero(dynamics.dofs());

  Robot()
  {
    phri_core::Random random(1);
    dynamics.setState(tree_cases::randomVector(random, dynamics.dofs(), 0.5),
                      tree_cases::randomVector(random, dynamics.dofs(), 0.2));
    // a posture servo, so that the robot stays where it is however long the bench runs
    for (int i = 0; i < dynamics.dofs(); ++i)
      dynamics.drives()[std::size_t(i)] = { 2000.0, 200.0, dynamics.q()[i], 0.0 };
  }
};

void kinematics(benchmark::State& state)
{
  Robot robot;
  const Eigen::VectorXd q = robot.dynamics.q(), qd = robot.dynamics.qd();
  for (auto _ : state)
    robot.dynamics.setState(q, qd);
}
BENCHMARK(kinematics);

void inverseDynamics(benchmark::State& state)
{
  Robot robot;
  const Eigen::VectorXd qdd = robot.tau;
  for (auto _ : state)
    robot.dynamics.inverseDynamics(qdd, robot.tau);
}
BENCHMARK(inverseDynamics);

void prepare(benchmark::State& state)
{
  Robot robot;
  for (auto _ : state)
    robot.dynamics.prepare(kStep);
}
BENCHMARK(prepare);

void forwardDynamics(benchmark::State& state)
{
  Robot robot;
  robot.dynamics.prepare(kStep);
  for (auto _ : state)
    robot.dynamics.forwardDynamics(robot.tau);
}
BENCHMARK(forwardDynamics);

void stepEuler(benchmark::State& state)
{
  Robot robot;
  for (auto _ : state)
    robot.dynamics.stepEuler(robot.tau, kStep);
}
BENCHMARK(stepEuler);

void stepRungeKutta(benchmark::State& state)
{
  Robot robot;
  for (auto& drive : robot.dynamics.drives())
    drive = {};
  for (auto _ : state)
    robot.dynamics.stepRungeKutta(robot.tau, 0.0);  // stays in place, at the full cost
}
BENCHMARK(stepRungeKutta);

/// A whole step: human's wrench, both wrists' F/T, and so many contact rows on the tool (solved by one sweep's
/// stand-in: impulses that stop the rows one by one are the contact world's business, here they are zero).
void stepWithRows(benchmark::State& state)
{
  Robot robot;
  phri_sim::TreeDynamics& dynamics = robot.dynamics;
  const phri_sim::TreeModel& model = dynamics.model();
  const int tool = model.link("lwr_left_tool0"), held = model.link("bumper");
  const int left = model.fixedJoint("lwr_left_ft_joint"), right = model.fixedJoint("lwr_right_ft_joint");
  const int rows = int(state.range(0));
  const Eigen::VectorXd impulses = Eigen::VectorXd::Zero(rows);
  for (auto _ : state)
  {
    dynamics.clearWrenches();
    const Eigen::Isometry3d pose = dynamics.linkPose(held);
    dynamics.addForce(held, pose * Eigen::Vector3d(1.1, 0, 0), { 1.0, 0.0, 0.0 });
    dynamics.prepare(kStep);
    dynamics.forwardDynamics(robot.tau);
    const Eigen::Vector3d point = dynamics.linkPose(tool).translation();
    for (int i = 0; i < rows; ++i)
      dynamics.addRow(tool, -1, point, Eigen::Vector3d::Unit(i % 3));
    benchmark::DoNotOptimize(dynamics.delassus().data());
    dynamics.applyImpulses(impulses);
    benchmark::DoNotOptimize(dynamics.jointWrench(left));
    benchmark::DoNotOptimize(dynamics.jointWrench(right));
    dynamics.integrate();
  }
}
BENCHMARK(stepWithRows)->Arg(0)->Arg(6)->Arg(12)->Arg(24);
}  // namespace

BENCHMARK_MAIN();
