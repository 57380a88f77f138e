#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "phri_core/testing.hpp"
#include "phri_sim/sensed_hand.hpp"
#include "phri_sim/trial.hpp"

using namespace phri_sim;
using Eigen::Vector2d;
using phri_control::TickRecord;
using phri_core::FaultCode;
using phri_core::LoopState;

namespace
{
constexpr double kDt = 0.001;  // [s]

std::shared_ptr<const Experiment> maze()
{
  static const auto experiment = std::make_shared<const Experiment>(loadExperiment("maze_assistance"));
  return experiment;
}

std::int64_t fake_ns = 0;
std::int64_t fakeClock() noexcept
{
  return fake_ns;
}

/// A trial under condition (a) whose hand is a sensor; `source` makes the readings, or none, once per tick.
struct Sensed
{
  std::shared_ptr<SensedHand::Readings> readings = std::make_shared<SensedHand::Readings>();
  int fault_tick = -1;
  FaultCode fault = FaultCode::None;
  TickRecord last;
  phri_core::InputGuard::Counters rejected;

  Sensed(int ticks, const std::function<void(int, SensedHand::Readings&)>& source)
  {
    fake_ns = 1000000000;
    Trial trial(maze(), trialSpec(0, "none", 1, 3, 0, 7), std::make_unique<SensedHand>(readings, &fakeClock));
    for (int k = 0; k < ticks; ++k)
    {
      source(k, *readings);
      trial.step();
      last = trial.record();
      if (fault_tick < 0 && last.state == LoopState::Fault)
      {
        fault_tick = k;
        fault = last.fault;
      }
      fake_ns += 1000000;
    }
    rejected = trial.loop().rejected();
  }
};

SensedForce reading(int k, const Vector2d& force)
{
  SensedForce out;
  out.force = force;
  out.received_ns = fake_ns;
  out.sequence = std::uint64_t(k) + 1;
  return out;
}
constexpr int kFaultTicks = 21;  // safety rows 1 to 5: FAULT within 21 ms
constexpr int kFrom = 500;       // [ms]
}  // namespace

TEST(SensedHand, ASteadyPushPlusXReadsPlusX)
{
  // M v' + D v = f from rest: v = f / D (1 - e^(-D t / M)); the wrench is BY the hand ON the object
  const Vector2d push(6, 0);
  const Sensed run(kFrom, [&](int k, SensedHand::Readings& out) { out.post(reading(k, push)); });
  EXPECT_EQ(run.fault_tick, -1);
  EXPECT_EQ(run.last.human_wrench, push);
  const double damping = maze()->loop.damping(0), mass = maze()->loop.mass(0);
  const double expected = push.x() / damping * -std::expm1(-damping * (kFrom - 1) * kDt / mass);
  EXPECT_NEAR(run.last.velocity(0), expected, 1e-9);
}

TEST(SensedHand, SilenceIsAFault)
{
  const Sensed stops(kFrom + 100, [&](int k, SensedHand::Readings& out) {
    if (k < kFrom)
      out.post(reading(k, { 5, 0 }));
  });
  EXPECT_EQ(stops.fault, FaultCode::WrenchStale);
  EXPECT_GE(stops.fault_tick, kFrom + 19) << "the limit is 20 ms";
  EXPECT_LE(stops.fault_tick, kFrom - 1 + kFaultTicks);

  const Sensed never(100, [](int, SensedHand::Readings&) {});
  EXPECT_EQ(never.fault, FaultCode::WrenchStale);
  EXPECT_LE(never.fault_tick, kFaultTicks);
  EXPECT_EQ(never.last.human_wrench, phri_core::VectorDof(Vector2d(0, 0)));
  EXPECT_EQ(never.rejected.not_finite, 1u) << "no reading is not a reading of 0 N";
}

TEST(SensedHand, AgesFromWhenAReadingArrived)
{
  const Sensed run(kFrom, [&](int k, SensedHand::Readings& out) {
    SensedForce r = reading(k, { 5, 0 });
    r.received_ns -= 3000000;
    out.post(r);
  });
  EXPECT_NEAR(run.last.wrench_age, 0.003, 1e-12);
}

TEST(SensedHand, OldStampsAreRefusedAlthoughTheyArrive)
{
  const Sensed run(kFrom + 100, [&](int k, SensedHand::Readings& out) {
    SensedForce r = reading(k, { 5, 0 });
    r.stamp_age_ns = k < kFrom ? 2000000 : 21000000;
    out.post(r);
  });
  EXPECT_EQ(run.fault, FaultCode::WrenchStale);
  EXPECT_NEAR(run.fault_tick, kFrom + 20, 1);
  EXPECT_GT(run.rejected.bad_stamp, 0u);
}

TEST(SensedHand, AnotherFrameIsAFault)
{
  const Sensed run(kFrom + 100, [&](int k, SensedHand::Readings& out) {
    SensedForce r = reading(k, { 5, 0 });
    r.frame = k < kFrom ? 0 : 1;
    out.post(r);
  });
  EXPECT_EQ(run.fault, FaultCode::WrenchFrame);
  EXPECT_EQ(run.fault_tick, kFrom) << "not one cycle in a wrong frame";
}

TEST(SensedHand, NotANumberIsHeldThenAFault)
{
  const auto burst = [](int length) {
    return Sensed(kFrom + 100, [&](int k, SensedHand::Readings& out) {
      const bool bad = k >= kFrom && k < kFrom + length;
      out.post(reading(k, { bad ? std::nan("") : 5.0, 0 }));
    });
  };
  const Sensed brief = burst(4), lasting = burst(100);
  EXPECT_EQ(brief.fault, FaultCode::None);
  EXPECT_EQ(brief.rejected.not_finite, 4u);
  EXPECT_EQ(lasting.fault, FaultCode::WrenchStale);
  EXPECT_TRUE(lasting.last.position.allFinite());
}

TEST(SensedHand, OlderReadingsThatComeLateAreDropped)
{
  // swapped pairs 2, 1, 4, 3, ...: the older of two never counts
  const Sensed run(200, [&](int k, SensedHand::Readings& out) {
    SensedForce r = reading(k % 2 ? k - 1 : k + 1, { k % 2 ? -50.0 : 5.0, 0 });
    out.post(r);
  });
  EXPECT_EQ(run.fault, FaultCode::None);
  EXPECT_EQ(run.rejected.out_of_order, 100u);
  EXPECT_EQ(run.last.human_wrench(0), 5.0);
}

TEST(SensedHand, AllocatesNothingInTheTick)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations cannot be counted under AddressSanitizer";
  auto readings = std::make_shared<SensedHand::Readings>();
  SensedHand hand(readings, &fakeClock);
  const long count = phri_core::testing::countAllocations([&] {
    for (int k = 0; k < 2000; ++k)
    {
      readings->post(reading(k, { 1, 2 }));
      hand.act({});
    }
  });
  EXPECT_EQ(count, 0);
}
