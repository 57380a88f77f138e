// The wrench faults of the fault matrix, rows 1 to 8, injected between the sensor and the loop of a running trial. What
// is measured stands as a property in the JUnit file, from where docs/faults.md has it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "phri_sim/trial.hpp"

using namespace phri_sim;
using phri_control::TickRecord;
using phri_core::FaultCode;
using phri_core::LoopState;
using phri_core::Measurement;

namespace
{
constexpr int kFrom = 3000;            // [ms] the fault begins
constexpr std::int64_t kMs = 1000000;  // [ns]
constexpr double kStopped = 0.01;      // [m/s]
constexpr double kSpikeStep = 5e-3;    // [m/s] bound of row 8
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
using Tamper = std::function<void(Measurement&, int ms)>;

std::shared_ptr<const Experiment> maze()
{
  static const auto experiment = std::make_shared<const Experiment>(loadExperiment("maze_assistance"));
  return experiment;
}

/// A trial under condition (a), with what `tamper` does to it from kFrom on. Everything stays finite, whatever it does.
struct Spoiled
{
  Trial trial{ maze(), trialSpec(0, "none", 1, 3, 0, 7) };
  int first_fault = -1, stopped = -1;  // [ms]
  double largest_speed_step = 0.0, speed_before = 0.0, largest_speed = 0.0, travel = 0.0;
  FaultCode fault = FaultCode::None;
  std::vector<Eigen::Vector2d> path;

  explicit Spoiled(Tamper tamper, int milliseconds = 4500)
  {
    trial.tamper = [tamper](Measurement& m, std::int64_t now) {
      if (now >= kFrom * kMs)
        tamper(m, int(now / kMs));
    };
    Eigen::Vector2d last(0, 0), origin(0, 0);
    for (int k = 0; k < milliseconds && !trial.finished(); ++k)
    {
      trial.step();
      const TickRecord& r = trial.record();
      EXPECT_TRUE(r.position.allFinite() && r.velocity.allFinite() && r.human_wrench.allFinite()) << k;
      path.push_back(r.position);
      const Eigen::Vector2d v = r.velocity;
      if (k > kFrom)
        largest_speed_step = std::max(largest_speed_step, (v - last).norm());
      largest_speed = std::max(largest_speed, v.norm());
      last = v;
      if (k == kFrom)
      {
        origin = r.position;
        speed_before = v.norm();
      }
      if (k >= kFrom)
        travel = (Eigen::Vector2d(r.position) - origin).norm();
      if (first_fault < 0 && r.state == LoopState::Fault)
      {
        first_fault = k;
        fault = r.fault;
      }
      if (first_fault >= 0 && stopped < 0 && v.norm() < kStopped)
        stopped = k;
    }
  }
};

void record(const std::string& name, double value)
{
  char text[32];
  std::snprintf(text, sizeof(text), "%.3g", value);
  testing::Test::RecordProperty(name, text);
}

/// Times since the last good sample [ms].
void recordStop(const Spoiled& spoiled, int last_good)
{
  record("fault_ms", spoiled.first_fault - last_good);
  record("stop_ms", spoiled.stopped - last_good);
  record("speed_mm_s", 1e3 * spoiled.speed_before);
  record("travel_mm", 1e3 * spoiled.travel);
}

const Spoiled& clean()
{
  static const Spoiled trial([](auto&, auto) {});
  return trial;
}
}  // namespace

// Row 1, short: no fault, and no tick changes the speed by more than clean ones do.
TEST(WrenchFaults, TwoMillisecondsOfNanGoUnnoticed)
{
  const Spoiled spoiled([](Measurement& m, int ms) {
    if (ms < kFrom + 2)
      m.human_wrench(0) = kNan;
  });
  EXPECT_EQ(spoiled.first_fault, -1);
  record("step_mm_s", 1e3 * spoiled.largest_speed_step);
  record("clean_step_mm_s", 1e3 * clean().largest_speed_step);
  EXPECT_LE(spoiled.largest_speed_step, 1.5 * clean().largest_speed_step);
}

// Row 1, long, and infinity alike: FAULT at the first tick beyond 20 ms after the last good sample, then rest.
TEST(WrenchFaults, HundredMillisecondsOfNanAreAFault)
{
  for (const double bad : { kNan, std::numeric_limits<double>::infinity() })
  {
    const Spoiled spoiled([bad](Measurement& m, int ms) {
      if (ms < kFrom + 100)
        m.human_wrench.setConstant(bad);
    });
    recordStop(spoiled, kFrom - 1);
    EXPECT_EQ(spoiled.first_fault, kFrom + 20);
    EXPECT_EQ(spoiled.fault, FaultCode::WrenchStale);
    EXPECT_LT(spoiled.trial.record().velocity.norm(), 0.001);
  }
}

// Row 2: after the last sample v decays with tau = M / (4 D); the travel is at most v (T_fault + 5 tau).
TEST(WrenchFaults, AStoppedSensorIsAFault)
{
  Measurement last;
  bool seen = false;
  const Spoiled spoiled([&](Measurement& m, int) {
    if (!seen)
      last = m;
    seen = true;
    m.human_wrench = last.human_wrench;
    m.receive_ns = last.receive_ns;
    m.stamp_ns = last.stamp_ns;
    m.sequence = last.sequence;
  });
  recordStop(spoiled, kFrom);
  EXPECT_EQ(spoiled.first_fault, kFrom + 21) << "the sample of 3.000 s was the last good one";
  const double tau = 90.0 / (4.0 * 200.0);
  EXPECT_LT(spoiled.travel, spoiled.speed_before * (0.020 + 5 * tau));
}

// Row 3: samples that arrive in time but were stamped long ago or in the future are refused; 4 in 100 change no state,
// nothing else for 25 ms is a fault.
TEST(WrenchFaults, StaleAndFutureStampsAreRefused)
{
  for (const std::int64_t shift : { -25 * kMs, 2 * kMs })
  {
    Spoiled some([shift](Measurement& m, int ms) {
      if (ms % 25 == 0)
        m.stamp_ns += shift;
    });
    EXPECT_EQ(some.first_fault, -1);
    EXPECT_GT(some.trial.loop().rejected().bad_stamp, 50u);
    const Spoiled all([shift](Measurement& m, int) { m.stamp_ns += shift; });
    EXPECT_EQ(all.first_fault, kFrom + 20);
    record("fault_ms", all.first_fault - kFrom + 1);
  }
}

// Row 4: an older sample in the place of a new one has the very same effect as no sample: it is never used.
TEST(WrenchFaults, AnOlderSampleCountsAsNone)
{
  const auto every_third = [](auto&& act) {
    return [act, previous = Measurement()](Measurement& m, int ms) mutable {
      const Measurement now = m;
      if (ms % 3 == 1)  // not the first: there is no previous one
        act(m, previous);
      previous = now;
    };
  };
  const Spoiled older(every_third([](Measurement& m, const Measurement& previous) {
    m.human_wrench = -7.0 * previous.human_wrench;
    m.sequence = previous.sequence - 2;
  }));
  const Spoiled none(every_third([](Measurement& m, const Measurement& previous) {
    m.human_wrench = previous.human_wrench;
    m.sequence = previous.sequence;
    m.receive_ns = previous.receive_ns;
    m.stamp_ns = previous.stamp_ns;
  }));
  EXPECT_EQ(older.first_fault, -1);
  ASSERT_EQ(older.path.size(), none.path.size());
  for (std::size_t k = 0; k < older.path.size(); ++k)
    ASSERT_EQ(older.path[k], none.path[k]) << k;
}

// Row 5: not one tick with a wrench of another frame.
TEST(WrenchFaults, AnotherFrameIsAFaultAtOnce)
{
  const Spoiled spoiled([](Measurement& m, int ms) {
    if (ms == kFrom + 10)
    {
      m.frame = 1;
      m.human_wrench *= -100.0;
    }
  });
  recordStop(spoiled, kFrom + 9);
  EXPECT_EQ(spoiled.first_fault, kFrom + 10);
  EXPECT_EQ(spoiled.fault, FaultCode::WrenchFrame);
  // what remains is the braking of four times the damping
  const double braking = 4.0 * 200.0 / 90.0 * spoiled.speed_before * 1e-3;
  EXPECT_LE(spoiled.largest_speed_step, 1.05 * braking) << "a wrench of another frame was used";
}

// Row 6, in motion: a bias step of 30 N on a handle that nobody holds drifts at F / D and never faster than the limit.
// (At rest the loop refuses to start: LiveTuning.ABiasedSensorDoesNotStart.)
TEST(WrenchFaults, ABiasDriftsAtForceOverDamping)
{
  const Spoiled spoiled([](Measurement& m, int) { m.human_wrench = Eigen::Vector2d(0.0, -30.0); }, 3400);
  record("largest_speed_mm_s", 1e3 * spoiled.largest_speed);
  EXPECT_LE(spoiled.largest_speed, std::max(clean().largest_speed, 30.0 / 200.0) + 1e-6);
}

// Row 7: a sensor flat at its end for three samples: no assistance, and the person's hand is still felt.
TEST(WrenchFaults, ASaturatedSensorWithdrawsTheAssistance)
{
  const auto experiment = maze();
  const auto logs = runBlock(experiment, { 0, "pd", 7, { trialSpec(0, "pd", 1, 3, 0, 7) } });
  const auto model = learn(experiment->model, { logs[0].demonstration });
  Trial trial(experiment, trialSpec(0, "pd", 2, 3, 1, 7));
  int flat_from = -1, passive_at = -1, silent_at = -1;
  trial.tamper = [&](Measurement& m, std::int64_t now) {
    if (flat_from >= 0 && now >= flat_from * kMs)
      m.human_wrench = Eigen::Vector2d(196.0, 0.0);
  };
  for (int k = 0; k < 12000 && !trial.finished() && silent_at < 0; ++k)
  {
    trial.step();
    const TickRecord& r = trial.record();
    if (flat_from < 0 && k > 2000 && r.assistance_wrench.norm() > 2.0)
      flat_from = k + 1;
    if (flat_from >= 0 && passive_at < 0 && k > flat_from && r.state == LoopState::Passive)
      passive_at = k;
    if (passive_at >= 0 && r.assistance_wrench.norm() == 0.0)
      silent_at = k;
    if (!trial.planDue())
      continue;
    model->observe(trial.observation());
    trial.plan(model->predict(experiment->model.horizon, experiment->model.dt));
  }
  ASSERT_GT(flat_from, 0) << "the robot never assisted: nothing to withdraw";
  record("passive_ms", passive_at - flat_from + 1);
  record("silent_ms", silent_at - flat_from + 1);
  EXPECT_LE(passive_at, flat_from + 2) << "three samples";
  ASSERT_GT(silent_at, 0);
  EXPECT_LE(silent_at - passive_at, 201) << "faded within 0.2 s";
}

// Row 8: +-1000 N in one sample is beyond the sensor's range and refused; 190 N in one sample passes and is worth
// F dt / M.
TEST(WrenchFaults, OneSampleOfThousandNewtonIsRefused)
{
  for (const double spike : { 1000.0, -1000.0, 190.0 })
  {
    Spoiled spoiled([spike](Measurement& m, int ms) {
      if (ms == kFrom + 5)
        m.human_wrench(1) = spike;
    });
    EXPECT_EQ(spoiled.first_fault, -1);
    EXPECT_LE(spoiled.largest_speed_step, kSpikeStep);
    if (std::abs(spike) > 200.0)
    {
      EXPECT_EQ(spoiled.trial.loop().rejected().out_of_range, 1u);
      EXPECT_LE(spoiled.largest_speed_step, 1.5 * clean().largest_speed_step);
    }
    record("step_mm_s", 1e3 * spoiled.largest_speed_step);
  }
}
