// Payload of a force/torque sensor: its weight and inertia in the reading, and its identification from poses at rest.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "phri_control/payload.hpp"
#include "phri_core/random.hpp"

using namespace phri_control;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace
{
constexpr double kExact = 1e-9;                             // least squares of well-conditioned problems of order 1
constexpr double kRounding = 1e-12;                         // a few operations on numbers up to 100
constexpr double kForceNoise = 0.05, kTorqueNoise = 0.003;  // [N, Nm] JR3, one sample

Vector3d randomVector(phri_core::Random& random, double size)
{
  return Vector3d(random.normal(), random.normal(), random.normal()).normalized() * size;
}

/// Uniform over all rotations.
Matrix3d randomRotation(phri_core::Random& random)
{
  Eigen::Quaterniond q(random.normal(), random.normal(), random.normal(), random.normal());
  return q.normalized().toRotationMatrix();
}

struct Bench
{
  Payload payload;
  Vector6d bias;
  std::vector<Matrix3d> orientations;
  std::vector<Vector6d> wrenches;

  Bench(phri_core::Random& random, int poses)
  {
    payload.mass = random.uniform(0.2, 5.0);
    payload.centre = randomVector(random, random.uniform(0.0, 0.3));
    for (int i = 0; i < 6; ++i)
      bias(i) = random.normal(0.0, i < 3 ? 10.0 : 0.5);
    for (int i = 0; i < poses; ++i)
      orientations.push_back(randomRotation(random));
    read();
  }
  /// Readings by hand: weight m g points down in the inertial frame, and acts at c.
  void read()
  {
    wrenches.clear();
    for (const Matrix3d& R : orientations)
    {
      const Vector3d weight = R.transpose() * Vector3d(0.0, 0.0, -9.81 * payload.mass);
      Vector6d w;
      w << weight, payload.centre.cross(weight);
      wrenches.push_back(w + bias);
    }
  }
};

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

bool has(const std::string& text, const std::string& part)
{
  return text.find(part) != std::string::npos;
}
}  // namespace

TEST(PayloadWrench, IsTheRotatedWeightAtItsCentre)
{
  const Payload payload{ 2.0, Vector3d(0.1, 0.0, 0.3) };
  Vector6d upright;  // c x (0, 0, -mg) = (-c_y, c_x, 0) mg
  upright << 0.0, 0.0, -19.62, 0.0, 1.962, 0.0;
  EXPECT_LT((gravityWrench(payload, Matrix3d::Identity()) - upright).cwiseAbs().maxCoeff(), kRounding);
  // turned by 90 degrees about y, sensor's z points along the horizontal: weight along the sensor's +x
  const Matrix3d turned = Eigen::AngleAxisd(M_PI_2, Vector3d::UnitY()).toRotationMatrix();
  Vector6d sideways;
  sideways << 19.62, 0.0, 0.0, 0.0, 0.3 * 19.62, 0.0;
  EXPECT_LT((gravityWrench(payload, turned) - sideways).cwiseAbs().maxCoeff(), kRounding);
}

TEST(PayloadWrench, OfAPureForceHasNoMomentInAnyPose)
{
  // gravity compensation rotates: with the centre of mass in the sensor's origin there is no moment to invent
  phri_core::Random random(1);
  for (int i = 0; i < 1000; ++i)
  {
    const Vector6d wrench = gravityWrench({ 3.0, Vector3d::Zero() }, randomRotation(random));
    EXPECT_EQ(wrench.tail<3>().norm(), 0.0);
    EXPECT_NEAR(wrench.head<3>().norm(), 3.0 * 9.81, kRounding);
  }
}

TEST(PayloadWrench, IsWhatFallingMassPointsExert)
{
  // Oracle: a body of mass points on a known motion R(t), p(t); each exerts m (g - a), a by differences of its path.
  // Second differences with step h: truncation h^2 w^4 / 12 ~ 1e-6, rounding 1e-16 / h^2 ~ 1e-8.
  constexpr double h = 1e-4, tolerance = 2e-5;
  phri_core::Random random(2);
  for (int run = 0; run < 50; ++run)
  {
    std::vector<double> masses;
    std::vector<Vector3d> points;
    Payload body;
    for (int i = 0; i < 6; ++i)
    {
      masses.push_back(random.uniform(0.1, 0.6));
      points.push_back(randomVector(random, 0.2));
      body.mass += masses.back();
      body.centre += masses.back() * points.back();
    }
    body.centre /= body.mass;
    for (int i = 0; i < 6; ++i)
    {
      const Vector3d r = points[i] - body.centre;
      body.inertia += masses[i] * (r.squaredNorm() * Matrix3d::Identity() - r * r.transpose());
    }
    const Vector3d axis = randomVector(random, 1.0), swing = randomVector(random, 0.3);
    const Matrix3d start = randomRotation(random);
    const double a = random.uniform(-2.0, 2.0), b = random.uniform(-3.0, 3.0), w = random.uniform(1.0, 4.0);
    const auto rotation = [&](double t) {
      return Matrix3d(Eigen::AngleAxisd(a * t + 0.5 * b * t * t, axis).toRotationMatrix() * start);
    };
    const auto place = [&](double t) { return Vector3d(swing * std::sin(w * t)); };
    const double t = random.uniform(0.0, 1.0);
    SensorMotion motion;
    motion.orientation = rotation(t);
    motion.velocity = swing * w * std::cos(w * t);
    motion.acceleration = -swing * w * w * std::sin(w * t);
    motion.angular_velocity = axis * (a + b * t);
    motion.angular_acceleration = axis * b;

    Vector3d force = Vector3d::Zero(), torque = Vector3d::Zero();
    for (int i = 0; i < 6; ++i)
    {
      const auto path = [&](double s) { return Vector3d(place(s) + rotation(s) * points[i]); };
      const Vector3d acceleration = (path(t + h) - 2.0 * path(t) + path(t - h)) / (h * h);
      const Vector3d exerted = masses[i] * (Vector3d(0.0, 0.0, -9.81) - acceleration);
      force += exerted;
      torque += (path(t) - place(t)).cross(exerted);
    }
    Vector6d expected;
    expected << motion.orientation.transpose() * force, motion.orientation.transpose() * torque;
    EXPECT_LT((payloadWrench(body, motion) - expected).cwiseAbs().maxCoeff(), tolerance);
  }
}

TEST(IdentifyPayload, IsExactWithoutNoise)
{
  phri_core::Random random(3);
  for (int run = 0; run < 200; ++run)
  {
    const Bench bench(random, 8 + run % 5);
    const PayloadEstimate found = identifyPayload(bench.orientations, bench.wrenches);
    EXPECT_NEAR(found.payload.mass, bench.payload.mass, kExact);
    EXPECT_LT((found.payload.centre - bench.payload.centre).norm(), kExact);
    EXPECT_LT((found.bias - bench.bias).norm(), kExact);
    EXPECT_LT(found.force_residual + found.torque_residual, kExact);
    EXPECT_EQ(found.residuals.size(), bench.wrenches.size());
  }
}

TEST(IdentifyPayload, HasTheConditionOfIdealPoses)
{
  // Gravity twice along each of +-x, +-y, +-z: columns orthogonal, of length sqrt(12) for mass and bias and
  // sqrt(12 * 2 / 3) for the centre of mass.
  std::vector<Matrix3d> orientations;
  for (int i = 0; i < 12; ++i)
    orientations.push_back(
        Eigen::Quaterniond::FromTwoVectors(Vector3d::Unit(i % 3) * (i % 2 ? 1.0 : -1.0), Vector3d::UnitZ())
            .toRotationMatrix());
  phri_core::Random random(4);
  Bench bench(random, 0);
  bench.orientations = orientations;
  bench.read();
  EXPECT_NEAR(identifyPayload(bench.orientations, bench.wrenches).condition, std::sqrt(1.5), kExact);
}

TEST(IdentifyPayload, StatesItsErrorsUnderNoise)
{
  // Monte Carlo oracle of the covariance: over many draws of the noise, the scatter of the estimates is what each
  // estimate states, and there is no bias. One sample of noise per pose; a recorded mean of n is sqrt(n) better.
  constexpr int kRuns = 4000;
  // Relative standard error of a deviation over the runs is 1 / sqrt(2 * 4000) = 1.1 %: four of them.
  constexpr double kSpread = 0.045, kMean = 4.0;
  phri_core::Random random(5);
  const Bench bench(random, 12);
  const int size = 10;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(size), squares = sum, stated = sum;
  double force_power = 0.0, torque_power = 0.0;
  for (int run = 0; run < kRuns; ++run)
  {
    std::vector<Vector6d> noisy = bench.wrenches;
    for (Vector6d& wrench : noisy)
      for (int i = 0; i < 6; ++i)
        wrench(i) += random.normal(0.0, i < 3 ? kForceNoise : kTorqueNoise);
    const PayloadEstimate found = identifyPayload(bench.orientations, noisy);
    Eigen::VectorXd error(size), deviation(size);
    error << found.payload.mass - bench.payload.mass, found.payload.centre - bench.payload.centre,
        found.bias - bench.bias;
    deviation << found.mass_deviation, found.centre_deviation, found.bias_deviation;
    sum += error;
    squares += error.cwiseAbs2();
    stated += deviation.cwiseAbs2();
    force_power += found.force_residual * found.force_residual;
    torque_power += found.torque_residual * found.torque_residual;
  }
  for (int i = 0; i < size; ++i)
  {
    EXPECT_NEAR(std::sqrt(squares(i) / stated(i)), 1.0, kSpread) << i;
    EXPECT_LT(std::abs(sum(i) / kRuns), kMean * std::sqrt(stated(i) / kRuns / kRuns)) << i;
  }
  // 36 readings less the parameters fitted to them (4 and 6)
  EXPECT_NEAR(std::sqrt(force_power / kRuns) / (kForceNoise * std::sqrt(32.0 / 36.0)), 1.0, kSpread);
  EXPECT_NEAR(std::sqrt(torque_power / kRuns) / (kTorqueNoise * std::sqrt(30.0 / 36.0)), 1.0, kSpread);
}

TEST(IdentifyPayload, NamesWhatThePosesDoNotTell)
{
  phri_core::Random random(6);
  Bench bench(random, 0);
  // turned about the vertical only: gravity never moves in the sensor's frame
  for (int i = 0; i < 10; ++i)
    bench.orientations.push_back(Eigen::AngleAxisd(0.6 * i, Vector3d::UnitZ()).toRotationMatrix());
  bench.read();
  std::string error = errorOf([&] { identifyPayload(bench.orientations, bench.wrenches); });
  EXPECT_TRUE(has(error, "do not tell the mass from the bias: excitation") && has(error, "at least 0.1")) << error;

  // two directions of gravity, +z and +x: the centre along their difference is not told, all else is
  bench.orientations.clear();
  for (int i = 0; i < 10; ++i)
    bench.orientations.push_back(Eigen::AngleAxisd(i % 2 ? M_PI_2 : 0.0, Vector3d::UnitY()).toRotationMatrix());
  bench.read();
  error = errorOf([&] { identifyPayload(bench.orientations, bench.wrenches); });
  EXPECT_FALSE(has(error, "the mass from")) << error;
  EXPECT_TRUE(has(error, "centre of mass along (0.71, 0, 0.71)") ||
              has(error, "centre of mass along (-0.71, 0, -0.71)"))
      << error;

  // a full turn about one horizontal axis is enough for everything
  bench.orientations.clear();
  for (int i = 0; i < 10; ++i)
    bench.orientations.push_back(Eigen::AngleAxisd(0.6 * i, Vector3d::UnitX()).toRotationMatrix());
  bench.read();
  EXPECT_LT((identifyPayload(bench.orientations, bench.wrenches).payload.centre - bench.payload.centre).norm(), kExact);
}

TEST(IdentifyPayload, RefusesBadInputAllAtOnce)
{
  phri_core::Random random(7);
  Bench bench(random, 9);
  bench.orientations[2] *= 1.01;
  bench.orientations[5].col(0) *= -1.0;  // orthogonal, but a reflection
  bench.wrenches[7](4) = std::numeric_limits<double>::quiet_NaN();
  const std::string error = errorOf([&] { identifyPayload(bench.orientations, bench.wrenches); });
  EXPECT_TRUE(has(error, "pose 2 is not a rotation") && has(error, "pose 5 is not a rotation") &&
              has(error, "det R = -1") && has(error, "wrench 7 is not finite"))
      << error;

  Bench few(random, 7);
  few.wrenches.pop_back();
  const std::string counts = errorOf([&] { identifyPayload(few.orientations, few.wrenches); });
  EXPECT_TRUE(has(counts, "7 poses, expected at least 8") && has(counts, "7 orientations and 6 wrenches")) << counts;
}

TEST(IdentifyPayload, SaysThatSignsAreTurned)
{
  // what the robot exerts on the payload instead of the opposite: the most frequent mistake
  phri_core::Random random(8);
  Bench bench(random, 10);
  for (Vector6d& wrench : bench.wrenches)
    wrench *= -1.0;
  EXPECT_TRUE(has(errorOf([&] { identifyPayload(bench.orientations, bench.wrenches); }), "opposite sign"));
  for (Vector6d& wrench : bench.wrenches)
    wrench = bench.bias;
  EXPECT_TRUE(has(errorOf([&] { identifyPayload(bench.orientations, bench.wrenches); }), "nothing hangs"));
}
