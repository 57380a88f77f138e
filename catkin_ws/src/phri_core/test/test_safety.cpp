#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "phri_core/random.hpp"
#include "phri_core/safety.hpp"
#include "phri_core/testing.hpp"

using namespace phri_core;

namespace
{
constexpr double kDt = 0.001;
constexpr std::int64_t kTick = 1000000;

VectorDof planar(double x, double y)
{
  VectorDof v(2);
  v << x, y;
  return v;
}

Measurement sample(int k, const VectorDof& wrench)
{
  Measurement m;
  m.receive_ns = m.stamp_ns = k * kTick;
  m.sequence = k + 1;
  m.position = m.environment_wrench = planar(0, 0);
  m.human_wrench = wrench;
  return m;
}
}  // namespace

TEST(StateMachine, EveryStateAndEventKeepsTheRules)
{
  for (std::size_t s = 0; s < kLoopStates; ++s)
    for (std::size_t e = 0; e < kLoopEvents; ++e)
    {
      const auto from = static_cast<LoopState>(s);
      const auto event = static_cast<LoopEvent>(e);
      const LoopState to = transition(from, event);
      const std::string what = std::string(stateName(from)) + " on event " + std::to_string(e);
      EXPECT_TRUE(event != LoopEvent::Fail || to == LoopState::Fault) << what;
      EXPECT_TRUE(from != LoopState::Fault || to == (event == LoopEvent::Clear ? LoopState::Idle : LoopState::Fault))
          << what;
      EXPECT_TRUE(to != LoopState::Active || from == LoopState::Active ||
                  (from == LoopState::Passive && event == LoopEvent::Assist))
          << what;
      EXPECT_TRUE(from != LoopState::Init || event == LoopEvent::Fail ||
                  to == (event == LoopEvent::Configured ? LoopState::Idle : LoopState::Init))
          << what;
    }
}

// std::clamp and std::min/max let NaN through; no limiter may.
TEST(MotionLimiter, LetsNoNanThrough)
{
  MotionLimiter limiter(SafetySettings(), 2, kDt);
  for (const double bad : { std::nan(""), HUGE_VAL, -HUGE_VAL })
  {
    VectorDof x = planar(0.1, bad), v = planar(bad, 0.1);
    std::uint32_t limits = 0;
    limiter.apply(planar(0.1, 0), planar(0.2, 0), x, v, limits);
    EXPECT_EQ(x, planar(0.1, 0));
    EXPECT_EQ(v, planar(0, 0));
  }
}

// NaN for 2 ms is bridged by the held wrench; for 100 ms it ramps to zero and FAULTs at 20 ms.
TEST(InputGuard, HoldsThenRampsThenFaults)
{
  InputGuard guard(SafetySettings(), 2);
  for (int k = 0; k <= 10; ++k)
    guard.check(sample(k, planar(10, 0)), k * kTick);
  for (int k = 11; k <= 12; ++k)
    EXPECT_EQ(guard.check(sample(k, planar(NAN, 0)), k * kTick).wrench(0), 10.0);
  EXPECT_EQ(guard.check(sample(13, planar(8, 0)), 13 * kTick).wrench(0), 8.0);
  double last = 8.0;
  int first_fault = 0;
  for (int k = 14; k <= 113; ++k)
  {
    const auto verdict = guard.check(sample(k, planar(0, NAN)), k * kTick);
    EXPECT_TRUE(verdict.wrench.allFinite());
    EXPECT_LE(verdict.wrench(0), last);
    last = verdict.wrench(0);
    if (!first_fault && verdict.fault == FaultCode::WrenchStale)
      first_fault = k - 13;
  }
  EXPECT_EQ(last, 0.0);
  EXPECT_EQ(first_fault, 21);
  EXPECT_EQ(guard.counters().not_finite, 102u);
}

TEST(InputGuard, StoppedTopicIsTheSameAsNan)
{
  InputGuard guard(SafetySettings(), 2);
  const Measurement last = sample(0, planar(10, 0));
  int first_fault = 0;
  for (int k = 0; k < 40 && !first_fault; ++k)
    if (guard.check(last, k * kTick).fault == FaultCode::WrenchStale)
      first_fault = k;
  EXPECT_EQ(first_fault, 21);
}

TEST(InputGuard, NewestWinsAndOldStampsAreRejected)
{
  InputGuard guard(SafetySettings(), 2);
  guard.check(sample(30, planar(1, 0)), 30 * kTick);
  EXPECT_EQ(guard.check(sample(29, planar(5, 0)), 31 * kTick).wrench(0), 1.0) << "an older sample was used";
  Measurement stale = sample(32, planar(5, 0));
  stale.stamp_ns = 2 * kTick;
  EXPECT_EQ(guard.check(stale, 32 * kTick).wrench(0), 1.0) << "a stale stamp was used";
  Measurement ahead = sample(33, planar(5, 0));
  ahead.stamp_ns += 5 * kTick;
  EXPECT_EQ(guard.check(ahead, 33 * kTick).wrench(0), 1.0) << "a stamp from the future was used";
  EXPECT_EQ(guard.counters().out_of_order, 1u);
  EXPECT_EQ(guard.counters().bad_stamp, 2u);
}

TEST(InputGuard, FrameSpikeSaturationAndClamp)
{
  InputGuard guard(SafetySettings(), 2);
  EXPECT_EQ(guard.check(sample(0, planar(3, 0)), 0).wrench(0), 3.0);
  EXPECT_EQ(guard.check(sample(1, planar(1000, 0)), kTick).wrench(0), 3.0) << "a spike beyond the range was used";
  EXPECT_NEAR(guard.check(sample(2, planar(150, 0)), 2 * kTick).wrench.norm(), 140.0, 1e-9);
  for (int k = 3; k < 6; ++k)
    EXPECT_EQ(guard.check(sample(k, planar(195, 0)), k * kTick).saturated, k == 5);
  Measurement foreign = sample(6, planar(3, 0));
  foreign.frame = 2;
  const auto verdict = guard.check(foreign, 6 * kTick);
  EXPECT_EQ(verdict.fault, FaultCode::WrenchFrame);
  EXPECT_EQ(verdict.wrench.norm(), 0.0) << "a wrench in a foreign frame was used";
}

TEST(AssistanceLimiter, SlowsGrowthOnly)
{
  AssistanceLimiter limiter(SafetySettings(), 2, kDt);
  std::uint32_t limits = 0;
  VectorDof u = limiter.apply(planar(30, 0), planar(0, 0), planar(200, 200), limits);
  EXPECT_NEAR(u(0), 0.3, 1e-12);
  EXPECT_EQ(limits, kLimitSlew);
  for (int k = 0; k < 200; ++k)
    u = limiter.apply(planar(30, 0), planar(0, 0), planar(200, 200), limits);
  EXPECT_NEAR(u(0), 30.0, 1e-12);
  limits = 0;
  u = limiter.apply(planar(2, 0), planar(0, 0), planar(200, 200), limits);
  EXPECT_EQ(u(0), 2.0) << "a reduction was slowed";
  EXPECT_EQ(limits, 0u);
  u = limiter.apply(planar(-30, 0), planar(0, 0), planar(200, 200), limits);
  EXPECT_NEAR(u(0), -0.3, 1e-12) << "a reversal may only grow from zero";
}

// A robot that pulls with 60 N for ever: the energy it injects beyond what the damper takes is bounded by the tank.
TEST(AssistanceLimiter, TankBoundsTheInjectedEnergy)
{
  SafetySettings settings;
  AssistanceLimiter limiter(settings, 2, kDt);
  const VectorDof d = planar(200, 200);
  double injected = 0, dissipated = 0;
  bool scaled = false;
  for (int k = 0; k < 20000; ++k)
  {
    const VectorDof v = planar(0.1 + 0.05 * std::sin(0.002 * k), 0.02);
    std::uint32_t limits = 0;
    const VectorDof u = limiter.apply(planar(60, 0), v, d, limits);
    scaled |= limits & kLimitTank;
    injected += kDt * u.dot(v);
    dissipated += kDt * (d.array() * v.array().square()).sum();
    EXPECT_LE(u.dot(v), settings.assistance_power + 1e-9);
    EXPECT_LE(injected - dissipated, settings.tank_initial + 1e-9);
    EXPECT_GE(limiter.energy(), 0.0);
    EXPECT_LE(limiter.energy(), settings.tank_max);
  }
  EXPECT_TRUE(scaled);
}

TEST(AssistanceLimiter, NanBecomesNoAssistance)
{
  AssistanceLimiter limiter(SafetySettings(), 2, kDt);
  std::uint32_t limits = 0;
  EXPECT_EQ(limiter.apply(planar(NAN, 1), planar(0, 0), planar(1, 1), limits).norm(), 0.0);
  EXPECT_NEAR(limiter.apply(planar(0.1, 0), planar(0, 0), planar(1, 1), limits)(0), 0.1, 1e-12);
}

// Random motions: braking is never weakened, the kinetic energy never exceeds what the unlimited motion had, and the
// limits hold. 1e5 seeded cases.
TEST(MotionLimiter, NeverWeakensBraking)
{
  SafetySettings settings;
  settings.velocity_max = 0.25;
  Random random(11);
  std::set<std::uint32_t> seen;
  for (int k = 0; k < 100000; ++k)
  {
    MotionLimiter limiter(settings, 2, kDt);
    const VectorDof x0 = planar(random.uniform(-0.15, 0.15), random.uniform(-0.15, 0.15));
    const VectorDof v0 = planar(random.normal(0, 0.08), random.normal(0, 0.08));
    const VectorDof wanted = v0 + planar(random.normal(0, 0.01), random.normal(0, 0.01));
    VectorDof v = wanted, x = x0 + 0.5 * kDt * (v0 + v);
    std::uint32_t limits = 0;
    limiter.apply(x0, v0, x, v, limits);
    seen.insert(limits);
    EXPECT_LE(v.norm(), wanted.norm() + 1e-12);
    EXPECT_LE(v.norm(), settings.velocity_max + 1e-12);
    EXPECT_LE(x.cwiseAbs().maxCoeff(), settings.workspace + kDt * settings.velocity_max);
    const bool braking = wanted.norm() <= v0.norm() && !(limits & (kLimitWorkspace | kLimitVelocity));
    EXPECT_TRUE(!braking || v == wanted) << "braking was changed";
  }
  EXPECT_GE(seen.size(), 4u) << "too few kinds of limits were met for this to prove anything";
}

TEST(SafetyLayer, AnAngleCountsAsAPointAtItsReferenceLength)
{
  // the same motion and wrench, once turned into an angle by the length: the limits must leave the same of it
  constexpr double kLength = 0.4, kExact = 1e-12;
  SafetySettings flat, turning;
  turning.rotations = 1;
  turning.rotation_length = kLength;
  const auto turned = [](VectorDof v, double factor) {
    v(1) *= factor;
    return v;
  };
  AssistanceLimiter force(flat, 2, kDt), torque(turning, 2, kDt);
  MotionLimiter speed(flat, 2, kDt), rate(turning, 2, kDt);
  InputGuard push(flat, 2), twist(turning, 2);
  Random random(3);
  VectorDof v_before = planar(0, 0), x_before = planar(0, 0);
  std::uint32_t flat_limits = 0, turning_limits = 0;
  for (int k = 0; k < 2000; ++k)
  {
    const VectorDof u = planar(60 * random.normal(), 60 * random.normal()), d = planar(90, 90);
    VectorDof v = v_before + planar(0.02 * random.normal(), 0.02 * random.normal()), x = x_before + kDt * v;
    VectorDof v_turning = turned(v, 1 / kLength), x_turning = turned(x, 1 / kLength);
    const VectorDof a = force.apply(u, v, d, flat_limits);
    const VectorDof b = torque.apply(turned(u, kLength), v_turning, turned(d, kLength * kLength), turning_limits);
    ASSERT_LT((a - turned(b, 1 / kLength)).norm(), kExact * 60) << k;
    if (std::abs(x(1)) > 0.1)  // an angle has no workspace
      x(1) = v(1) = x_turning(1) = v_turning(1) = x_before(1) = 0;
    speed.apply(x_before, v_before, x, v, flat_limits);
    rate.apply(turned(x_before, 1 / kLength), turned(v_before, 1 / kLength), x_turning, v_turning, turning_limits);
    ASSERT_LT((v - turned(v_turning, kLength)).norm(), kExact) << k;
    ASSERT_LT((x - turned(x_turning, kLength)).norm(), kExact) << k;
    const auto one = push.check(sample(k, u), k * kTick), other = twist.check(sample(k, turned(u, kLength)), k * kTick);
    ASSERT_NEAR(one.force, other.force, kExact * 140);
    ASSERT_EQ(one.clamped, other.clamped);
    v_before = 0.99 * v;
    x_before = x;
  }
  EXPECT_EQ(flat_limits, turning_limits);
  EXPECT_TRUE(flat_limits & kLimitForce);
  EXPECT_TRUE(flat_limits & kLimitAcceleration);

  VectorDof far = planar(0, 50), fast = planar(0, 0.1);  // eight turns: no edge
  std::uint32_t limits = 0;
  MotionLimiter(turning, 2, kDt).apply(planar(0, 50), planar(0, 0.1), far, fast, limits);
  EXPECT_EQ(limits, 0u);
  turning.rotations = 3;
  EXPECT_THROW(InputGuard(turning, 2), std::invalid_argument);
}

TEST(SafetyLayer, AllocatesNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations are not counted under AddressSanitizer";
  const SafetySettings settings;
  InputGuard guard(settings, 2);
  AssistanceLimiter assistance(settings, 2, kDt);
  MotionLimiter motion(settings, 2, kDt);
  EXPECT_GT(phri_core::testing::countAllocations([] { Eigen::VectorXd(3).setZero(); }), 0)
      << "the counter does not count";
  const long count = phri_core::testing::countAllocations([&] {
    for (int k = 0; k < 1000; ++k)
    {
      std::uint32_t limits = 0;
      const auto verdict = guard.check(sample(k, planar(k % 7 ? 5 : NAN, 1)), k * kTick);
      const VectorDof u = assistance.apply(verdict.wrench, planar(0.1, 0), planar(200, 200), limits);
      VectorDof x = planar(0.1, 0), v = u;
      motion.apply(planar(0, 0), planar(0, 0), x, v, limits);
    }
  });
  EXPECT_EQ(count, 0);
}
