// From raw readings to the wrench of human and environment: frames, filter, compensation, tare, faults.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>

#include "phri_control/force_sensor.hpp"
#include "phri_core/random.hpp"
#include "phri_core/testing.hpp"

using namespace phri_control;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace
{
constexpr double kRounding = 1e-12;  // a few operations on numbers up to 100
constexpr double kDt = 0.001;        // [s]
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr int kTareSamples = 500;  // the default tare time

template <typename T>
T some() noexcept;  // never called
static_assert(noexcept(some<ForceSensor&>().update(some<const Vector6d&>(), some<const SensorMotion&>())));
static_assert(noexcept(some<ForceSensor&>().tare()) && noexcept(some<LowPass&>().step(some<const Vector6d&>())));
static_assert(noexcept(transformWrench(some<const Eigen::Isometry3d&>(), some<const Vector6d&>())));

Vector6d randomWrench(phri_core::Random& random)
{
  Vector6d wrench;
  for (int i = 0; i < 6; ++i)
    wrench(i) = random.normal(0.0, i < 3 ? 20.0 : 1.0);
  return wrench;
}

Matrix3d randomRotation(phri_core::Random& random)
{
  return Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal())
      .normalized()
      .toRotationMatrix();
}

ForceSensorSettings gripper()
{
  ForceSensorSettings settings;
  settings.payload = { 1.4, Vector3d(0.01, -0.02, 0.09) };
  settings.bias << 3.0, -2.0, 1.0, 0.1, 0.2, -0.3;
  settings.cutoff = 0.0;
  return settings;
}

SensorMotion at(const Matrix3d& orientation)
{
  SensorMotion motion;
  motion.orientation = orientation;
  return motion;
}

std::string errorOf(const std::function<void()>& action)
{
  try
  {
    action();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

/// Outcome of a tare whose readings and motions `source` makes.
TareReport tareWith(ForceSensor& sensor, const std::function<void(int, Vector6d&, SensorMotion&)>& source)
{
  sensor.tare();
  for (int k = 0; k < kTareSamples; ++k)
  {
    Vector6d raw = gripper().bias + gravityWrench(gripper().payload, Matrix3d::Identity());
    SensorMotion motion;
    source(k, raw, motion);
    sensor.update(raw, motion);
  }
  return sensor.tareReport();
}
}  // namespace

TEST(TransformWrench, KeepsThePower)
{
  // Virtual work: the same wrench does the same work on the same rigid motion, wherever both are expressed.
  phri_core::Random random(1);
  for (int i = 0; i < 1000; ++i)
  {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  // of S in B
    pose.linear() = randomRotation(random);
    pose.translation() = Vector3d(random.normal(), random.normal(), random.normal());
    const Vector6d wrench = randomWrench(random);
    const Vector3d v(random.normal(), random.normal(), random.normal()), w(random.normal(), 0.3, random.normal());
    const Vector3d v_S = pose.linear().transpose() * (v + w.cross(pose.translation()));
    const Vector3d w_S = pose.linear().transpose() * w;
    const Vector6d moved = transformWrench(pose, wrench);
    EXPECT_NEAR(moved.head<3>().dot(v) + moved.tail<3>().dot(w), wrench.head<3>().dot(v_S) + wrench.tail<3>().dot(w_S),
                100.0 * kRounding);
  }
}

TEST(TransformWrench, HasTheMomentArm)
{
  // +x push of 10 N in the sensor, which sits 0.5 m along +y of the grasp: moment -5 Nm about z, force unchanged
  Eigen::Isometry3d sensor_in_grasp = Eigen::Isometry3d::Identity();
  sensor_in_grasp.translation() << 0.0, 0.5, 0.0;
  Vector6d push = Vector6d::Zero(), expected = Vector6d::Zero();
  push(0) = expected(0) = 10.0;
  expected(5) = -5.0;
  EXPECT_EQ(transformWrench(sensor_in_grasp, push), expected);
}

TEST(LowPass, SolvesItsDifferentialEquationExactly)
{
  // Oracle: Runge-Kutta with 400 steps per sample on a random staircase. Its error, (w h)^4 with w h < 0.01, is below.
  constexpr double tolerance = 1e-7;
  constexpr int kSteps = 400;
  for (const int order : { 1, 2 })
    for (const double cutoff : { 5.0, 80.0, 450.0 })
    {
      phri_core::Random random(2);
      LowPass filter(cutoff, order, kDt);
      const double w = 2.0 * M_PI * cutoff, h = kDt / kSteps;
      const auto derivative = [&](const Eigen::Vector2d& s, double u) {
        return order == 1 ? Eigen::Vector2d(w * (u - s(0)), 0.0)
                          : Eigen::Vector2d(s(1), w * w * (u - s(0)) - std::sqrt(2.0) * w * s(1));
      };
      Vector6d input = Vector6d::Zero();
      Eigen::Vector2d state(0.0, 0.0);
      filter.step(input);
      for (int k = 0; k < 200; ++k)
      {
        input(4) = random.normal(0.0, 10.0);
        for (int i = 0; i < kSteps; ++i)
        {
          const Eigen::Vector2d k1 = derivative(state, input(4)), k2 = derivative(state + 0.5 * h * k1, input(4)),
                                k3 = derivative(state + 0.5 * h * k2, input(4)),
                                k4 = derivative(state + h * k3, input(4));
          state += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
        const Vector6d output = filter.step(input);
        ASSERT_NEAR(output(4), state(0), tolerance) << order << ' ' << cutoff << ' ' << k;
        ASSERT_EQ(output(0), 0.0);  // channels do not mix
      }
    }
}

TEST(LowPass, StatesTheDelayOfARamp)
{
  for (const int order : { 1, 2 })
    for (const double cutoff : { 10.0, 100.0, 500.0 })
    {
      LowPass filter(cutoff, order, kDt);
      double lag = 0.0;
      for (int k = 0; k < 2000; ++k)
        lag = k * kDt - filter.step(Vector6d::Constant(k * kDt))(2);
      EXPECT_NEAR(lag, filter.delay(), kRounding);
    }
  // of the continuous filter it is 1 / w and sqrt(2) / w; the hold takes half a sample off
  EXPECT_NEAR(LowPass(10.0, 1, 1e-5).delay(), 1.0 / (20.0 * M_PI) - 0.5e-5, 1e-8);
  EXPECT_NEAR(LowPass(10.0, 2, 1e-5).delay(), std::sqrt(2.0) / (20.0 * M_PI) - 0.5e-5, 1e-8);
  EXPECT_EQ(LowPass(0.0, 1, kDt).delay(), 0.0);
}

TEST(LowPass, LosesHalfThePowerAtItsCutoff)
{
  for (const int order : { 1, 2 })
  {
    LowPass filter(20.0, order, 1e-4);
    double peak = 0.0;
    for (int k = 0; k < 20000; ++k)
    {
      const double output = filter.step(Vector6d::Constant(std::sin(2.0 * M_PI * 20.0 * k * 1e-4)))(0);
      if (k > 10000)
        peak = std::max(peak, output);
    }
    EXPECT_NEAR(peak, std::sqrt(0.5), 1e-4);  // (w dt)^2 / 24 of the hold is 7e-6
  }
}

TEST(ForceSensor, ReadsThePushWhateverTheOrientation)
{
  phri_core::Random random(3);
  ForceSensor sensor(gripper());
  for (int i = 0; i < 1000; ++i)
  {
    const SensorMotion motion = at(randomRotation(random));
    Vector6d push = randomWrench(random);
    if (i == 0)
      push << 7.0, 0.0, 0.0, 0.0, 0.0, 0.0;  // somebody pushes +x and +x is read
    const Vector6d raw = gripper().bias + gravityWrench(gripper().payload, motion.orientation) + push;
    const ForceReading reading = sensor.update(raw, motion);
    EXPECT_TRUE(reading.valid);
    EXPECT_LT((reading.wrench - push).norm(), 100.0 * kRounding);
  }
}

TEST(ForceSensor, RemovesInertiaWhereAsked)
{
  ForceSensorSettings settings = gripper();
  SensorMotion motion = at(Eigen::AngleAxisd(0.4, Vector3d::UnitY()).toRotationMatrix());
  motion.acceleration << 2.0, 0.0, 0.0;
  motion.angular_velocity << 0.0, 0.0, 1.0;
  const Vector6d raw = settings.bias + payloadWrench(settings.payload, motion);
  const Vector6d left = ForceSensor(settings).update(raw, motion).wrench;
  // without: the payload pulls back with m a, seen in the sensor's frame, and with m w^2 c (0.03 N)
  EXPECT_NEAR((motion.orientation * left.head<3>()).x(), -1.4 * 2.0, 0.1);
  settings.inertial = true;
  EXPECT_LT(ForceSensor(settings).update(raw, motion).wrench.norm(), 100.0 * kRounding);
}

TEST(ForceSensor, FlagsSaturationBeforeAnythingIsRemoved)
{
  ForceSensor sensor(gripper());
  Vector6d raw = Vector6d::Zero();
  raw(1) = -0.9499 * 200.0;
  EXPECT_FALSE(sensor.update(raw, {}).saturated);
  raw(1) = -0.95 * 200.0;
  EXPECT_TRUE(sensor.update(raw, {}).saturated);
  raw(1) = 0.0;
  raw(5) = 9.5;
  EXPECT_TRUE(sensor.update(raw, {}).saturated);
}

TEST(ForceSensor, AnInvalidReadingIsToldAndForgotten)
{
  ForceSensorSettings settings = gripper();
  settings.cutoff = 30.0;
  settings.order = 2;
  ForceSensor hit(settings), spared(settings);
  phri_core::Random random(4);
  SensorMotion bent, lost, unknown;
  bent.orientation *= 1.01;
  lost.orientation(1, 2) = kNan;
  unknown.velocity(0) = kNan;
  for (int k = 0; k < 100; ++k)
  {
    const Vector6d raw = randomWrench(random);
    EXPECT_EQ(hit.update(raw, {}).wrench, spared.update(raw, {}).wrench);
    Vector6d bad = raw;
    bad(k % 6) = k % 2 ? kNan : std::numeric_limits<double>::infinity();
    for (const ForceReading& reading :
         { hit.update(bad, {}), hit.update(raw, bent), hit.update(raw, lost), hit.update(raw, unknown) })
    {
      EXPECT_FALSE(reading.valid);
      EXPECT_TRUE(reading.wrench.array().isNaN().all());
    }
  }
}

TEST(Tare, FindsTheBiasInAnyPose)
{
  phri_core::Random random(5);
  for (int run = 0; run < 30; ++run)
  {
    ForceSensor sensor(gripper());
    const SensorMotion motion = at(randomRotation(random));
    Vector6d drift = randomWrench(random) * 0.3;
    sensor.tare();
    for (int k = 0; k < kTareSamples; ++k)
    {
      EXPECT_EQ(sensor.tareReport().state, TareState::Running);
      Vector6d raw = gripper().bias + drift + gravityWrench(gripper().payload, motion.orientation);
      for (int i = 0; i < 6; ++i)
        raw(i) += random.normal(0.0, i < 3 ? 0.05 : 0.003);
      sensor.update(raw, motion);
    }
    ASSERT_EQ(sensor.tareReport().state, TareState::Done) << describe(sensor.tareReport());
    // mean of 500 samples: deviation noise / sqrt(500); five of them for 180 draws
    const Vector6d error = sensor.bias() - gripper().bias - drift;
    EXPECT_LT(error.head<3>().cwiseAbs().maxCoeff(), 5.0 * 0.05 / std::sqrt(500.0));
    EXPECT_LT(error.tail<3>().cwiseAbs().maxCoeff(), 5.0 * 0.003 / std::sqrt(500.0));
  }
}

TEST(Tare, MovesTheFilterAlongWithTheBias)
{
  // A filtered constant is the constant: after the tare the output is zero at once, there is no transient.
  ForceSensorSettings settings = gripper();
  settings.cutoff = 1.0;
  ForceSensor sensor(settings);
  const Vector6d raw =
      gripper().bias + gravityWrench(gripper().payload, Matrix3d::Identity()) + Vector6d::Constant(0.5);
  EXPECT_NEAR(sensor.update(raw, {}).wrench(0), 0.5, kRounding);
  sensor.tare();
  for (int k = 0; k < kTareSamples; ++k)
    sensor.update(raw, {});
  EXPECT_LT(sensor.update(raw, {}).wrench.norm(), 100.0 * kRounding);
}

TEST(Tare, IsRefusedWithValueAndBound)
{
  struct Case
  {
    TareCause cause;
    double value, bound;
    std::string words;
    std::function<void(int, Vector6d&, SensorMotion&)> source;
  };
  const double swing = std::sqrt(500.0 / 499.0);  // deviation of +-1 in turn over 500 samples
  const std::vector<Case> cases = {
    { TareCause::Speed, 0.02, 0.005, "the sensor's speed is 0.02 m/s, expected at most 0.005 m/s",
      [](int k, Vector6d&, SensorMotion& m) { m.velocity(1) = k == 300 ? 0.02 : 0.0; } },
    { TareCause::Turning, 0.05, 0.01, "angular speed is 0.05 rad/s",
      [](int, Vector6d&, SensorMotion& m) { m.angular_velocity(2) = 0.05; } },
    { TareCause::Turned, 0.011, 0.01, "turn is 0.011 rad",
      [](int k, Vector6d&, SensorMotion& m) {
        m.orientation = Eigen::AngleAxisd(k == 400 ? 0.011 : 0.0, Vector3d(1, 2, 2) / 3.0).toRotationMatrix();
      } },
    { TareCause::ForceScatter, 0.5 * swing, 0.3, "scatter of the force is 0.5005",
      [](int k, Vector6d& raw, SensorMotion&) { raw(2) += k % 2 ? 0.5 : -0.5; } },
    { TareCause::TorqueScatter, 0.03 * swing, 0.02, "scatter of the torque is 0.03003",
      [](int k, Vector6d& raw, SensorMotion&) { raw(4) += k % 2 ? 0.03 : -0.03; } },
    { TareCause::ForceChange, 25.0, 20.0, "change of the force's bias is 25 N, expected at most 20 N",
      [](int, Vector6d& raw, SensorMotion&) { raw(0) -= 25.0; } },
    { TareCause::TorqueChange, 1.5, 1.0, "change of the torque's bias is 1.5 Nm",
      [](int, Vector6d& raw, SensorMotion&) { raw(3) += 1.5; } },
    { TareCause::Saturated, 0.0, 0.0, "saturated readings",
      [](int k, Vector6d& raw, SensorMotion&) { raw(0) = k == 499 ? 199.0 : raw(0); } },
    { TareCause::Invalid, 0.0, 0.0, "not finite",
      [](int k, Vector6d& raw, SensorMotion&) { raw(5) = k == 10 ? kNan : raw(5); } },
  };
  for (const Case& test : cases)
  {
    ForceSensor sensor(gripper());
    const TareReport report = tareWith(sensor, test.source);
    EXPECT_EQ(report.state, TareState::Refused) << test.words;
    EXPECT_EQ(report.cause, test.cause) << test.words;
    EXPECT_NEAR(report.value, test.value, 1e-9) << test.words;
    EXPECT_EQ(report.bound, test.bound) << test.words;
    EXPECT_NE(describe(report).find(test.words), std::string::npos) << describe(report);
    EXPECT_EQ(sensor.bias(), gripper().bias) << test.words;
    // and the next one, at rest, is granted
    EXPECT_EQ(tareWith(sensor, [](int, Vector6d&, SensorMotion&) {}).state, TareState::Done);
  }
}

TEST(ForceSensor, AllocatesNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP();
  ForceSensorSettings settings = gripper();
  settings.cutoff = 100.0;
  settings.inertial = true;
  ForceSensor sensor(settings);
  Vector6d bad = Vector6d::Constant(kNan);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  const long count = phri_core::testing::countAllocations([&] {
    for (int k = 0; k < 3000; ++k)
    {
      if (k % 600 == 0)
        sensor.tare();
      transformWrench(pose, sensor.update(k == 2500 ? bad : Vector6d(settings.bias), {}).wrench);
      sensor.tareReport();
    }
  });
  EXPECT_EQ(count, 0);
}

TEST(ForceSensor, RefusesBadSettings)
{
  const auto error = [](const std::function<void(ForceSensorSettings&)>& spoil) {
    ForceSensorSettings settings = gripper();
    spoil(settings);
    return errorOf([&] { ForceSensor sensor(settings); });
  };
  const auto expect = [](const std::string& found, const std::string& part) {
    EXPECT_NE(found.find(part), std::string::npos) << found;
  };
  expect(error([](auto& s) { s.payload.mass = -1.0; }),
         "ft_sensor/payload/mass = -1 kg: expected a number from 0 to 50");
  expect(error([](auto& s) { s.payload.centre(1) = kNan; }), "ft_sensor/payload/centre(1, 0) = nan");
  expect(error([](auto& s) { s.payload.inertia(0, 0) = -1.0; }), "ft_sensor/payload/inertia has the eigenvalue -1");
  expect(error([](auto& s) { s.cutoff = 501.0; }), "low-pass cutoff = 501 Hz: expected a number from 0 to 500");
  expect(error([](auto& s) { s.cutoff = kNan; }), "low-pass cutoff = nan");
  expect(error([](auto& s) { s.order = 3; }), "low-pass order = 3: expected a number from 1 to 2");
  expect(error([](auto& s) { s.tare_time = 0.0; }), "ft_sensor/tare/time = 0 s");
  expect(error([](auto& s) { s.bias(2) = kNan; }), "ft_sensor/bias(2, 0) = nan");
}
