// A path to follow without walls, an exemplary run along it, and trials in which the robot does not assist.
#include <gtest/gtest.h>

#include <fstream>

#include "phri_core/parameters.hpp"
#include "phri_sim/route.hpp"
#include "phri_sim/trial.hpp"
#include "pictures.hpp"

using namespace phri_sim;
using Eigen::Vector2d;
using pictures::temporary;

namespace
{
constexpr double kOnLine = 1e-4;    // [m] a spline through 32 points of a circle of 0.1 m leaves it by less
constexpr double kAtEnds = 3e-4;    // [m] and there by half of a piece's sagitta, which is 0.48 mm
constexpr double kRounding = 1e-9;  // of sums of about a thousand terms
constexpr double kNoise = 0.6;      // [N] bias and noise of the sensor, far below what a hand does
constexpr double kWander = 0.02;    // [m] people stray by 2 mm (trait wander), cut corners and are late

/// A circle of 0.1 m, counter-clockwise from (0, -0.1), `points` points and the first again.
std::string circle(int points, const std::string& keys = "")
{
  std::string x, y;
  for (int k = 0; k <= points; ++k)
  {
    const double angle = 2.0 * M_PI * (k % points) / points - M_PI / 2.0;
    x += (k ? ", " : "") + std::to_string(0.1 * std::cos(angle));
    y += (k ? ", " : "") + std::to_string(0.1 * std::sin(angle));
  }
  return temporary("circle.yaml", keys + "path:\n  x: [" + x + "]\n  y: [" + y + "]\n");
}

std::shared_ptr<const Experiment> flower(Parameters overrides = {})
{
  return std::make_shared<const Experiment>(loadExperiment("emerging_assistance", overrides));
}

std::string refusal(const std::function<void()>& act)
{
  return pictures::refusal<phri_core::ParameterError>(act);
}
}  // namespace

TEST(Path, RouteIsTheLineThroughThePoints)
{
  const Route route = planRoute(loadScene(circle(32)), 0.012);
  const std::size_t piece = route.points.size() / 32 + 2;  // the first and the last have a neighbour on one side only
  for (std::size_t k = 0; k < route.points.size(); ++k)
    EXPECT_NEAR(route.points[k].norm(), 0.1, k < piece || k + piece > route.points.size() ? kAtEnds : kOnLine);
  EXPECT_NEAR(route.length(), 0.2 * M_PI, 0.002);  // the route's step is 1 mm
  EXPECT_GT(route.tangents.front()(0), 0.99);      // counter-clockwise from below: to the right
  EXPECT_LT((route.points.front() - Vector2d(0.0, -0.1)).norm(), kOnLine);
}

TEST(Path, NoWallTouchesItAndAllOfItIsFree)
{
  const Scene scene = loadScene("flower");
  for (const Vector2d& x : scene.path)
    EXPECT_EQ(contactForce(scene, {}, x, { 0.0, 0.0 }, 0.0), Vector2d(0.0, 0.0));
  EXPECT_EQ(scene.start, scene.goal);  // a lap
}

TEST(Path, BadOnesAreNamed)
{
  EXPECT_NE(refusal([] {
              loadScene(temporary("a.yaml", "path: {x: [0, 0.1, 0.1], y: [0, 0.1]}\n"));
            }).find("path/x has 3 elements, path/y 2"),
            std::string::npos);
  EXPECT_NE(refusal([] {
              loadScene(temporary("b.yaml", "goal: [0, 0]\npath: {x: [0, 0.1], y: [0, 0.1]}\n"));
            }).find("expected neither, they are its ends"),
            std::string::npos);
  EXPECT_NE(pictures::refusal<PictureError>([] {
              loadScene(temporary("c.yaml", "path: {x: [0, 0.2], y: [0, 0.2]}\n"));
            }).find("the start"),
            0u);  // leaves the picture of 0.3 m: refused, whatever is named first
  EXPECT_NE(refusal([] {
              loadExperiment("maze_assistance", { { "pace", 32.0 } });
            }).find("scene without a path"),
            std::string::npos);
}

TEST(Pace, AllOfItInItsDurationAndUniformWhereNothingBends)
{
  const Route route = planRoute(loadScene("flower"), 0.012);
  const Pace pace(route, 32.0);
  EXPECT_EQ(pace.at(-1.0), 0.0);
  EXPECT_EQ(pace.at(0.0), 0.0);
  EXPECT_NEAR(pace.at(32.0), route.length(), kRounding);
  EXPECT_NEAR(pace.at(100.0), route.length(), kRounding);
  for (double t = 0.0; t < 32.0; t += 0.01)
    ASSERT_LT(pace.at(t), pace.at(t + 0.01));
  // the same run twice as slow is at the same places at twice the time
  const Pace slow(route, 64.0);
  for (double t = 0.0; t < 32.0; t += 0.5)
    EXPECT_NEAR(slow.at(2.0 * t), pace.at(t), kRounding);
  // a circle bends everywhere alike: away from its ends the pace is the mean, but for the run-up
  const Route ring = planRoute(loadScene(circle(32)), 0.012);
  const Pace even(ring, 20.0);
  const double speed = (even.at(15.0) - even.at(5.0)) / 10.0;
  EXPECT_NEAR(even.at(12.0) - even.at(8.0), 4.0 * speed, 0.01 * 4.0 * speed);
  // a millimetre at either end takes sqrt(10) times as long as one in the middle, so two of those are not enough
  EXPECT_LT(even.at(0.002 / speed), 0.001);
  EXPECT_GT(even.at(20.0 - 0.002 / speed), ring.length() - 0.001);
  EXPECT_THROW(Pace(ring, 0.0), std::invalid_argument);
  // what does not bend at all takes its time, too: half of a straight line half of it
  const Route straight =
      planRoute(loadScene(temporary("line.yaml", "path: {x: [-0.1, 0, 0.1], y: [0, 0, 0]}\n")), 0.012);
  EXPECT_NEAR(Pace(straight, 10.0).at(5.0), 0.5 * straight.length(), kRounding);
}

TEST(Flower, WhatTheExperimentSaysOfTheModelHoldsForTheLearner)
{
  const auto options = flower({ { "model/horizon", 0.25 },
                                { "model/reference", std::string("displacement") },
                                { "model/time", std::string("thesis") },
                                { "model/recognition", std::string("position") },
                                { "model/window", 17.0 },
                                { "model/states", 7.0 } })
                           ->model.emergingOptions();
  EXPECT_EQ(options.dof, 2);
  EXPECT_EQ(options.horizon, 0.25);
  EXPECT_EQ(options.reference, phri_learning::Reference::kDisplacement);
  EXPECT_EQ(options.time, phri_learning::timeEstimateNamed("thesis"));
  EXPECT_EQ(options.recognition, phri_learning::Recognition::kPosition);
  EXPECT_EQ(options.recogniser.window, 17);
  EXPECT_EQ(options.primitives.training.states, 7);
}

TEST(Flower, PersonFollowsThePathAndALapEndsOnlyAfterAllOfIt)
{
  const auto experiment = flower();
  const TrialSpec spec = trialSpec(0, "none", 1, 20, 0, 7);
  const TrialLog log = runTrial(experiment, spec, nullptr);
  ASSERT_TRUE(log.completed);
  const Route route = planRoute(*experiment->scene, 0.012);
  double s = 0.0;
  for (const auto& tick : log.ticks)
  {
    s = route.project(tick.position, s, 0.02);
    ASSERT_LT((route.position(s) - Vector2d(tick.position)).norm(), kWander);
  }
  EXPECT_GT(s, route.length() - 0.02);
}

TEST(Flower, PacedPersonTakesAsLongAsTheExemplaryRun)
{
  for (const double pace : { 28.0, 40.0 })
  {
    const TrialLog log = runTrial(flower({ { "pace", pace } }), trialSpec(1, "none", 1, 20, 0, 7), nullptr);
    ASSERT_TRUE(log.completed);
    EXPECT_NEAR(log.ticks.back().time_ns * 1e-9, pace, 1.0);  // the goal's radius is within reach a little earlier
  }
}

TEST(Flower, WithoutAssistanceTheRobotExertsNoForceButPredicts)
{
  // One person, five repetitions; the robot has learned by then.
  const auto experiment = flower({ { "assistance_off", std::vector<double>{ 5.0 } } });
  Block block{ 0, "pd", 7, {} };
  for (int trial = 1; trial <= 5; ++trial)
    block.trials.push_back(trialSpec(0, "pd", trial, 5, trial - 1, 7));
  const std::vector<TrialLog> logs = runBlock(experiment, block);
  const auto force = [](const TrialLog& log) {
    double sum = 0.0;
    for (const auto& tick : log.ticks)
      sum += tick.assistance_wrench.norm();
    return sum / double(log.ticks.size());
  };
  EXPECT_EQ(logs[0].primitives, 0);  // m = 3 members make a primitive
  EXPECT_TRUE(logs[0].predictions.empty());
  EXPECT_EQ(force(logs[0]), 0.0);
  EXPECT_GE(logs[3].primitives, 4);  // petals and centre
  EXPECT_GT(force(logs[3]), 0.5);
  EXPECT_GT(logs[4].predictions.size(), 500u);
  EXPECT_EQ(force(logs[4]), 0.0);
  // learning is deterministic
  const std::vector<TrialLog> again = runBlock(experiment, block);
  ASSERT_EQ(again[4].predictions.size(), logs[4].predictions.size());
  for (std::size_t k = 0; k < logs[4].predictions.size(); ++k)
    ASSERT_EQ(again[4].predictions[k].mean, logs[4].predictions[k].mean);
}

TEST(Flower, AloneTheRobotFinishesIfItIsAllowedTo)
{
  // In the sixth repetition the person lets go half-way.
  Block block{ 0, "pd", 7, {} };
  for (int trial = 1; trial <= 6; ++trial)
    block.trials.push_back(trialSpec(0, "pd", trial, 6, trial - 1, 7));
  for (const bool allowed : { true, false })
  {
    const auto experiment = flower({ { "let_go/trials", std::vector<double>{ 6.0 } },
                                     { "let_go/after", 10.0 },
                                     { "timeout", 60.0 },
                                     { "override/safety/autonomous_completion", allowed } });
    const TrialLog log = runBlock(experiment, block).back();
    EXPECT_EQ(log.completed, allowed);
    for (const auto& tick : log.ticks)
      if (tick.time_ns > 10'000'000'000)
      {
        ASSERT_LT(tick.human_wrench.norm(), kNoise);
      }
    const Route route = planRoute(*experiment->scene, 0.012);
    double s = 0.0;
    for (const auto& tick : log.ticks)
      s = route.project(tick.position, s, 0.02);
    if (allowed)
      EXPECT_GT(s, route.length() - 0.02);
    else
      EXPECT_LT(s, 0.9 * route.length());
  }
}
