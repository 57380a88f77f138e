// Joint transport in lockstep: one walk from the start to the car, and what the robot makes of it.
#include <gtest/gtest.h>

#include <cmath>

#include "phri_core/testing.hpp"
#include "phri_sim/trial.hpp"

using namespace phri_sim;

namespace
{
constexpr double kTick = 0.001;
const std::string kWay = "left_of_car";  // the shortest

std::shared_ptr<const Experiment> transport(Parameters overrides = {})
{
  if (overrides.find("routes") == overrides.end())
    overrides["routes"] = std::vector<std::string>{ kWay };
  return std::make_shared<const Experiment>(loadExperiment("transport", overrides));
}

TrialSpec spec(int trial = 1, const std::string& controller = "none")
{
  return trialSpec(0, controller, trial, 9, trial - 1, 7);
}

/// A whole trial without assistance, with what the stage knows of it.
struct Walk
{
  std::shared_ptr<const Experiment> experiment = transport();
  bool completed = false;
  double duration = 0.0, goal_distance = 0.0, least_passivity = 0.0;
  std::uint32_t limits = 0;
  bool faultless = true;
  Eigen::Vector3d given{ 0, 0, 0 }, felt{ 0, 0, 0 }, rendered{ 0, 0, 0 };  // impulses in the plane [Ns]
  std::vector<TransportSample> samples;
  std::vector<Eigen::VectorXd> states;  // of the loop

  Walk()
  {
    Trial trial(experiment, spec());
    const auto& stage = static_cast<const TransportStage&>(trial.stage());
    const phri_core::VectorDof& damping = experiment->loop.damping;
    while (!trial.finished())
    {
      trial.step();
      const auto& record = trial.record();
      const TransportSample sample = stage.sample();
      const double turned = sample.grasp.z() - record.position(2);
      const Eigen::Vector2d world =
          Eigen::Rotation2Dd(turned) * Eigen::Vector2d(record.human_wrench(0), record.human_wrench(1));
      given.head<2>() += kTick * stage.humanWrench().head<2>();
      felt.head<2>() += kTick * world;
      rendered += kTick * (record.human_wrench - damping.cwiseProduct(record.velocity));
      limits |= record.limits;
      faultless &= record.fault == phri_core::FaultCode::None;
      least_passivity = std::min(least_passivity, record.passivity);
      if (!trial.planDue())
        continue;
      samples.push_back(sample);
      states.push_back(trial.observation().state);
    }
    completed = trial.completed();
    duration = trial.time();
    goal_distance = (samples.back().far_grasp.head<2>() - stage.route().waypoints.back()).norm();
  }
};

const Walk& walk()
{
  static const Walk once;
  return once;
}
}  // namespace

TEST(Transport, PersonAndRobotArrive)
{
  EXPECT_TRUE(walk().completed);
  EXPECT_LT(walk().goal_distance, 0.15);  // [m] what counts as arrived, and the last samples' 20 ms
  EXPECT_TRUE(walk().faultless);
  EXPECT_EQ(walk().limits & phri_core::kAssistanceLimits, 0u);
}

TEST(Transport, SensorFeelsWhatThePersonGives)
{
  // from rest to rest the object's momentum does not change: the impulses are equal but for the sensor's drift (0.1
  // N/min standard deviation and axis) and what the object swings when the trial ends
  const double slack = 0.3 * walk().duration;  // [Ns] of 11 N on average
  EXPECT_NEAR(walk().felt.x(), walk().given.x(), slack);
  EXPECT_NEAR(walk().felt.y(), walk().given.y(), slack);
  EXPECT_GT(walk().given.head<2>().norm(), 10.0 * slack);
}

TEST(Transport, LoopRendersMassAndDampingFromRestToRest)
{
  // M dv/dt = u_h - D v, so both impulses are equal; the rest of the motion that counts as arrived is 0.03 m/s
  const double momentum = walk().experiment->loop.mass(0) * 0.1;
  EXPECT_LT(walk().rendered.head<2>().norm(), momentum);
  EXPECT_GT(walk().least_passivity, -1e-3);  // [J]
}

TEST(Transport, DimensionsLeftOutOfTheObservationSayNothing)
{
  double lowest = 1e9, highest = -1e9, tilting = 0.0, turning = 0.0;
  for (const TransportSample& sample : walk().samples)
  {
    lowest = std::min(lowest, sample.observation(2));
    highest = std::max(highest, sample.observation(2));
    tilting = std::max(tilting, sample.observation.segment<2>(3).norm());
    turning = std::max(turning, std::abs(sample.observation(5)));
  }
  EXPECT_LT(highest - lowest, 0.01);  // [m]
  EXPECT_LT(tilting, 0.5 * turning);  // of the yaw rate
  EXPECT_GT(turning, 0.1);            // [rad/s]
}

TEST(Transport, ObservationIsThatOfTheLoop)
{
  ASSERT_EQ(walk().samples.size(), walk().states.size());
  for (std::size_t k = 1; k < walk().samples.size(); ++k)
  {
    const TransportSample& sample = walk().samples[k];
    EXPECT_LT((sample.observation.head<2>() - walk().states[k].head<2>()).norm(), 1e-3);  // [m] a tick at 0.3 m/s
    // rigid grasp: the way between the two grasps is the bumper's
    EXPECT_NEAR((sample.far_grasp - sample.grasp).head<2>().norm(), walk().experiment->lab->grasp_distance, 0.005);
  }
}

TEST(Transport, OdometryDriftsOnlyWhereItSlips)
{
  const auto drift = [](const std::shared_ptr<const Experiment>& experiment) {
    Trial trial(experiment, spec());
    while (trial.time() < 20.0)
      trial.step();
    const TransportSample sample = static_cast<const TransportStage&>(trial.stage()).sample();
    return (sample.observation.head<2>() - sample.grasp.head<2>()).norm();
  };
  const Parameters exact{ { "override/robots/robot/slip", 0.0 }, { "override/robots/robot/heading_drift", 0.0 } };
  EXPECT_LT(drift(transport(exact)), 1e-4);  // [m] integration of 20 s by the midpoint rule
  EXPECT_GT(drift(transport()), 1e-3);
}

TEST(Transport, SameSpecIsTheSameTrial)
{
  Trial first(transport(), spec()), second(transport(), spec()), other(transport(), spec(2));
  for (int k = 0; k < 3000; ++k)
    for (Trial* trial : { &first, &second, &other })
      trial->step();
  EXPECT_EQ(first.record().position, second.record().position);
  EXPECT_EQ(first.record().human_wrench, second.record().human_wrench);
  EXPECT_NE(first.record().human_wrench, other.record().human_wrench);
}

TEST(Transport, AssistanceDoesNotDependOnWhereOdometryBelievesToBe)
{
  const auto assisted = [](double shift) {
    const std::shared_ptr<const Experiment> experiment = transport();
    Trial trial(experiment, spec(1, "pd"));
    while (trial.time() < 2.0)
      trial.step();
    phri_core::Prediction prediction;
    prediction.t0 = trial.observation().t;
    prediction.dt = experiment->model.dt;
    phri_core::Gaussian state{ Eigen::VectorXd::Zero(6), Eigen::MatrixXd::Identity(6, 6) };
    state.mean.head<2>().setConstant(shift);
    state.mean(4) = 0.2;  // [m/s] to the left
    prediction.desired_state.assign(16, state);
    trial.plan(prediction);
    for (int k = 0; k < 100; ++k)
      trial.step();
    return phri_core::VectorDof(trial.record().assistance_wrench);
  };
  const phri_core::VectorDof here = assisted(0.0), there = assisted(3.0);
  EXPECT_EQ(here, there);
  EXPECT_GT(here(1), 0.5);  // [N]
}

TEST(Transport, TickDoesNotAllocate)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations are not counted here";
  Trial trial(transport(), spec());
  for (int k = 0; k < 100; ++k)
    trial.step();
  const long allocated = phri_core::testing::countAllocations([&] {
    for (int k = 0; k < 2000; ++k)
      trial.step();
  });
  EXPECT_EQ(allocated, 0);
}

TEST(Transport, WhatWasCarriedTwiceIsPredictedTheThirdTime)
{
  Block block{ 0, "pd", 7, {} };
  for (int trial = 1; trial <= 3; ++trial)
    block.trials.push_back(spec(trial, "pd"));
  const std::vector<TrialLog> logs = runBlock(transport(), block);
  EXPECT_TRUE(logs.front().predictions.empty() || logs.front().predictions.size() < logs.back().predictions.size());
  EXPECT_GT(logs.back().primitives, 1);
  EXPECT_EQ(std::size_t(logs.back().primitives), logs.back().primitive_outputs.size());
  EXPECT_GT(logs.back().predictions.size(), std::size_t(logs.back().plans) / 2);
  for (const TrialLog& log : logs)
  {
    EXPECT_TRUE(log.completed);
    EXPECT_EQ(log.demonstration.cols(), 9);
    EXPECT_EQ(std::size_t(log.demonstration.rows()), log.transport.size());
  }
  for (const Eigen::MatrixXd& output : logs.back().primitive_outputs)
    EXPECT_TRUE(output.allFinite() && output.cols() == 9);
}

TEST(Transport, UnknownWayIsAnErrorThatNamesIt)
{
  try
  {
    transport({ { "routes", std::vector<std::string>{ "over_the_car" } } });
    FAIL();
  }
  catch (const phri_core::ParameterError& error)
  {
    EXPECT_NE(std::string(error.what()).find("over_the_car"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("right_of_trolley"), std::string::npos);
  }
}
