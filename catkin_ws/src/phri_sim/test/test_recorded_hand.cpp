#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "phri_core/testing.hpp"
#include "phri_sim/recorded_hand.hpp"
#include "phri_sim/trial.hpp"

using namespace phri_sim;
using Eigen::Vector2d;
using phri_control::TickRecord;
using Mode = RecordedHand::Mode;

namespace
{
constexpr double kDt = 0.001;  // [s]

std::shared_ptr<const Experiment> maze()
{
  static const auto experiment = std::make_shared<const Experiment>(loadExperiment("maze_assistance"));
  return experiment;
}

std::shared_ptr<const Recording> recordingOf(const TrialLog& log)
{
  auto recording = std::make_shared<Recording>();
  for (const TickRecord& tick : log.ticks)
  {
    recording->positions.push_back(tick.position);
    recording->forces.push_back(tick.human_wrench);
  }
  return recording;
}

/// Like runTrial, with a hand of ours, for at most `ticks`.
std::vector<TickRecord> runWith(const TrialSpec& spec, std::unique_ptr<Hand> hand, phri_core::BehaviorModel* model,
                                std::size_t ticks)
{
  Trial trial(maze(), spec, std::move(hand));
  std::vector<TickRecord> records;
  if (model)
    model->reset();
  while (!trial.finished() && records.size() < ticks)
  {
    trial.step();
    records.push_back(trial.record());
    if (!model || !trial.planDue())
      continue;
    model->observe(trial.observation());
    trial.plan(model->predict(maze()->model.horizon, maze()->model.dt));
  }
  return records;
}

void expectIdentical(const std::vector<TickRecord>& a, const std::vector<TickRecord>& b)
{
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t k = 0; k < a.size(); ++k)
  {
    ASSERT_EQ(a[k].position, b[k].position) << k;
    ASSERT_EQ(a[k].velocity, b[k].velocity) << k;
    ASSERT_EQ(a[k].human_wrench, b[k].human_wrench) << k;
    ASSERT_EQ(a[k].assistance_wrench, b[k].assistance_wrench) << k;
    ASSERT_EQ(a[k].tank, b[k].tank) << k;
  }
}
}  // namespace

TEST(RecordedHand, RepeatsATrialBitForBit)
{
  const TrialSpec spec = trialSpec(3, "none", 1, 3, 0, 7);
  const TrialLog log = runTrial(maze(), spec, nullptr);
  auto hand = std::make_unique<RecordedHand>(recordingOf(log), Mode::kForce, SpringSettings(), kDt);
  expectIdentical(log.ticks, runWith(spec, std::move(hand), nullptr, log.ticks.size()));
}

TEST(RecordedHand, RepeatsAnAssistedTrialBitForBit)
{
  const Block block{
    1, "mahalanobis", 7, { trialSpec(1, "mahalanobis", 1, 2, 0, 7), trialSpec(1, "mahalanobis", 2, 2, 1, 7) }
  };
  const std::vector<TrialLog> logs = runBlock(maze(), block);
  double assistance = 0.0;
  for (const TickRecord& tick : logs[1].ticks)
    assistance = std::max(assistance, tick.assistance_wrench.norm());
  ASSERT_GT(assistance, 1.0) << "else this is the test above";
  auto hand = std::make_unique<RecordedHand>(recordingOf(logs[1]), Mode::kForce, SpringSettings(), kDt);
  const auto model = learn(maze()->model, { logs[0].demonstration });
  expectIdentical(logs[1].ticks, runWith(block.trials[1], std::move(hand), model.get(), logs[1].ticks.size()));
}

TEST(RecordedHand, LetsGoAtTheEndOfTheRecording)
{
  auto recording = std::make_shared<Recording>();
  recording->positions.assign(200, Vector2d(0, 0));
  recording->forces.assign(200, Vector2d(5, 0));
  RecordedHand force(recording, Mode::kForce, SpringSettings(), kDt);
  for (int k = 0; k < 200; ++k)
    ASSERT_EQ(force.act({}).force, Vector2d(5, 0));
  const HandForce after = force.act({});
  EXPECT_EQ(after.force, Vector2d(0, 0));
  EXPECT_TRUE(after.sensed) << "the simulated sensor's bias must not come in";
  EXPECT_EQ(after.sequence, 201u);
  EXPECT_EQ(force.act({}).sequence, 202u) << "the readings go on: a hand that lets go is no fault";

  RecordedHand motion(recording, Mode::kMotion, SpringSettings(), kDt);
  HandleState away;
  const int last = 200 + int((RecordedHand::kLinger + Spring::kFade) / kDt);
  for (int k = 0; k < last + 100; ++k)
  {
    if (k == 1)
      away.position = Vector2d(0.01, 0);
    const double size = motion.act(away).force.norm();
    if (k > 150 && k < 1100)
    {
      ASSERT_GT(size, 1.0) << k;
    }
    if (k > last)
    {
      ASSERT_EQ(size, 0.0) << k;
    }
  }
}

TEST(RecordedHand, MotionFollowsTheRecordedPathUnderAnotherController)
{
  // the recorded person drove the object alone; now a spring drives it along her path. The spring's target is 2 tau
  // late and the mass needs its force: it must stay within what F_max / K (the reach) and that delay explain
  const TrialSpec spec = trialSpec(3, "none", 1, 3, 0, 7);
  const TrialLog log = runTrial(maze(), spec, nullptr);
  ASSERT_TRUE(log.completed);
  const SpringSettings spring;
  auto hand = std::make_unique<RecordedHand>(recordingOf(log), Mode::kMotion, spring, kDt);
  TrialSpec other = spec;
  other.controller = "mahalanobis";
  const std::vector<TickRecord> again = runWith(other, std::move(hand), nullptr, log.ticks.size() + 2000);
  double speed = 0.0, farthest = 0.0;
  for (const TickRecord& tick : log.ticks)
    speed = std::max(speed, tick.velocity.norm());
  for (std::size_t k = 0; k < std::min(again.size(), log.ticks.size()); ++k)
    farthest = std::max(farthest, (again[k].position - log.ticks[k].position).norm());
  RecordProperty("farthest_mm", std::to_string(1e3 * farthest));
  EXPECT_LT(farthest, spring.force_max / spring.stiffness + 2.0 * spring.smoothing * speed);
  const Vector2d end = again.back().position;
  EXPECT_LT((end - maze()->scene->goal).norm(), maze()->scene->goal_radius + 1e-3);
}

TEST(RecordedHand, RefusesABadRecording)
{
  const auto hand = [](const Recording& recording) {
    return RecordedHand(std::make_shared<const Recording>(recording), Mode::kForce, SpringSettings(), kDt);
  };
  EXPECT_THROW(hand({}), std::invalid_argument);
  EXPECT_THROW(hand({ { Vector2d(0, 0) }, {} }), std::invalid_argument);
  Recording bad{ { 5, Vector2d(0, 0) }, { 5, Vector2d(0, 0) } };
  EXPECT_NO_THROW(hand(bad));
  bad.forces[3].x() = std::nan("");
  try
  {
    hand(bad);
    FAIL() << "a NaN was taken";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_NE(std::string(error.what()).find("tick 3"), std::string::npos) << error.what();
  }
}

TEST(RecordedHand, AllocatesNothingInTheTick)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations cannot be counted under AddressSanitizer";
  auto recording = std::make_shared<Recording>();
  recording->positions.assign(500, Vector2d(0, 0));
  recording->forces.assign(500, Vector2d(5, 0));
  RecordedHand force(recording, Mode::kForce, SpringSettings(), kDt);
  RecordedHand motion(recording, Mode::kMotion, SpringSettings(), kDt);
  const long count = phri_core::testing::countAllocations([&] {
    for (int k = 0; k < 2000; ++k)
    {
      force.act({});
      motion.act({});
    }
  });
  EXPECT_EQ(count, 0);
}
