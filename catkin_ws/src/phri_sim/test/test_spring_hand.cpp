#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "phri_core/admittance.hpp"
#include "phri_core/random.hpp"
#include "phri_core/testing.hpp"
#include "phri_sim/spring_hand.hpp"

using namespace phri_sim;
using Eigen::Vector2d;

namespace
{
constexpr double kDt = 0.001;        // [s]
constexpr double kMass = 90.0;       // [kg] thesis 5.3.4
constexpr double kDamping = 200.0;   // [Ns/m]
constexpr double kRounding = 1e-12;  // [J], [N]: sums of a few doubles of order 1 to 100

std::int64_t fake_ns = 0;
std::int64_t fakeClock() noexcept
{
  return fake_ns;
}

/// A handle that renders mass and damping, held by a spring.
struct World
{
  explicit World(double damping = kDamping)
    : handle(Vector2d::Constant(kMass), Vector2d::Constant(damping), kDt), spring(settings, kDt)
  {
    handle.reset(Vector2d(0, 0), Vector2d(0, 0));
  }
  Vector2d step(const Vector2d* target)
  {
    const HandleState seen{ 0.0, handle.position(), handle.velocity(), { 0, 0 }, nullptr };
    const Vector2d force = spring.step(seen, target);
    handle.step(force);
    return force;
  }
  /// Energy of the mass and of the saturated spring to a fixed target.
  double energy(const Vector2d& target) const
  {
    const double stretch = (target - Vector2d(handle.position())).norm(), reach = spring.reach();
    const double stored =
        stretch <= reach ? 0.5 * settings.stiffness * stretch * stretch : settings.force_max * (stretch - 0.5 * reach);
    return 0.5 * kMass * handle.velocity().squaredNorm() + stored;
  }
  SpringSettings settings;
  phri_core::Admittance handle;
  Spring spring;
};

class SpringHandTest : public ::testing::Test
{
protected:
  void SetUp() override { fake_ns = 0; }
  HandForce tick()
  {
    const HandForce out = hand.act({ 0.0, handle.position(), handle.velocity(), { 0, 0 }, nullptr });
    handle.step(out.force);
    fake_ns += 1000000;
    return out;
  }
  SpringSettings settings;
  std::shared_ptr<SpringTarget> target = std::make_shared<SpringTarget>(&fakeClock);
  SpringHand hand{ settings, kDt, target };
  phri_core::Admittance handle{ Vector2d::Constant(kMass), Vector2d::Constant(kDamping), kDt };
};
}  // namespace

TEST(Spring, IsPassiveTowardsAFixedTarget)
{
  // once the filter has settled on the target, no state of the handle may gain energy from the spring: inside the
  // linear range, in saturation, moving across the pull
  phri_core::Random random(3);
  for (int sample = 0; sample < 300; ++sample)
  {
    World world;
    const Vector2d target(0.02, -0.01);
    for (int k = 0; k < 4000; ++k)
    {
      world.handle.reset(target, Vector2d(0, 0));
      world.step(&target);
    }
    world.handle.reset(Vector2d(0.15 * random.normal(), 0.15 * random.normal()),
                       Vector2d(0.3 * random.normal(), 0.3 * random.normal()));
    double before = world.energy(target);
    for (int k = 0; k < 1500; ++k)
    {
      world.step(&target);
      const double now = world.energy(target);
      ASSERT_LE(now, before + kRounding) << "sample " << sample << " tick " << k;
      before = now;
    }
  }
}

TEST(Spring, PullsTheHandleToTheTargetAndRestsThere)
{
  World world;
  const Vector2d target(0.08, 0.05);
  for (int k = 0; k < 10000; ++k)
    world.step(&target);
  EXPECT_LT((Vector2d(world.handle.position()) - target).norm(), 1e-6);
  EXPECT_LT(world.handle.velocity().norm(), 1e-6);
}

TEST(Spring, MatchesTheFormulaAtRest)
{
  // a held handle, filter settled: f = K (r - x), cut at F, along r - x
  World world;
  for (const Vector2d& target : { Vector2d(0.01, 0.0), Vector2d(-0.004, 0.02), Vector2d(0.3, 0.4) })
  {
    Vector2d force;
    for (int k = 0; k < 10000; ++k)
    {
      world.handle.reset(Vector2d(0, 0), Vector2d(0, 0));
      force = world.step(&target);
    }
    const double size = std::min(world.settings.stiffness * target.norm(), world.settings.force_max);
    EXPECT_LT((force - size * target.normalized()).norm(), 1e-6) << target.transpose();
  }
}

TEST(Spring, FilterIsExactForASmallJump)
{
  // critically damped step response y(t) = r (1 - (1 + t/tau) e^(-t/tau)), seen through the force on a held handle:
  // f = K y + D y'
  World world;
  const Vector2d zero(0, 0), target(0.005, 0.0);
  for (int k = 0; k < 1000; ++k)
  {
    world.handle.reset(zero, zero);
    world.step(&zero);
  }
  const double tau = world.settings.smoothing;
  for (int k = 1; k <= 300; ++k)
  {
    world.handle.reset(zero, zero);
    const double force = world.step(&target).x(), t = k * kDt;
    const double y = target.x() * (1.0 - (1.0 + t / tau) * std::exp(-t / tau));
    const double speed = target.x() * t / (tau * tau) * std::exp(-t / tau);
    ASSERT_NEAR(force, world.settings.stiffness * y + world.settings.damping * speed, 1e-9) << k;
  }
}

TEST(Spring, NoTargetMakesAStepInTheForce)
{
  // a target that jumps across the workspace, vanishes and comes back at random: the change of the force from tick to
  // tick stays below the stated bound, computed from how the handle really moved
  World world;
  phri_core::Random random(11);
  Vector2d target(0, 0), last(0, 0), v_last(0, 0);
  bool held = false;
  double speed = 0.0, acceleration = 0.0, largest = 0.0;
  for (int k = 0; k < 200000; ++k)
  {
    if (random.uniform() < 0.01)
      target = Vector2d(0.3 * random.uniform() - 0.15, 0.3 * random.uniform() - 0.15);
    if (random.uniform() < 0.005)
      held = !held;
    const Vector2d force = world.step(held ? &target : nullptr);
    const Vector2d v = world.handle.velocity();
    speed = std::max(speed, v.norm());
    acceleration = std::max(acceleration, (v - v_last).norm() / kDt);
    largest = std::max(largest, (force - last).norm());
    ASSERT_LE(force.norm(), world.settings.force_max + kRounding);
    last = force;
    v_last = v;
  }
  EXPECT_LE(largest, world.spring.maxForceRate(speed, acceleration) * kDt);
  // and the bound means something: far from the step of 2 F that an unfiltered, unfaded spring makes here
  EXPECT_LT(world.spring.maxForceRate(speed, acceleration) * kDt, 0.15 * world.settings.force_max);
  EXPECT_GT(largest, 0.0);
}

TEST(Spring, TakesHoldOfAMovingHandleWithoutForce)
{
  // the filter starts with the handle's velocity: after one tick D acts on what it has lost of it, 2 v dt / tau
  World world;
  const double speed = 0.2, grip = 3.0 * std::pow(kDt / Spring::kFade, 2);
  world.handle.reset(Vector2d(0.1, 0), Vector2d(speed, 0));
  const Vector2d target(0.1, 0);
  const double lost = 2.0 * speed * kDt / world.settings.smoothing;
  EXPECT_LT(world.step(&target).norm(), grip * world.settings.damping * lost);
}

TEST(Spring, RefusesSettingsOutOfRange)
{
  const auto with = [](double SpringSettings::*field, double value) {
    SpringSettings settings;
    settings.*field = value;
    return Spring(settings, kDt);
  };
  const double nan = std::nan("");
  EXPECT_THROW(with(&SpringSettings::stiffness, 0.0), std::invalid_argument);
  EXPECT_THROW(with(&SpringSettings::damping, -1.0), std::invalid_argument);
  EXPECT_THROW(with(&SpringSettings::force_max, nan), std::invalid_argument);
  EXPECT_THROW(with(&SpringSettings::smoothing, 0.0), std::invalid_argument);
  EXPECT_THROW(with(&SpringSettings::timeout, nan), std::invalid_argument);
  EXPECT_THROW(Spring(SpringSettings(), 0.0), std::invalid_argument);
}

TEST_F(SpringHandTest, AStaleTargetHasLetGo)
{
  ASSERT_TRUE(target->set(Vector2d(0.1, 0)));
  const int fresh = int(settings.timeout / kDt), fade = int(Spring::kFade / kDt);
  for (int k = 0; k <= fresh; ++k)
    tick();
  EXPECT_GT(tick().force.norm(), 10.0) << "at its timeout it still pulls";
  double last = settings.force_max;
  for (int k = 0; k < fade; ++k)
    last = tick().force.norm();
  EXPECT_EQ(last, 0.0);
  for (int k = 0; k < 1000; ++k)
    ASSERT_EQ(tick().force.norm(), 0.0);
  ASSERT_TRUE(target->set(Vector2d(0.1, 0)));
  for (int k = 0; k < 200; ++k)
    tick();
  EXPECT_GT(tick().force.norm(), 10.0) << "and it takes hold again";
}

TEST_F(SpringHandTest, ARefreshedTargetHolds)
{
  for (int k = 0; k < 3000; ++k)
  {
    if (k % 250 == 0)  // rviz repeats itself that often while the mouse is held still
      target->set(Vector2d(5.0, 0));
    tick();
  }
  EXPECT_NEAR(tick().force.norm(), settings.force_max, 1e-9);
}

TEST_F(SpringHandTest, ReleaseFadesToNothingAndTheHandleCoasts)
{
  // safety row 34: after the hand let go the kinetic energy never grows, and the way is at most v M / D
  for (int k = 0; k < 400; ++k)
  {
    target->set(Vector2d(0.3, 0));
    tick();
  }
  target->release();
  for (int k = 0; k < int(Spring::kFade / kDt) + 1; ++k)
    tick();
  const double v0 = handle.velocity().norm(), x0 = handle.position()(0);
  ASSERT_GT(v0, 0.05);
  double before = v0;
  for (int k = 0; k < 5000; ++k)
  {
    ASSERT_EQ(tick().force.norm(), 0.0);
    ASSERT_LE(handle.velocity().norm(), before);
    before = handle.velocity().norm();
  }
  EXPECT_LE(handle.position()(0) - x0, v0 * kMass / kDamping + 1e-9);
}

TEST_F(SpringHandTest, RefusesTargetsThatAreNotNumbers)
{
  const double nan = std::nan(""), inf = std::numeric_limits<double>::infinity();
  ASSERT_TRUE(target->set(Vector2d(0.01, 0)));
  for (const Vector2d& bad : { Vector2d(nan, 0), Vector2d(0, inf), Vector2d(-inf, nan), Vector2d(0, 1e300) })
  {
    EXPECT_FALSE(target->set(bad));
    EXPECT_FALSE(target->move(bad));
  }
  const auto wish = target->current(0.5);
  EXPECT_EQ(wish.kind, SpringTarget::Wish::kPosition);
  EXPECT_EQ(wish.value, Vector2d(0.01, 0)) << "the last good one stays";
  for (int k = 0; k < 100; ++k)
    ASSERT_TRUE(tick().force.allFinite());
}

TEST_F(SpringHandTest, AVelocityMovesTheHandleAtThatVelocity)
{
  // settled: the target leads by what the admittance's damping takes, D v / K, and the handle moves with it
  const Vector2d v(0.06, -0.08);
  for (int k = 0; k < 8000; ++k)
  {
    target->move(v);
    tick();
  }
  EXPECT_LT((Vector2d(handle.velocity()) - v).norm(), 1e-4);
}

TEST_F(SpringHandTest, AStickPushesFromWhereTheHandleIs)
{
  handle.reset(Vector2d(0.1, -0.08), Vector2d(0, 0));
  for (int k = 0; k < 200; ++k)
  {
    target->move(Vector2d(0.1, 0));
    const Vector2d force = tick().force;
    ASSERT_GE(force.x(), 0.0) << k;
    ASSERT_EQ(force.y(), 0.0) << k;
  }
  EXPECT_GT(tick().force.x(), 1.0);
}

TEST_F(SpringHandTest, ATargetThatMovesLeadsByTheReachAtMost)
{
  // handle held by a wall for 5 s with the stick at its end, then the stick is reversed: the pull must turn within the
  // time it takes to come back from the reach, not from where 5 s of integration would have led
  const double speed = 0.2, reach = settings.force_max / settings.stiffness;
  const auto held = [&](double v) {
    target->move(Vector2d(v, 0));
    fake_ns += 1000000;
    return hand.act({}).force.x();
  };
  double force = 0.0;
  for (int k = 0; k < 5000; ++k)
    force = held(speed);
  EXPECT_NEAR(force, settings.force_max, 1e-6);
  const int ticks = int((reach / speed + 3.0 * settings.smoothing) / kDt);
  for (int k = 0; k < ticks; ++k)
    force = held(-speed);
  EXPECT_LT(force, 0.0);
}

TEST_F(SpringHandTest, AllocatesNothingInTheTick)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations cannot be counted under AddressSanitizer";
  target->set(Vector2d(0.01, 0));
  const long count = phri_core::testing::countAllocations([&] {
    for (int k = 0; k < 1000; ++k)
    {
      if (k == 300)
        target->move(Vector2d(0.1, 0));
      if (k == 600)
        target->release();
      hand.act({ 0.0, { 0.001 * k, 0 }, { 0, 0.1 }, { 0, 0 }, nullptr });
    }
  });
  EXPECT_EQ(count, 0);
}
