#include <gtest/gtest.h>

#include <cmath>

#include "phri_control/interaction_loop.hpp"
#include "phri_core/random.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;
using phri_core::FaultCode;
using phri_core::LoopState;
using phri_core::Measurement;
using phri_core::VectorDof;

namespace
{
constexpr std::int64_t kTick = 1000000;  // [ns]

VectorDof planar(double x, double y)
{
  VectorDof v(2);
  v << x, y;
  return v;
}

LoopSettings settings()
{
  LoopSettings s;
  s.mass = planar(90, 90);
  s.damping = planar(200, 200);
  s.safety.workspace = 10.0;
  return s;
}

/// u = k (x_d - x) on the x axis for 0.2 s.
FeedbackPolicy spring(double t0, double k, double x_desired, int source)
{
  FeedbackPolicy::Stage stage;
  stage.gain = Eigen::MatrixXd::Zero(2, 4);
  stage.gain(0, 0) = -k;
  stage.reference = Eigen::Vector4d(x_desired, 0, 0, 0);
  stage.feedforward = planar(0, 0);
  return FeedbackPolicy(t0, 0.001, std::vector<FeedbackPolicy::Stage>(200, stage), source);
}

/// A loop with its ideal device; the wrench is what the test says.
struct Rig
{
  InteractionLoop loop{ settings() };
  Measurement m;
  int k = 0;
  Rig()
  {
    m.position = m.human_wrench = m.environment_wrench = planar(0, 0);
    loop.start();
  }
  explicit Rig(const LoopSettings& s) : loop(s)
  {
    m.position = m.human_wrench = m.environment_wrench = planar(0, 0);
    loop.start();
  }
  const TickRecord& tick(const VectorDof& human, bool fresh = true)
  {
    if (fresh)
    {
      m.human_wrench = human;
      m.receive_ns = m.stamp_ns = k * kTick;
      ++m.sequence;
    }
    m.position = loop.tick(m, k * kTick).position;
    ++k;
    return loop.record();
  }
  double speed() const { return loop.record().velocity.norm(); }
};
}  // namespace

// The wrench rule: a push in +x by the human moves the object to +x and reads +x.
TEST(InteractionLoop, PushInPlusXReadsPlusXAndMovesToPlusX)
{
  Rig rig;
  for (int k = 0; k < 500; ++k)
    rig.tick(planar(10, 0));
  EXPECT_EQ(rig.loop.record().human_wrench(0), 10.0);
  EXPECT_GT(rig.loop.record().position(0), 0.0);
  EXPECT_EQ(rig.loop.record().position(1), 0.0);
  EXPECT_EQ(rig.loop.record().state, LoopState::Passive);
}

TEST(InteractionLoop, TwoMillisecondsOfNanAreBridged)
{
  Rig clean, disturbed;
  for (int k = 0; k < 1000; ++k)
  {
    clean.tick(planar(10, 0));
    disturbed.tick(k == 500 || k == 501 ? planar(NAN, 10) : planar(10, 0));
  }
  EXPECT_EQ(clean.loop.record().position, disturbed.loop.record().position);
  EXPECT_EQ(disturbed.loop.record().state, LoopState::Passive);
  EXPECT_EQ(disturbed.loop.rejected().not_finite, 2u);
}

// 100 ms of NaN: the state stays finite, FAULT comes at 21 ms, and the object stops with the fault's damping:
// v(t) <= v0 exp(-4 D t / M), 10 ms of ramped wrench included.
TEST(InteractionLoop, HundredMillisecondsOfNanAreAFault)
{
  Rig rig;
  for (int k = 0; k < 3000; ++k)
    rig.tick(planar(20, 0));
  const double v0 = rig.speed();
  int fault_at = -1;
  for (int k = 0; k < 100; ++k)
  {
    const TickRecord& r = rig.tick(planar(NAN, NAN));
    EXPECT_TRUE(r.position.allFinite() && r.velocity.allFinite() && r.human_wrench.allFinite());
    if (fault_at < 0 && r.state == LoopState::Fault)
      fault_at = k;
  }
  EXPECT_EQ(fault_at, 20) << "21st sample after the last good one";
  EXPECT_EQ(rig.loop.record().fault, FaultCode::WrenchStale);
  for (int k = 0; k < 400; ++k)
    rig.tick(planar(20, 0));
  EXPECT_EQ(rig.loop.record().state, LoopState::Fault) << "a fault must stay latched";
  for (int k = 0; k < 1000; ++k)
    rig.tick(planar(0, 0));
  EXPECT_LT(rig.speed(), v0 * 1e-3);
}

TEST(InteractionLoop, StoppedWrenchIsAFaultAndDriftIsBounded)
{
  Rig rig;
  for (int k = 0; k < 3000; ++k)
    rig.tick(planar(20, 0));
  const double v0 = rig.speed(), x0 = rig.loop.record().position(0);
  for (int k = 0; k < 5000; ++k)
    rig.tick(planar(0, 0), false);
  EXPECT_EQ(rig.loop.record().fault, FaultCode::WrenchStale);
  const double tau = 90.0 / (4.0 * 200.0);
  EXPECT_LE(rig.loop.record().position(0) - x0, v0 * (0.020 + 5.0 * tau));
  EXPECT_LT(rig.speed(), 1e-6);
}

TEST(InteractionLoop, FaultClearsOnlyWhenItsCauseHasGone)
{
  Rig rig;
  for (int k = 0; k < 100; ++k)
    rig.tick(planar(20, 0));
  for (int k = 0; k < 30; ++k)
    rig.tick(planar(0, 0), false);
  ASSERT_EQ(rig.loop.record().state, LoopState::Fault);
  rig.loop.clearFault();
  rig.tick(planar(0, 0));
  EXPECT_EQ(rig.loop.record().state, LoopState::Fault) << "cleared at once";
  for (int k = 0; k < 1500; ++k)
    rig.tick(planar(5, 0));
  rig.loop.clearFault();
  rig.tick(planar(5, 0));
  EXPECT_EQ(rig.loop.record().state, LoopState::Fault) << "cleared under a hand force of 5 N";
  for (int k = 0; k < 1500; ++k)
    rig.tick(planar(0, 0));
  rig.loop.clearFault();
  rig.tick(planar(0, 0));
  EXPECT_EQ(rig.loop.record().state, LoopState::Idle);
  EXPECT_EQ(rig.loop.record().fault, FaultCode::None);
}

// At rest and untouched, only the time since the cause has gone stands between FAULT and IDLE.
TEST(InteractionLoop, FaultClearsAfterOneSecondOfGoodSamples)
{
  Rig rig;
  rig.tick(planar(0, 0));
  for (int k = 0; k < 30; ++k)
    rig.tick(planar(0, 0), false);
  ASSERT_EQ(rig.loop.record().state, LoopState::Fault);
  for (const auto& [milliseconds, state] : { std::pair(900, LoopState::Fault), std::pair(110, LoopState::Idle) })
  {
    for (int k = 0; k < milliseconds; ++k)
      rig.tick(planar(0, 0));
    rig.loop.clearFault();
    EXPECT_EQ(rig.tick(planar(0, 0)).state, state);
  }
}

// A policy is adopted, replaced by one of another source and left to expire: the force has no step larger than the slew
// limit allows while growing, none at all of more than the fades' slope while switching, and ends at zero.
TEST(InteractionLoop, SwitchingIsBumpless)
{
  Rig rig;
  double last = 0.0, largest = 0.0;
  for (int k = 0; k < 1500; ++k)
  {
    if (k == 100 || k == 200)
      rig.loop.adopt(spring(k * 1e-3, 400, 0.05, 1));
    if (k == 300)
      rig.loop.adopt(spring(k * 1e-3, 400, -0.05, 2));
    const TickRecord& r = rig.tick(planar(6, 0));
    largest = std::max(largest, std::abs(r.requested_wrench(0) - last));
    last = r.requested_wrench(0);
    if (k == 250)
    {
      EXPECT_EQ(r.state, LoopState::Active);
      EXPECT_GT(r.assistance_wrench(0), 1.0);
    }
    if (k == 1400)
    {
      EXPECT_EQ(r.state, LoopState::Passive) << "the policy has expired";
      EXPECT_EQ(r.assistance_wrench.norm(), 0.0);
    }
  }
  // 40 N across 0.2 s with the smoothstep's slope 1.5 / 0.2 s is 0.3 N per ms
  EXPECT_LT(largest, 0.35);
  EXPECT_GT(largest, 0.05) << "nothing was switched";
}

TEST(InteractionLoop, LettingGoWithdrawsTheAssistance)
{
  Rig rig;
  for (int k = 0; k < 1500; ++k)
  {
    if (k % 20 == 0)
      rig.loop.adopt(spring(k * 1e-3, 400, 0.2, 1));
    rig.tick(k < 500 ? planar(6, 0) : planar(0, 0));
    if (k == 499)
    {
      EXPECT_GT(rig.loop.record().assistance_wrench(0), 5.0);
    }
  }
  EXPECT_EQ(rig.loop.record().assistance_wrench.norm(), 0.0);
  EXPECT_TRUE(rig.loop.record().limits & phri_core::kLimitRelease);
}

TEST(InteractionLoop, LateCycleIsAFault)
{
  Rig rig;
  for (int k = 0; k < 10; ++k)
    rig.tick(planar(1, 0));
  rig.k += 15;
  EXPECT_EQ(rig.tick(planar(1, 0)).state, LoopState::Passive) << "15 ms late";
  rig.k += 25;
  EXPECT_EQ(rig.tick(planar(1, 0)).fault, FaultCode::LateCycle);

  Rig driven;  // simulated time runs on evenly; what drives it says how late it was
  for (const double lateness : { 0.0, 0.015, 0.021 })
  {
    driven.tick(planar(1, 0));
    driven.loop.tick(driven.m, driven.k * kTick, lateness);
    ++driven.k;
    EXPECT_EQ(driven.loop.record().state == LoopState::Fault, lateness > 0.020) << lateness;
    EXPECT_EQ(driven.loop.record().lateness, lateness);
  }
}

// Random wrenches, policies and faults, 20 seeds: nothing is ever not finite, limits hold, and the work on the object
// never falls below its kinetic energy.
TEST(InteractionLoop, StaysFiniteLimitedAndPassive)
{
  for (std::uint64_t seed = 0; seed < 20; ++seed)
  {
    phri_core::Random random(seed);
    Rig rig;
    double push = 0.0;
    for (int k = 0; k < 4000; ++k)
    {
      push += random.normal(0, 1.0) - 0.01 * push;
      if (k % 20 == 0 && random.uniform() < 0.8)
        rig.loop.adopt(spring(k * 1e-3, random.uniform(0, 1e5), random.normal(0, 0.3), int(3 * random.uniform())));
      const double kind = random.uniform();
      const VectorDof wrench = kind < 0.01   ? planar(NAN, INFINITY)
                               : kind < 0.02 ? planar(1000, -1000)
                                             : planar(push, 5);
      rig.m.environment_wrench = kind > 0.999 ? planar(NAN, 0) : planar(0, 0);
      const TickRecord& r = rig.tick(wrench, random.uniform() < 0.97);
      ASSERT_TRUE(r.position.allFinite() && r.velocity.allFinite() && r.assistance_wrench.allFinite());
      ASSERT_LE(r.assistance_wrench.norm(), 60.0 + 1e-9);
      ASSERT_LE(r.assistance_wrench.dot(r.velocity), 15.0 + 1e-9);
      ASSERT_LE(r.human_wrench.norm(), 140.0 + 1e-9);
      ASSERT_GE(r.passivity, -1e-6);
    }
  }
}

TEST(InteractionLoop, TickAllocatesNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations are not counted under AddressSanitizer";
  Rig rig;
  for (int k = 0; k < 50; ++k)
    rig.tick(planar(6, 0));
  long allocations = 0;
  for (int k = 50; k < 1000; ++k)
  {
    if (k % 20 == 0)
      rig.loop.adopt(spring(k * 1e-3, 400, 0.05, k / 300));
    allocations += phri_core::testing::countAllocations([&] { rig.tick(planar(k % 50 ? 6 : NAN, 0)); });
  }
  EXPECT_EQ(allocations, 0);
}

TEST(InteractionLoop, RefusesImpossibleSettings)
{
  LoopSettings bad = settings();
  bad.mass(0) = -5;
  EXPECT_THROW(InteractionLoop{ bad }, std::invalid_argument);
  bad = settings();
  bad.damping = VectorDof::Ones(3);
  EXPECT_THROW(InteractionLoop{ bad }, std::invalid_argument);
}
