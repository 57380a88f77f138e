// Simulated force/torque sensor: what its settings say is what comes out, and calibration, tare and compensation undo
// it.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "phri_core/testing.hpp"
#include "phri_sim/ft_sensor.hpp"

using namespace phri_sim;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using phri_control::Vector6d;

namespace
{
constexpr double kDt = 0.001;  // [s]
constexpr int kMinute = 60000;
constexpr double kRounding = 1e-9;

FtSensorSettings ideal()
{
  FtSensorSettings settings;
  settings.force_noise = settings.torque_noise = settings.force_bias = settings.torque_bias = 0.0;
  settings.force_drift = settings.torque_drift = settings.cutoff = 0.0;
  return settings;
}

Matrix3d randomRotation(phri_core::Random& random)
{
  return Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal())
      .normalized()
      .toRotationMatrix();
}
}  // namespace

TEST(FtSensor, QuantisesAndSaturates)
{
  FtSensor sensor(ideal(), kDt, 1, "left");
  phri_core::Random random(2);
  const double step[2] = { 200.0 / 16384.0, 10.0 / 16384.0 }, range[2] = { 200.0, 10.0 };
  for (int k = 0; k < 5000; ++k)
  {
    Vector6d wrench;
    for (int i = 0; i < 6; ++i)
      wrench(i) = random.uniform(-1.5, 1.5) * range[i / 3];
    const Vector6d reading = sensor.read(wrench);
    for (int i = 0; i < 6; ++i)
    {
      const int kind = i / 3;
      EXPECT_NEAR(std::remainder(reading(i), step[kind]), 0.0, kRounding);
      if (std::abs(wrench(i)) >= range[kind])
        EXPECT_EQ(reading(i), std::copysign(range[kind], wrench(i)));
      else
        EXPECT_LE(std::abs(reading(i) - wrench(i)), 0.5 * step[kind] + kRounding);
    }
  }
}

TEST(FtSensor, HasTheStatedWhiteNoise)
{
  FtSensorSettings settings = ideal();
  settings.force_noise = 0.05;
  settings.torque_noise = 0.003;
  FtSensor sensor(settings, kDt, 3, "left");
  constexpr int kReadings = 100000;
  Vector6d sum = Vector6d::Zero(), squares = sum, products = sum, before = sum;
  for (int k = 0; k < kReadings; ++k)
  {
    const Vector6d reading = sensor.read(Vector6d::Zero());
    sum += reading;
    squares += reading.cwiseAbs2();
    products += reading.cwiseProduct(before);
    before = reading;
  }
  for (int i = 0; i < 6; ++i)
  {
    const double step = (i < 3 ? 200.0 : 10.0) / 16384.0, noise = i < 3 ? 0.05 : 0.003;
    // rounding adds the variance of a uniform error; 1 % is 4.5 standard errors
    EXPECT_NEAR(std::sqrt(squares(i) / kReadings), std::sqrt(noise * noise + step * step / 12.0), 0.01 * noise) << i;
    EXPECT_LT(std::abs(sum(i) / kReadings), 5.0 * noise / std::sqrt(kReadings)) << i;
    EXPECT_LT(std::abs(products(i) / squares(i)), 5.0 / std::sqrt(kReadings)) << i;
  }
}

TEST(FtSensor, BiasAndDriftHaveTheStatedScatter)
{
  // 600 sensors x 3 axes: a deviation is told to 1 / sqrt(3600) = 1.7 %
  constexpr double kSpread = 0.07;
  FtSensorSettings settings = ideal();
  settings.force_bias = 2.0;
  settings.torque_bias = 0.1;
  settings.force_drift = 0.1;
  settings.torque_drift = 0.005;
  double offset[2] = {}, rate[2] = {};
  for (int n = 0; n < 600; ++n)
  {
    FtSensor sensor(settings, kDt * 60.0, n, "left");  // 60 ms a reading: a minute in 1000
    const Vector6d first = sensor.bias();
    EXPECT_NEAR(sensor.read(Vector6d::Zero())(0), first(0), 200.0 / 16384.0);
    for (int k = 1; k < kMinute / 60; ++k)
      sensor.read(Vector6d::Zero());
    const Vector6d drift = sensor.bias() - first;
    for (int i = 0; i < 6; ++i)
    {
      offset[i / 3] += first(i) * first(i) / 1800.0;
      rate[i / 3] += drift(i) * drift(i) / 1800.0;
    }
  }
  EXPECT_NEAR(std::sqrt(offset[0]) / 2.0, 1.0, kSpread);
  EXPECT_NEAR(std::sqrt(offset[1]) / 0.1, 1.0, kSpread);
  EXPECT_NEAR(std::sqrt(rate[0]) / 0.1, 1.0, kSpread);
  EXPECT_NEAR(std::sqrt(rate[1]) / 0.005, 1.0, kSpread);
}

TEST(FtSensor, FiltersBeforeItSamples)
{
  FtSensorSettings settings = ideal();
  settings.cutoff = 50.0;
  FtSensor sensor(settings, kDt, 1, "left");
  double peak = 0.0;
  for (int k = 0; k < 2000; ++k)
  {
    const Vector6d reading = sensor.read(Vector6d::Constant(5.0 + (k % 2 ? 4.0 : -4.0)));
    EXPECT_EQ(reading(0), reading(1));
    if (k > 1000)
      peak = std::max(peak, std::abs(reading(0) - 5.0));
  }
  // alternating input of a first-order lag with decay a: amplitude (1 - a) / (1 + a)
  const double a = std::exp(-2.0 * M_PI * 50.0 * kDt);
  EXPECT_NEAR(peak, 4.0 * (1.0 - a) / (1.0 + a), 200.0 / 16384.0);
}

TEST(FtSensor, IsTheSameForTheSameSeedAndName)
{
  const auto readings = [](std::uint64_t seed, const char* name) {
    FtSensor sensor(FtSensorSettings(), kDt, seed, name);
    Vector6d sum = Vector6d::Zero();
    for (int k = 0; k < 10; ++k)
      sum += sensor.read(Vector6d::Constant(1.0));
    return sum;
  };
  EXPECT_EQ(readings(7, "lwr_left"), readings(7, "lwr_left"));
  EXPECT_NE(readings(7, "lwr_left"), readings(7, "lwr_right"));
  EXPECT_NE(readings(7, "lwr_left"), readings(8, "lwr_left"));
}

TEST(FtSensor, ForgetsWhatIsNotFinite)
{
  FtSensor hit(FtSensorSettings(), kDt, 1, "left"), spared(FtSensorSettings(), kDt, 1, "left");
  for (int k = 0; k < 20; ++k)
  {
    const Vector6d wrench = Vector6d::Constant(0.1 * k);
    Vector6d bad = wrench;
    bad(3) = std::numeric_limits<double>::infinity();
    const bool spoil = k == 7;
    const Vector6d reading = hit.read(spoil ? bad : wrench), expected = spared.read(wrench);
    if (spoil)
      EXPECT_TRUE(reading.array().isNaN().all());
    else if (k < 7)
      EXPECT_EQ(reading, expected);
    else  // the filter has missed one sample: e^-pi of a step of 0.1 N right after, and ever less
      EXPECT_LT((reading - expected).head<3>().cwiseAbs().maxCoeff(), 0.1 * std::exp(-M_PI) + 200.0 / 16384.0);
  }
}

TEST(FtSensor, AllocatesNothingPerReading)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP();
  FtSensor sensor(FtSensorSettings(), kDt, 1, "left");
  EXPECT_EQ(phri_core::testing::countAllocations([&] {
              for (int k = 0; k < 1000; ++k)
                sensor.read(Vector6d::Zero());
            }),
            0);
}

TEST(FtSensor, RefusesBadSettings)
{
  FtSensorSettings settings;
  settings.torque_range = -1.0;
  try
  {
    FtSensor sensor(settings, kDt, 1, "left");
    FAIL();
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_EQ(std::string(error.what()), "ft_sensor/sim/torque_range = -1 Nm: expected a number from 0.1 to 1000");
  }
}

TEST(FtSensor, CalibratedAndTaredItReadsThePush)
{
  // The whole chain, as a lab does it: 12 poses of half a second, identification, ten minutes of drift, tare in one
  // pose, a push of 5 N along +x in another pose, read in the sensor's and in the grasp's frame.
  phri_core::Random random(11);
  const phri_control::Payload gripper{ 1.2, Vector3d(0.004, -0.01, 0.08) };
  FtSensor sensor(FtSensorSettings(), kDt, 5, "arm_left");
  std::vector<Matrix3d> orientations;
  std::vector<Vector6d> wrenches;
  for (int pose = 0; pose < 12; ++pose)
  {
    orientations.push_back(randomRotation(random));
    Vector6d mean = Vector6d::Zero();
    for (int k = 0; k < 500; ++k)
      mean += sensor.read(phri_control::gravityWrench(gripper, orientations.back())) / 500.0;
    wrenches.push_back(mean);
  }
  const phri_control::PayloadEstimate found = phri_control::identifyPayload(orientations, wrenches);
  // Per pose and axis: noise 0.05 / sqrt(500) = 2 mN, rounding averaged out by it, drift of 0.1 N/min over 6 s: 10 mN.
  constexpr double kForce = 0.02, kTorque = 0.002;  // [N, Nm] of the identified wrench
  EXPECT_NEAR(found.payload.mass, gripper.mass, kForce / 9.81);
  EXPECT_LT((found.payload.centre - gripper.centre).norm(), kTorque / (1.2 * 9.81));
  EXPECT_LT(found.force_residual, kForce);
  EXPECT_LT(found.torque_residual, kTorque);

  for (int k = 0; k < 10 * kMinute; ++k)
    sensor.read(Vector6d::Zero());
  phri_control::ForceSensorSettings settings;
  settings.payload = found.payload;
  settings.bias = found.bias;
  phri_control::ForceSensor compensated(settings);
  phri_control::SensorMotion motion;
  motion.orientation = randomRotation(random);
  compensated.tare();
  for (int k = 0; k < 500; ++k)
    compensated.update(sensor.read(phri_control::gravityWrench(gripper, motion.orientation)), motion);
  ASSERT_EQ(compensated.tareReport().state, phri_control::TareState::Done);
  EXPECT_GT((compensated.bias() - found.bias).head<3>().norm(), 0.1);  // the drift was there to be found

  motion.orientation = randomRotation(random);
  Vector6d push = Vector6d::Zero(), mean = push;
  push(0) = 5.0;
  for (int k = 0; k < 1000; ++k)
  {
    const Vector6d raw = sensor.read(phri_control::gravityWrench(gripper, motion.orientation) + push);
    const phri_control::ForceReading reading = compensated.update(raw, motion);
    if (k >= 500)
      mean += reading.wrench / 500.0;
  }
  EXPECT_LT((mean - push).head<3>().norm(), 2.0 * kForce);
  EXPECT_LT((mean - push).tail<3>().norm(), 2.0 * kTorque);
  Eigen::Isometry3d sensor_in_grasp = Eigen::Isometry3d::Identity();
  sensor_in_grasp.translation() << 0.0, 0.0, -0.15;
  EXPECT_NEAR(phri_control::transformWrench(sensor_in_grasp, mean)(4), -0.75, 2.0 * kTorque + 0.15 * 2.0 * kForce);
}
