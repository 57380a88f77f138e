#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "phri_sim/trial.hpp"

using namespace phri_sim;
using phri_control::TickRecord;
using phri_core::FaultCode;
using phri_core::LoopState;

namespace
{
constexpr double kThesisForce = 12.92, kThesisPower = 0.61;  // [N], [W]: table 5.1, condition (a)
constexpr double kBand = 0.25;                               // acceptance band of the calibration

std::shared_ptr<const Experiment> maze()
{
  static const auto experiment = std::make_shared<const Experiment>(loadExperiment("maze_assistance"));
  return experiment;
}

Block block(const std::string& controller, int participant, int trials)
{
  Block b{ participant, controller, 7, {} };
  for (int k = 1; k <= trials; ++k)
    b.trials.push_back(trialSpec(participant, controller, k, 3, k - 1, 7));
  return b;
}

double meanForce(const TrialLog& log)
{
  double sum = 0;
  for (const TickRecord& r : log.ticks)
    sum += r.human_wrench.norm();
  return sum / log.ticks.size();
}
}  // namespace

// The population is calibrated on condition (a) alone and then left alone: force and power within 25 % of the thesis'
// 19 people, spread between people 10 to 25 %.
TEST(Trial, PopulationIsWithinTheCalibrationBands)
{
  double force = 0, square = 0, power = 0;
  const int people = 19;
  for (int p = 0; p < people; ++p)
  {
    const TrialLog log = runTrial(maze(), trialSpec(p, "none", 3, 3, 2, 7), nullptr);
    EXPECT_TRUE(log.completed) << "participant " << p;
    double work = 0;
    for (const TickRecord& r : log.ticks)
      work += r.human_wrench.dot(r.velocity);
    power += work / log.ticks.size() / people;
    force += meanForce(log) / people;
    square += std::pow(meanForce(log), 2) / people;
    for (const TickRecord& r : log.ticks)
      ASSERT_GE(r.passivity, -1e-6);
  }
  EXPECT_NEAR(force, kThesisForce, kBand * kThesisForce);
  EXPECT_NEAR(power, kThesisPower, kBand * kThesisPower);
  const double spread = std::sqrt(square - force * force) / force;
  EXPECT_GT(spread, 0.10);
  EXPECT_LT(spread, 0.25);
}

TEST(Trial, IsBitIdenticalForOneSeed)
{
  const auto first = runBlock(maze(), block("mahalanobis", 1, 2)),
             second = runBlock(maze(), block("mahalanobis", 1, 2));
  ASSERT_EQ(first.size(), second.size());
  for (std::size_t k = 0; k < first.size(); ++k)
  {
    ASSERT_EQ(first[k].ticks.size(), second[k].ticks.size());
    for (std::size_t i = 0; i < first[k].ticks.size(); ++i)
    {
      ASSERT_EQ(first[k].ticks[i].position, second[k].ticks[i].position) << i;
      ASSERT_EQ(first[k].ticks[i].assistance_wrench, second[k].ticks[i].assistance_wrench) << i;
    }
  }
}

// Until the robot acts, a person with the same seed does the same under every controller.
TEST(Trial, FirstTrialIsTheSameUnderEveryController)
{
  const TrialLog a = runTrial(maze(), trialSpec(0, "none", 1, 3, 0, 7), nullptr);
  const TrialLog b = runTrial(maze(), trialSpec(0, "lqr", 1, 3, 0, 7), nullptr);
  ASSERT_EQ(a.ticks.size(), b.ticks.size());
  EXPECT_EQ(a.ticks.back().position, b.ticks.back().position);
  EXPECT_EQ(a.demonstration, b.demonstration);
}

// What the robot learned from one trial lets it help in the next: it pushes, the person pushes less than without help
// in the very same trial (same seed, same practice), and both reach the goal.
TEST(Trial, AssistanceFromALearnedModelLowersTheHumanForce)
{
  for (const char* controller : { "lqr", "mahalanobis", "pd" })
  {
    const auto helped = runBlock(maze(), block(controller, 0, 3));
    const auto alone = runBlock(maze(), block("none", 0, 3));
    EXPECT_TRUE(helped.back().completed) << controller;
    EXPECT_GT(helped.back().predictions.size(), 100u);
    EXPECT_EQ(helped.front().predictions.size(), 0u) << "predicted before anything was learned";
    EXPECT_LT(meanForce(helped.back()), meanForce(alone.back())) << controller;
  }
}

// Without a model, or when predictions stop, the robot is a passive follower: the last policy lives to its horizon's
// end, fades within 0.2 s, and the trial goes on.
TEST(Trial, MissingPredictionsEndInPassive)
{
  const auto model =
      learn(maze()->model, { runTrial(maze(), trialSpec(0, "none", 1, 3, 0, 7), nullptr).demonstration });
  Trial trial(maze(), trialSpec(0, "mahalanobis", 2, 3, 1, 7));
  bool was_active = false;
  for (int k = 0; k < 6000; ++k)
  {
    trial.step();
    if (!trial.planDue())
      continue;
    model->observe(trial.observation());
    if (k < 5000)
      trial.plan(model->predict(maze()->model.horizon, maze()->model.dt));
    was_active |= trial.record().state == LoopState::Active;
    const bool faded = k < 5000 + 450 || trial.record().assistance_wrench.norm() == 0.0;
    EXPECT_TRUE(faded) << k;
  }
  EXPECT_TRUE(was_active);
  EXPECT_EQ(trial.record().state, LoopState::Passive);
}

// With a gate that nothing passes the robot predicts and never acts.
TEST(Trial, PredictionsBeyondTheGateAreIgnored)
{
  const auto shut = std::make_shared<const Experiment>(loadExperiment("maze_assistance", { { "model/gate", 1e-9 } }));
  const auto logs = runBlock(shut, block("lqr", 0, 2)), open = runBlock(maze(), block("lqr", 0, 2));
  const auto acted = [](const TrialLog& log) {
    return std::count_if(log.ticks.begin(), log.ticks.end(),
                         [](const TickRecord& r) { return r.requested_wrench.norm() > 0.0; });
  };
  EXPECT_GT(logs.back().predictions.size(), 100u);
  EXPECT_EQ(acted(logs.back()), 0);
  EXPECT_GT(acted(open.back()), 1000);
}

TEST(LoadExperiment, ListsTheErrorsOfAllFilesAtOnce)
{
  const Parameters bad = { { "sceen", std::string("maze") },
                           { "model/states", 2.5 },
                           { "assistance/q_scale", std::nan("") },
                           { "override/robots/admittance/mas", std::vector<double>{ 1, 1 } },
                           { "override/safety/limits/assistance_force", 500.0 } };
  try
  {
    loadExperiment("maze_assistance", bad);
    FAIL() << "accepted";
  }
  catch (const phri_core::ParameterError& error)
  {
    const std::string text = error.what();
    EXPECT_EQ(error.errors().size(), 5u) << text;
    for (const char* part :
         { "sceen", "did you mean scene?", "model/states = 2.5", "q_scale = nan", "did you mean admittance/mass?",
           "limits/assistance_force = 500 N: expected a number from 0 to 60" })
      EXPECT_NE(text.find(part), std::string::npos) << part << " missing in\n" << text;
  }
}
