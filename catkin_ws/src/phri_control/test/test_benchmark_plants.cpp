// The plants: every analytic derivative against numerical differentiation, and mechanics that need no derivative.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <vector>

#include "phri_control/benchmark_plants.hpp"
#include "phri_core/random.hpp"

using namespace phri_control;
using Eigen::Vector2d;
using Eigen::Vector4d;

namespace
{
constexpr int kStates = 1000;
// Central differences with h = 1e-5 of functions with values and derivatives of order 1 to 1e3: truncation h^2 f''' and
// rounding 1e-16 / h are both below 1e-8 of the largest derivative.
constexpr double kStep = 1e-5, kDifferenceTolerance = 1e-7;

struct Case
{
  const char* name;
  std::shared_ptr<const Plant> plant;
};

std::vector<Case> plants()
{
  return { { "point mass", std::make_shared<PointMass>(Vector2d(1.3, 0.7), Vector2d(0.4, 2.0)) },
           { "driven point mass",
             std::make_shared<PointMass>(Vector2d(1.3, 0.7), Vector2d(0.4, 2.0), DrivingForce{ 10.0 }) },
           { "arm, joint torque", std::make_shared<TwoLinkArm>() },
           { "arm, workspace force", std::make_shared<TwoLinkArm>(ArmParameters(), ArmInput::WorkspaceForce) },
           { "car", std::make_shared<CarLikeRobot>() } };
}

PlantState randomState(phri_core::Random& random, Eigen::Index n)
{
  PlantState x(n);
  for (Eigen::Index i = 0; i < n; ++i)
    x(i) = random.uniform(-3.0, 3.0);
  return x;
}

Vector2d randomControl(phri_core::Random& random)
{
  return { random.uniform(-5.0, 5.0), random.uniform(-5.0, 5.0) };
}

/// Largest difference relative to the larger of 1 and the largest element.
double difference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b)
{
  return (a - b).cwiseAbs().maxCoeff() / std::max(1.0, a.cwiseAbs().maxCoeff());
}

/// Derivative of `function` (any vector) at x by central differences.
template <typename Function, typename Point>
Eigen::MatrixXd numericalJacobian(const Function& function, const Point& x)
{
  Eigen::MatrixXd jacobian;
  for (Eigen::Index i = 0; i < x.size(); ++i)
  {
    Point up = x, down = x;
    up(i) += kStep;
    down(i) -= kStep;
    const Eigen::VectorXd slope = (function(up) - function(down)) / (up(i) - down(i));
    jacobian.conservativeResize(slope.size(), x.size());
    jacobian.col(i) = slope;
  }
  return jacobian;
}
}  // namespace

TEST(BenchmarkPlants, DerivativesOfTheStepAgreeWithDifferences)
{
  for (const Case& item : plants())
    for (const Integrator integrator : { Integrator::Euler, Integrator::RungeKutta4 })
    {
      SCOPED_TRACE(std::string(item.name) + (integrator == Integrator::Euler ? ", Euler" : ", Runge-Kutta"));
      phri_core::Random random(11);
      double worst = 0.0;
      for (int i = 0; i < kStates; ++i)
      {
        const PlantState x = randomState(random, item.plant->stateSize());
        const Vector2d u = randomControl(random);
        const double dt = random.uniform(0.001, 0.05);
        const auto stepped = [&](const PlantState& from, const Vector2d& with) {
          PlantState next;
          step(*item.plant, integrator, dt, from, with, next);
          return Eigen::VectorXd(next);
        };
        PlantMatrix A;
        PlantInput B;
        linearise(*item.plant, integrator, dt, x, u, A, B);
        worst =
            std::max({ worst, difference(A, numericalJacobian([&](const PlantState& p) { return stepped(p, u); }, x)),
                       difference(B, numericalJacobian([&](const Vector2d& v) { return stepped(x, v); }, u)) });
      }
      EXPECT_LT(worst, kDifferenceTolerance);
    }
}

TEST(BenchmarkPlants, OutputDerivativesAgreeWithDifferences)
{
  for (const Case& item : plants())
  {
    SCOPED_TRACE(item.name);
    phri_core::Random random(12);
    double first = 0.0, second = 0.0;
    for (int i = 0; i < kStates; ++i)
    {
      const PlantState x = randomState(random, item.plant->stateSize());
      const Vector4d weight(random.normal(), random.normal(), random.normal(), random.normal());
      MotionJacobian jacobian;
      item.plant->motionJacobian(x, jacobian);
      first = std::max(
          first,
          difference(jacobian, numericalJacobian(
                                   [&](const PlantState& p) { return Eigen::VectorXd(item.plant->motion(p)); }, x)));
      PlantMatrix hessian = PlantMatrix::Constant(x.size(), x.size(), 2.0);  // it adds to what is there
      item.plant->addMotionCurvature(x, weight, hessian);
      const auto gradient = [&](const PlantState& p) {
        MotionJacobian at;
        item.plant->motionJacobian(p, at);
        return Eigen::VectorXd(at.transpose() * weight);
      };
      second = std::max(second, difference((hessian.array() - 2.0).matrix(), numericalJacobian(gradient, x)));
    }
    EXPECT_LT(first, kDifferenceTolerance);
    EXPECT_LT(second, kDifferenceTolerance);
  }
}

TEST(BenchmarkPlants, VelocityIsTheRateOfThePosition)
{
  // The chain rule, dp/dx f(x, u): it ties the kinematics to the dynamics whatever the control.
  for (const Case& item : plants())
  {
    phri_core::Random random(13);
    for (int i = 0; i < kStates; ++i)
    {
      const PlantState x = randomState(random, item.plant->stateSize());
      PlantState xdot(x.size());
      item.plant->rate(x, randomControl(random), xdot);
      MotionJacobian jacobian;
      item.plant->motionJacobian(x, jacobian);
      EXPECT_NEAR((jacobian.topRows<2>() * xdot - item.plant->motion(x).tail<2>()).norm(), 0.0, 1e-12) << item.name;
    }
  }
}

TEST(BenchmarkPlants, RungeKuttaIsOfFourthOrderAndEulerOfFirst)
{
  // Halving the step divides the error of a second of motion by 2^order, to 10 % at these steps.
  for (const Case& item : plants())
  {
    phri_core::Random random(14);
    const PlantState x0 = 0.3 * randomState(random, item.plant->stateSize());
    const auto end = [&](Integrator integrator, int steps) {
      PlantState x = x0, next;
      for (int k = 0; k < steps; ++k, x = next)
        step(*item.plant, integrator, 1.0 / steps, x, Vector2d(0.2, -0.1), next);
      return x;
    };
    const PlantState exact = end(Integrator::RungeKutta4, 6400);
    const auto order = [&](Integrator integrator, int steps) {
      return std::log2((end(integrator, steps) - exact).norm() / (end(integrator, 2 * steps) - exact).norm());
    };
    // coarse enough for the error to stand above rounding: the car's motion is almost a polynomial
    const int coarse = item.plant->stateSize() == 5 ? 8 : 100;
    EXPECT_NEAR(order(Integrator::RungeKutta4, coarse), 4.0, 0.15) << item.name;
    EXPECT_NEAR(order(Integrator::Euler, 1600), 1.0, 0.1) << item.name;
  }
}

TEST(TwoLinkArm, FreeArmKeepsItsEnergyAndFrictionTakesPower)
{
  ArmParameters smooth;
  smooth.friction.setZero();
  const TwoLinkArm free(smooth), rough;
  phri_core::Random random(15);
  for (int trial = 0; trial < 20; ++trial)
  {
    PlantState x = randomState(random, 4), next;
    const double energy = free.kineticEnergy(x);
    for (int k = 0; k < 2000; ++k, x = next)
      step(free, Integrator::RungeKutta4, 1e-3, x, Vector2d::Zero(), next);
    // 2000 steps of relative error O((rate dt)^5), rates up to about 30 1/s
    EXPECT_NEAR(free.kineticEnergy(x), energy, 1e-5 * energy);
  }
  // dT/dt = qd'(tau - B qd): the Coriolis forces do no work
  for (int trial = 0; trial < kStates; ++trial)
  {
    const PlantState x = randomState(random, 4);
    const Vector2d torque = randomControl(random), qd = x.tail<2>();
    PlantState xdot(4);
    rough.rate(x, torque, xdot);
    const PlantState ahead = x + 1e-6 * xdot, behind = x - 1e-6 * xdot;
    const double power = (rough.kineticEnergy(ahead) - rough.kineticEnergy(behind)) / 2e-6;
    const double expected = qd.dot(torque - rough.parameters().friction * qd);
    EXPECT_NEAR(power, expected, 1e-6 * (1.0 + rough.kineticEnergy(x) + std::abs(expected)) * (1.0 + xdot.norm()));
  }
}

TEST(TwoLinkArm, MassMatrixIsPositiveDefiniteAndThatOfTwoRods)
{
  const TwoLinkArm arm;
  const ArmParameters& p = arm.parameters();
  phri_core::Random random(16);
  for (int trial = 0; trial < kStates; ++trial)
  {
    const PlantState x = randomState(random, 4);
    EXPECT_GT(arm.massMatrix(x.head<2>()).selfadjointView<Eigen::Lower>().eigenvalues().minCoeff(), 0.0);
    // Koenig: energy of link 1 turning about the shoulder plus link 2 about its moving joint
    const double rate = x(2) + x(3), cross = p.mass(1) * p.length(0) * p.length(1) / 2.0 * std::cos(x(1)) * x(2) * rate;
    const double energy = 0.5 * (p.inertia(0) + p.mass(1) * p.length(0) * p.length(0)) * x(2) * x(2) +
                          0.5 * p.inertia(1) * rate * rate + cross;
    EXPECT_NEAR(arm.kineticEnergy(x), energy, 1e-12 * (1.0 + energy));
  }
}

TEST(TwoLinkArm, WorkspaceForceDoesTheWorkOfItsTorques)
{
  // u'pd = tau'qd, so J'u as a torque gives the same accelerations
  const TwoLinkArm by_torque, by_force(ArmParameters(), ArmInput::WorkspaceForce);
  phri_core::Random random(17);
  for (int trial = 0; trial < 100; ++trial)
  {
    const PlantState x = randomState(random, 4);
    const Vector2d force = randomControl(random), torque = by_torque.jacobian(x.head<2>()).transpose() * force;
    EXPECT_NEAR(force.dot(by_force.motion(x).tail<2>()), torque.dot(x.tail<2>()),
                1e-12 * (1.0 + force.norm() * x.norm()));
    PlantState a(4), b(4);
    by_torque.rate(x, torque, a);
    by_force.rate(x, force, b);
    EXPECT_LT(difference(a, b), 1e-12);
  }
}

TEST(TwoLinkArm, StateAtInvertsTheMotion)
{
  const TwoLinkArm arm;
  phri_core::Random random(18);
  for (int trial = 0; trial < kStates; ++trial)
  {
    PlantState x = randomState(random, 4);
    x(1) = random.uniform(0.1, 3.0);
    const PlantState found = arm.stateAt(arm.motion(x));
    EXPECT_LT((arm.motion(found) - arm.motion(x)).norm(), 1e-9);
    EXPECT_NEAR(found(1), x(1), 1e-9);
    EXPECT_LT((found.tail<2>() - x.tail<2>()).norm(), 1e-8 * (1.0 + x.norm()));
  }
  EXPECT_THROW(arm.stateAt({ 0.6, 0.3, 0.0, 0.0 }), std::invalid_argument);   // out of reach
  EXPECT_THROW(arm.stateAt({ 0.63, 0.0, 0.0, 0.0 }), std::invalid_argument);  // straight: singular
  EXPECT_THROW(arm.stateAt({ NAN, 0.3, 0.0, 0.0 }), std::invalid_argument);
}

TEST(CarLikeRobot, ConstantCurvatureDrivesACircle)
{
  const CarLikeRobot car;
  PlantState x(5), next;
  x << 0.0, 0.0, 0.0, 1.5, 2.0;  // 1.5 m/s on a circle of radius 0.5 m to the left, about (0, 0.5)
  for (int k = 0; k < 2000; ++k, x = next)
  {
    step(car, Integrator::RungeKutta4, 1e-3, x, Vector2d::Zero(), next);
    ASSERT_NEAR((next.head<2>() - Vector2d(0.0, 0.5)).norm(), 0.5, 1e-10);
  }
  EXPECT_NEAR(x(2), 1.5 * 2.0 * 2.0, 1e-10);
}

TEST(PointMass, ReachesTheSpeedWhereDampingCarriesTheForce)
{
  const PointMass mass(Vector2d(2.0, 0.5), Vector2d(4.0, 0.25));
  PlantState x = PlantState::Zero(4), next;
  for (int k = 0; k < 20000; ++k, x = next)
    step(mass, Integrator::RungeKutta4, 1e-2, x, Vector2d(2.0, -1.0), next);
  EXPECT_NEAR(x(2), 0.5, 1e-9);  // u / d
  EXPECT_NEAR(x(3), -4.0, 1e-9);
  // the driving force is a field over the position: cos along the first axis, sin along the second
  const PointMass driven(Vector2d::Ones(), Vector2d::Zero(), DrivingForce{ 2.0 });
  PlantState at(4), xdot(4);
  at << M_PI / 2.0, M_PI / 4.0, 0.0, 0.0;
  driven.rate(at, Vector2d::Zero(), xdot);
  EXPECT_NEAR(xdot(2), -1.0, 1e-12);
  EXPECT_NEAR(xdot(3), 1.0, 1e-12);
}

TEST(BenchmarkPlants, RefusesParametersOfNoPlant)
{
  EXPECT_THROW(PointMass(Vector2d(0.0, 1.0)), std::invalid_argument);
  EXPECT_THROW(PointMass(Vector2d::Ones(), Vector2d(-1.0, 1.0)), std::invalid_argument);
  EXPECT_THROW(PointMass(Vector2d::Ones(), Vector2d::Ones(), DrivingForce{ NAN }), std::invalid_argument);
  ArmParameters light;
  light.inertia(1) = 1e-4;  // less than a point mass at the centre of the link would have about the joint
  EXPECT_THROW(TwoLinkArm arm(light), std::invalid_argument);
}
