#include <gtest/gtest.h>

#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

#include "carried_bar.hpp"
#include "phri_core/random.hpp"

using namespace phri_sim;
using carried_bar::Bar;
using carried_bar::kDt;
using Eigen::Vector2d;
using Eigen::Vector3d;

namespace
{
constexpr double kNever = 1e9;  // [s]

std::shared_ptr<const WalkingPath> straight(double heading = 0.0)
{
  return std::make_shared<const WalkingPath>(
      std::vector<Vector2d>{ { 0, 0 }, 5.0 * Vector2d(std::cos(heading), std::sin(heading)) }, 0.5);
}

/// Someone without noise who insists.
CarryingPerson quiet()
{
  CarryingPerson person;
  person.force_variation = person.force_noise = person.torque_noise = person.tremor = 0.0;
  person.leading = person.turning = 1.0;
  return person;
}

/// Arms and hands alone: nothing delayed, nothing fed forward.
CarryingPerson passive()
{
  CarryingPerson person = quiet();
  person.reflex_share = person.visual_stiffness = person.weight_share = 0.0;
  return person;
}

/// Stands at the origin, the object along x.
CarryingPartner standing(const CarryingPerson& person)
{
  return CarryingPartner({ straight(), 0.0, kNever }, {}, person, 1);
}

FarEnd atRest()
{
  FarEnd end;
  end.position(2) = 1.0;
  return end;
}
}  // namespace

// Both ends at rest at the reference: the person holds the expected share of the weight, nothing else.
TEST(CarryingPartner, HoldsHalfTheWeight)
{
  CarryingPartner partner = standing(quiet());
  const CarriedObject object;
  Vector6 half = Vector6::Zero();
  half(2) = 0.5 * object.mass * 9.81;
  for (int k = 0; k < 1000; ++k)
    EXPECT_LT((partner.step(k * kDt, atRest()) - half).norm(), 1e-12);
}

// A bar hinged at its near end sinks until the person holds half of its weight, whatever was expected: K makes up.
TEST(CarryingPartner, EndsUpWithHalfTheWeightOfAHingedBar)
{
  const CarriedObject object;
  for (const double expected : { 0.2, 0.5, 0.8 })
  {
    CarryingPerson person = quiet();
    person.weight_share = expected;
    CarryingPartner partner = standing(person);
    FarEnd end = atRest();
    const double inertia = object.mass * (1.2 * 1.2 / 12.0 + 0.55 * 0.55), lever = object.grasp_distance;
    double tilt = 0.0, rate = 0.0, lift = 0.0;
    for (int k = 0; k < 20000; ++k)
    {
      end.position(2) = 1.0 + lever * tilt;
      end.velocity(2) = lever * rate;
      lift = partner.step(k * kDt, end)(2);
      rate += kDt * lever * (lift - 0.5 * object.mass * 9.81) / inertia;
      tilt += kDt * rate;
    }
    EXPECT_NEAR(lift, 0.5 * object.mass * 9.81, 1e-6);
    const double stiffness = person.stiffness_forward * person.stiffness_vertical;
    EXPECT_NEAR(lever * tilt, (expected - 0.5) * object.mass * 9.81 / stiffness, 1e-6) << "all of K6, delayed or not";
  }
}

// A constant reference cannot feed energy into the object, however it is shaken: -W.V summed up never falls below zero.
// Tolerance: 1e-6 J, as the energy of a force held over 1 ms is D6's to lose; rotations stay small, as a diagonal K6
// derives from a potential for small ones only.
TEST(CarryingPartner, PassivePartOnlyDissipates)
{
  for (int seed = 0; seed < 20; ++seed)
  {
    phri_core::Random random(seed);
    CarryingPerson person = passive();
    person.grip_max = person.force_max = person.torque_max = 1e9;
    CarryingPartner partner = standing(person);
    Vector6 amplitude, omega;
    for (int i = 0; i < 6; ++i)
    {
      amplitude(i) = 0.1 * random.uniform();
      omega(i) = 2.0 * M_PI * random.uniform(0.2, 8.0);
    }
    const auto pose = [&](double t) { return Vector6(amplitude.array() * (1.0 - (omega * t).array().cos())); };
    FarEnd end = atRest();
    double absorbed = 0.0, worked = 0.0;
    for (int k = 0; k < 5000; ++k)
    {
      const Vector6 x = pose(k * kDt), next = pose((k + 1) * kDt);
      const Eigen::AngleAxisd turn(x.tail<3>().norm(), x.tail<3>().stableNormalized());
      const Eigen::AngleAxisd turned(next.tail<3>().norm(), next.tail<3>().stableNormalized());
      const Eigen::AngleAxisd step(turned.toRotationMatrix() * turn.toRotationMatrix().transpose());
      Vector6 moved;
      moved << next.head<3>() - x.head<3>(), step.angle() * step.axis();
      end.position = atRest().position + x.head<3>();
      end.rotation = turn.toRotationMatrix();
      end.velocity = moved / kDt;
      const Vector6 wrench = partner.step(k * kDt, end);
      absorbed -= wrench.dot(moved);
      worked += std::abs(wrench.dot(moved));
      ASSERT_GE(absorbed, -1e-6) << "seed " << seed << ", t = " << k * kDt;
    }
    EXPECT_GT(worked, 0.1) << "the test moved nothing";
  }
}

// Without delay, lag and noise, release from a deflection is a mass, spring and damper, with the reflected mass behind
// its dashpot: m a = -K x - D v - b (v - w), M dw = b (v - w), solved by the matrix exponential. Along x, and in yaw.
TEST(CarryingPartner, IsAMassSpringDamperInTheLimit)
{
  CarryingPerson person = quiet();
  person.visual_stiffness = person.muscle_lag = person.reflex_delay = 0.0;
  struct Case
  {
    int axis;
    double inertia, load, stiffness, deflection;
  };
  for (const Case& c : { Case{ 0, person.hand_mass, 15.0, person.stiffness_forward, 0.05 },
                         Case{ 5, 0.5 * person.hand_inertia, 0.3, person.stiffness_yaw, 0.2 } })
  {
    const double damping = 2.0 * person.damping_ratio * std::sqrt(c.stiffness * c.inertia), b = c.inertia / 0.005;
    Eigen::Matrix3d a;
    a << 0, 1, 0, -c.stiffness / c.load, -(damping + b) / c.load, b / c.load, 0, b / c.inertia, -b / c.inertia;
    const Eigen::Matrix3d transition = (a * kDt).exp();
    Vector3d truth(c.deflection, 0.0, 0.0);
    double x = c.deflection, v = 0.0, worst = 0.0, ideal_worst = 0.0;
    CarryingPartner partner = standing(person);
    FarEnd end = atRest();
    const double wn = std::sqrt(c.stiffness / (c.load + c.inertia)), zeta = damping / (2.0 * wn * (c.load + c.inertia)),
                 wd = wn * std::sqrt(1.0 - zeta * zeta);
    for (int k = 0; k < 3000; ++k)
    {
      if (c.axis < 3)
        end.position(0) = x;
      else
        end.rotation = Eigen::AngleAxisd(x, Vector3d::UnitZ()).toRotationMatrix();
      end.velocity(c.axis) = v;
      const Vector6 wrench = partner.step(k * kDt, end);
      v += kDt * wrench(c.axis) / c.load;
      x += kDt * v;
      truth = transition * truth;
      worst = std::max(worst, std::abs(x - truth(0)));
      const double t = (k + 1) * kDt;
      const double ideal =
          c.deflection * std::exp(-zeta * wn * t) * (std::cos(wd * t) + zeta * wn / wd * std::sin(wd * t));
      ideal_worst = std::max(ideal_worst, std::abs(x - ideal));
    }
    EXPECT_LT(worst, 0.005 * c.deflection) << "axis " << c.axis << ": a first-order step of 1 ms";
    EXPECT_LT(ideal_worst, 0.01 * c.deflection) << "axis " << c.axis << ": the dashpot's 5 ms show little";
  }
}

// Two people who differ in the strength of their reflexes alone, but not in total stiffness in what follows, feel the
// same push: what is delayed by d_p cannot differ before.
TEST(CarryingPartner, ReflexComesAfterItsDelay)
{
  CarryingPerson person = quiet();
  person.reflex_delay = 0.08;
  person.visual_stiffness = 0.0;
  CarryingPerson numb = person;
  numb.stiffness_forward *= 1.0 - person.reflex_share;  // only the intrinsic part, and all of it
  numb.damping_ratio /= std::sqrt(1.0 - person.reflex_share);
  numb.stiffness_lateral = numb.stiffness_vertical = 1.0;
  numb.reflex_share = 0.0;
  CarryingPartner feels = standing(person), is_numb = standing(numb);
  FarEnd end = atRest();
  double difference = 0.0;
  for (int k = 0; k < 300; ++k)
  {
    if (k >= 100)
      end.position(0) = 0.02;
    difference = std::abs(feels.step(k * kDt, end)(0) - is_numb.step(k * kDt, end)(0));
    if (k < 180)
    {
      EXPECT_LT(difference, 1e-12) << k;
    }
    else if (k == 182)
    {
      EXPECT_GT(difference, 1e-5) << "the muscles' lag lets through little at first";
    }
  }
  EXPECT_GT(difference, 0.5);
}

TEST(CarryingPartner, StrengthAndGripAreBounded)
{
  const CarryingPerson person = CarryingPopulation().person(3, 1);
  CarryingPartner partner = standing(person);
  FarEnd end = atRest();
  double force = 0.0, torque = 0.0, pull = 0.0;
  bool slipped = false;
  phri_core::Random random(4);
  for (int k = 0; k < 5000; ++k)
  {
    end.position = 0.7 * Vector3d(std::sin(0.003 * k), std::sin(0.005 * k), 1.0 + std::sin(0.002 * k));
    end.rotation = (Eigen::AngleAxisd(2.0 * std::sin(0.002 * k), Vector3d::UnitZ()) *
                    Eigen::AngleAxisd(std::sin(0.007 * k), Vector3d::UnitX()))
                       .toRotationMatrix();
    end.velocity = 3.0 * Vector6(Vector6::Ones() * random.normal());
    end.robot_wrench = 50.0 * Vector6::Ones() * random.normal();
    const Vector6 wrench = partner.step(k * kDt, end);
    force = std::max(force, wrench.head<3>().norm());
    torque = std::max(torque, wrench.tail<3>().norm());
    pull = std::max(pull, std::abs(end.rotation.col(0).dot(wrench.head<3>())));
    slipped |= partner.intention().slipping;
    ASSERT_TRUE(wrench.allFinite());
  }
  EXPECT_NEAR(force, person.force_max, 1e-9) << "reached, not passed";
  EXPECT_NEAR(torque, person.torque_max, 1e-9);
  EXPECT_LE(pull, person.grip_max + 1e-9);
  EXPECT_TRUE(slipped);
}

TEST(CarryingPartner, SlippingGripStillPullsTowardTheReference)
{
  CarryingPartner partner = standing(passive());
  FarEnd end = atRest();
  end.position(0) = -0.5;  // 200 N away
  EXPECT_NEAR(partner.step(0.0, end)(0), passive().grip_max, 1e-9);
  EXPECT_TRUE(partner.intention().slipping);
}

// Tilted about a world axis n by a small angle, K6 turns the object back about it: in the axes of the yaw, not the
// object's.
TEST(CarryingPartner, TurnsBackInTheAxesOfTheIntendedYaw)
{
  constexpr double kYaw = 1.0, kTilt = 0.05;
  const CarryingPerson person = passive();
  CarryingPartner partner({ straight(kYaw), kYaw, kNever }, {}, person, 1);
  const Eigen::Matrix3d level = Eigen::AngleAxisd(kYaw, Vector3d::UnitZ()).toRotationMatrix();
  FarEnd end = atRest();
  end.rotation = Eigen::AngleAxisd(kTilt, Vector3d::UnitX()).toRotationMatrix() * level;
  const Vector3d stiffness = person.stiffness_yaw * Vector3d(person.stiffness_roll, person.stiffness_pitch, 1.0);
  const Vector3d expected = -level * stiffness.asDiagonal() * level.transpose() * Vector3d(kTilt, 0, 0);
  EXPECT_LT((partner.step(0.0, end).tail<3>() - expected).norm(), 1e-9);
}

// The world has no preferred direction: all turned about the vertical, the wrench is turned; noise, gait and roles
// included.
TEST(CarryingPartner, IsEquivariantToRotationAboutTheVertical)
{
  const CarryingPerson person = CarryingPopulation().person(3, 2);
  const double angle = 2.2;
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(angle, Vector3d::UnitZ()).toRotationMatrix();
  const auto turned = [&](const Vector6& v) {
    return (Vector6() << turn * v.head<3>(), turn * v.tail<3>()).finished();
  };
  const std::vector<Vector2d> corner = { { 0, 0 }, { 2, 0 }, { 3.5, 2 } };
  std::vector<Vector2d> rotated;
  for (const Vector2d& x : corner)
    rotated.push_back(turn.topLeftCorner<2, 2>() * x);
  CarryingPartner one({ std::make_shared<WalkingPath>(corner, 0.5), 0.3, 0.5 }, {}, person, 7);
  CarryingPartner other({ std::make_shared<WalkingPath>(rotated, 0.5), 0.3 + angle, 0.5 }, {}, person, 7);
  Bar bar;
  bar.placeFarEnd({ 0, 0 }, 0.3);
  double force = 0.0;
  for (int k = 0; k < 20000; ++k)
  {
    bar.assistance << 5.0 * std::sin(0.002 * k), 4.0 * std::cos(0.003 * k), 0, 0, 0, 0.5 * std::sin(0.001 * k);
    const FarEnd end = bar.farEnd();
    FarEnd seen = end;
    seen.position = turn * end.position;
    seen.rotation = turn * end.rotation;
    seen.velocity = turned(end.velocity);
    seen.robot_wrench = turned(end.robot_wrench);
    const Vector6 wrench = one.step(k * kDt, end);
    ASSERT_LT((other.step(k * kDt, seen) - turned(wrench)).norm(), 1e-6)
        << k;  // rounding, through the place on the path
    force = std::max(force, wrench.head<2>().norm());
    bar.step(wrench);
  }
  EXPECT_GT(force, 5.0) << "the test moved nothing";
}

// Pulled aside for long, who gives in holds on less than who insists, and who fights more.
TEST(CarryingPartner, GivesInOrFightsByTrait)
{
  const auto resistance = [](double yielding) {
    CarryingPerson person = quiet();
    person.leading = 0.9;
    person.yielding = yielding;
    CarryingPartner partner = standing(person);
    FarEnd end = atRest();
    end.position(1) = 0.05;
    end.robot_wrench(1) = 10.0;
    double force = 0.0;
    for (int k = 0; k < 2000; ++k)
      force = partner.step(k * kDt, end)(1);
    return -force;
  };
  EXPECT_GT(resistance(0.0), 1.05 * resistance(0.6));
  EXPECT_GT(resistance(-0.4), 1.05 * resistance(0.0));
}

// The load held back: the person walks on as far as patience goes (and the lag that bothers nobody, 40 mm), then waits.
TEST(CarryingPartner, WaitsForALoadThatLags)
{
  const CarryingPerson person = quiet();
  CarryingPartner partner({ straight(), 0.0, 0.5 }, {}, person, 1);
  for (int k = 0; k < 30000; ++k)
    partner.step(k * kDt, atRest());
  EXPECT_NEAR(partner.intention().s, person.patience + 0.04, 0.01);
  EXPECT_LT(partner.intention().speed, 0.001);
}

// Who follows lets the body be drawn to where the load is, but no farther than the arms reach: 0.25 m.
TEST(CarryingPartner, ReachIsBounded)
{
  for (const double leading : { 0.0, 0.5, 1.0 })
  {
    CarryingPerson person = quiet();
    person.leading = leading;
    CarryingPartner partner = standing(person);
    FarEnd end = atRest();
    end.position(1) = 0.4;
    for (int k = 0; k < 5000; ++k)
      partner.step(k * kDt, end);
    EXPECT_NEAR(partner.intention().position(1), std::min(0.25, 0.4 * (1.0 - leading)), 1e-3);
  }
}

// Standing, the hand reference stands; walking, it goes up and down once a step and aside once in two, in proportion to
// the speed.
TEST(CarryingPartner, HandSwaysWithTheGait)
{
  const CarryingPerson person = quiet();
  CarryingPartner partner({ straight(), 0.0, 2.0 }, {}, person, 1);
  FarEnd end = atRest();
  double still = 0.0, high = 0.0, aside = 0.0, last = 0.0, speed = 0.0, pull = 0.0;
  int rising = 0;
  for (int k = 0; k < 22000; ++k)
  {
    end.position.head<2>() = partner.intention().walked;  // the load is always where it shall be
    end.velocity(0) = partner.intention().speed;
    pull = partner.step(k * kDt, end)(0);
    const Vector3d bob = partner.intention().position - Vector3d(partner.intention().walked(0), 0.0, 1.0);
    if (k < 2000)
      still = std::max(still, bob.norm());
    if (k >= 12000)
    {
      rising += last < 0.0 && bob(2) >= 0.0;
      high = std::max(high, bob(2));
      aside = std::max(aside, bob(1));
      speed = partner.intention().speed;
    }
    last = bob(2);
  }
  EXPECT_LT(still, 1e-12);
  // walking straight at a constant speed, with no error to correct, a leader's share of the damping is all there is
  EXPECT_NEAR(pull, (0.3 + 0.4) * CarriedObject().rendered_damping * speed, 0.1) << "K v dt, one tick behind";
  EXPECT_NEAR(rising, 10.0 * person.gait_rate, 1.0);
  EXPECT_NEAR(high, person.gait_bob * speed / 0.5, 1e-5);
  EXPECT_NEAR(aside, person.gait_sway * speed / 0.5, 1e-5);
}

TEST(CarryingPartner, AnnouncesTheStartByTurningTowardTheFirstBend)
{
  for (const double side : { 1.0, -1.0 })
  {
    const auto path =
        std::make_shared<WalkingPath>(std::vector<Vector2d>{ { 0, 0 }, { 2, 0 }, { 3.5, 2.0 * side } }, 0.5);
    CarryingPartner partner({ path, 0.0, 1.0 }, {}, quiet(), 1);
    double before = 0.0, pulse = 0.0;
    for (int k = 0; k <= 1000; ++k)
    {
      const double torque = side * partner.step(k * kDt, atRest())(5);
      (k <= 700 ? before : pulse) = std::max(k <= 700 ? before : pulse, std::abs(torque));
      EXPECT_GT(torque, -1e-9);
    }
    EXPECT_LT(before, 1e-9);
    EXPECT_GT(pulse, 0.3);
  }
}
