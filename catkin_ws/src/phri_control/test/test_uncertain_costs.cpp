// Static uncertain goals and obstacles: the closed forms against Monte Carlo, numerical differentiation and each other.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "phri_control/uncertain_costs.hpp"
#include "phri_core/random.hpp"

using namespace phri_control;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

namespace
{
constexpr int kSamples = 200000;
// Every comparison with samples is seeded and made at 4.5 standard errors of the estimate: a right formula fails one in
// 1e5, and the seeds are fixed.
constexpr double kErrors = 4.5;

MatrixXd randomCovariance(phri_core::Random& random, Eigen::Index n, double scale)
{
  MatrixXd root(n, n);
  for (Eigen::Index i = 0; i < n * n; ++i)
    root(i) = random.normal();
  return scale * (root * root.transpose()) / static_cast<double>(n);
}

VectorXd randomVector(phri_core::Random& random, Eigen::Index n)
{
  VectorXd x(n);
  for (Eigen::Index i = 0; i < n; ++i)
    x(i) = random.normal();
  return x;
}

/// Draws of x ~ N(mean, covariance), any semi-definite one.
template <typename Function>
std::vector<double> draw(phri_core::Random& random, const VectorXd& mean, const MatrixXd& covariance,
                         const Function& function)
{
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(covariance);
  const MatrixXd root = eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
  std::vector<double> values(kSamples);
  for (double& value : values)
    value = function(mean + root * randomVector(random, mean.size()));
  return values;
}

struct Estimate
{
  double mean = 0.0, error = 0.0;
};

template <typename Function>
Estimate average(const std::vector<double>& values, const Function& function)
{
  double sum = 0.0, squares = 0.0;
  for (const double value : values)
  {
    const double f = function(value);
    sum += f;
    squares += f * f;
  }
  const double n = static_cast<double>(values.size()), mean = sum / n;
  return { mean, std::sqrt(std::max(0.0, squares / n - mean * mean) / n) };
}

void expectAt(const Estimate& estimate, double value)
{
  EXPECT_NEAR(value, estimate.mean, kErrors * estimate.error + 1e-12 * std::abs(value));
}

/// Central moments of a sample agree with cumulants 2 to 4 at these standard errors: the r-th one is the mean of
/// (h - E h)^r with the exact mean, less 3 Var^2 for the fourth.
template <typename Cumulant>
void expectCumulants(const std::vector<double>& values, const Cumulant& cumulant)
{
  const double mean = cumulant(1), variance = cumulant(2);
  expectAt(average(values, [](double h) { return h; }), mean);
  expectAt(average(values, [&](double h) { return std::pow(h - mean, 2); }), variance);
  expectAt(average(values, [&](double h) { return std::pow(h - mean, 3); }), cumulant(3));
  expectAt(average(values, [&](double h) { return std::pow(h - mean, 4); }), cumulant(4) + 3.0 * variance * variance);
}

/// Gradient and Hessian against central differences of the value and of the gradient.
template <typename Term>
void expectDerivatives(const Term& term, const CostVector& y)
{
  constexpr double h = 1e-5, tolerance = 1e-8;  // truncation and rounding: both about 1e-10 of the curvature
  const Eigen::Index n = y.size();
  CostVector gradient = CostVector::Constant(n, 0.5), unused;  // expand adds to what is there
  CostMatrix hessian = CostMatrix::Constant(n, n, 0.25), unused_hessian;
  EXPECT_EQ(term.expand(y, gradient, hessian), term.value(y));
  const double scale = 1.0 + std::abs(term.value(y)) + hessian.cwiseAbs().maxCoeff();
  for (Eigen::Index i = 0; i < n; ++i)
  {
    CostVector up = y, down = y, up_gradient = CostVector::Zero(n), down_gradient = CostVector::Zero(n);
    CostMatrix ignored = CostMatrix::Zero(n, n);
    up(i) += h;
    down(i) -= h;
    EXPECT_NEAR(gradient(i) - 0.5, (term.value(up) - term.value(down)) / (2.0 * h), tolerance * scale);
    term.expand(up, up_gradient, ignored);
    term.expand(down, down_gradient, ignored);
    for (Eigen::Index j = 0; j < n; ++j)
      EXPECT_NEAR(hessian(i, j) - 0.25, (up_gradient(j) - down_gradient(j)) / (2.0 * h), tolerance * scale);
  }
}
}  // namespace

TEST(UncertainGoal, CumulantsAreThoseOfSamples)
{
  for (const Eigen::Index n : { 1, 2, 4 })
  {
    phri_core::Random random(21);
    const UncertainGoal goal(randomVector(random, n), randomCovariance(random, n, 0.3),
                             randomCovariance(random, n, 1.0));
    const VectorXd y = randomVector(random, n), mean = goal.mean();
    const MatrixXd Q = goal.weight();
    const auto values =
        draw(random, mean, goal.covariance(), [&](const VectorXd& x) { return 0.5 * (y - x).dot(Q * (y - x)); });
    expectCumulants(values, [&](int r) { return goal.cumulant(r).value(y); });
  }
}

TEST(UncertainGoal, RiskSensitiveValueIsThatOfSamples)
{
  phri_core::Random random(22);
  const UncertainGoal goal(Vector2d(0.3, -0.2), randomCovariance(random, 2, 0.3), randomCovariance(random, 2, 1.0));
  const VectorXd y = randomVector(random, 2), mean = goal.mean();
  const MatrixXd Q = goal.weight();
  const auto values =
      draw(random, mean, goal.covariance(), [&](const VectorXd& x) { return 0.5 * (y - x).dot(Q * (y - x)); });
  // below half the limit exp(theta h) has a second moment, without which there is no standard error
  for (const double theta : { 0.3 * goal.thetaLimit(), -0.5, -20.0 })
    expectAt(average(values, [theta](double h) { return std::exp(theta * h); }),
             std::exp(theta * goal.riskSensitive(theta).value(y)));
}

TEST(UncertainGoal, RiskSensitiveValueIsTheSeriesOfItsCumulants)
{
  // sum theta^(r-1) / r! kappa_r converges like (theta / limit)^r: 60 terms at a third of the limit are exact
  phri_core::Random random(23);
  const UncertainGoal goal(randomVector(random, 4), randomCovariance(random, 4, 0.5), randomCovariance(random, 4, 2.0));
  const VectorXd y = randomVector(random, 4);
  for (const double share : { 1.0 / 3.0, -1.0 / 3.0 })
  {
    const double theta = share * goal.thetaLimit();
    double sum = 0.0, factor = 1.0;
    for (int r = 1; r <= 60; factor *= theta / r, ++r)
      sum += factor / r * goal.cumulant(r).value(y);
    EXPECT_NEAR(goal.riskSensitive(theta).value(y), sum, 1e-12 * std::abs(sum));
  }
  EXPECT_NEAR(goal.riskSensitive(0.0).value(y), goal.cumulant(1).value(y), 1e-12);
  EXPECT_NEAR(goal.riskSensitive(1e-9).value(y), goal.riskSensitive(0.0).value(y), 1e-6);
  const Quadratic sum = goal.cumulants({ 0.5, -0.1 });
  EXPECT_NEAR(sum.value(y),
              goal.cumulant(1).value(y) + 0.5 * goal.cumulant(2).value(y) - 0.1 * goal.cumulant(3).value(y), 1e-12);
}

TEST(UncertainGoal, ExistsExactlyBelowTheLimit)
{
  // Q = diag(4, 1), S = diag(0.5, 3): I - theta Q^1/2 S Q^1/2 = diag(1 - 2 theta, 1 - 3 theta)
  const UncertainGoal goal(Vector2d::Zero(), Vector2d(0.5, 3.0).asDiagonal(), Vector2d(4.0, 1.0).asDiagonal());
  EXPECT_NEAR(goal.thetaLimit(), 1.0 / 3.0, 1e-15);
  EXPECT_NO_THROW(goal.riskSensitive(0.333));
  try
  {
    goal.riskSensitive(0.334);
    FAIL() << "no breakdown above the limit";
  }
  catch (const RiskBreakdown& breakdown)
  {
    EXPECT_EQ(breakdown.status().kind, BreakdownKind::Expectation);
    EXPECT_EQ(breakdown.status().theta, 0.334);
    EXPECT_NEAR(breakdown.status().limit, 1.0 / 3.0, 1e-15);
  }
  EXPECT_NO_THROW(goal.riskSensitive(-1e6));
  // at theta = -1 the weight is Q (I + S Q)^-1, the regularised Mahalanobis weight that (4.41) means
  const Quadratic seeking = goal.riskSensitive(-1.0);
  EXPECT_NEAR(seeking.weight(0, 0), 4.0 / 3.0, 1e-12);
  EXPECT_NEAR(seeking.weight(1, 1), 1.0 / 4.0, 1e-12);
}

TEST(UncertainGoal, CertainGoalAndSingularMatrices)
{
  const Eigen::Matrix2d zero = Eigen::Matrix2d::Zero(), line = Vector2d(1.0, 0.0).asDiagonal();
  const Vector2d y(0.4, 0.9);
  const UncertainGoal certain(Vector2d(1.0, 2.0), zero, 2.0 * Eigen::Matrix2d::Identity());
  EXPECT_EQ(certain.thetaLimit(), std::numeric_limits<double>::infinity());
  for (const double theta : { -5.0, 0.0, 1e6 })
    EXPECT_NEAR(certain.riskSensitive(theta).value(y), 0.6 * 0.6 + 1.1 * 1.1, 1e-12);
  EXPECT_EQ(certain.cumulant(2).value(y), 0.0);
  // uncertain only where nothing is weighted: as good as certain
  const UncertainGoal blind(Vector2d(1.0, 2.0), Eigen::Matrix2d(Vector2d(0.0, 7.0).asDiagonal()), line);
  EXPECT_NEAR(blind.riskSensitive(100.0).value(y), 0.5 * 0.36, 1e-12);
}

TEST(UncertainObstacle, MomentsAndCumulantsAreThoseOfSamples)
{
  for (const Eigen::Index n : { 1, 2, 3 })
  {
    phri_core::Random random(24);
    const UncertainObstacle obstacle(randomVector(random, n), randomCovariance(random, n, 0.5),
                                     randomCovariance(random, n, 3.0), 0.7);
    const VectorXd y = VectorXd(obstacle.mean()) + 0.4 * randomVector(random, n), mean = obstacle.mean();
    const MatrixXd Q = obstacle.weight();
    const auto values = draw(random, mean, obstacle.covariance(),
                             [&](const VectorXd& x) { return 0.7 * std::exp(-0.5 * (y - x).dot(Q * (y - x))); });
    for (const int p : { 1, 2, 3, 4 })
      expectAt(average(values, [p](double h) { return std::pow(h, p); }), obstacle.moment(p).value(y));
    expectCumulants(values, [&](int r) { return value(obstacle.cumulant(r), y); });
    EXPECT_NEAR(
        value(obstacle.cumulants({ 2.0, 0.0, -3.0 }), y),
        value(obstacle.cumulant(1), y) + 2.0 * value(obstacle.cumulant(2), y) - 3.0 * value(obstacle.cumulant(4), y),
        1e-14);
  }
}

TEST(UncertainObstacle, VarianceDependsOnTheRobot)
{
  // the thesis says it does not: at the mean and two widths away it differs, and far away it vanishes
  const Eigen::Matrix2d unit = Eigen::Matrix2d::Identity();
  const UncertainObstacle obstacle(Vector2d::Zero(), 0.1 * unit, unit, 0.1);
  const auto variance = [&](double distance) { return value(obstacle.cumulant(2), Vector2d(distance, 0.0)); };
  EXPECT_GT(variance(1.0), 2.0 * variance(0.0));
  EXPECT_LT(variance(6.0), 1e-9 * variance(0.0));
  // without uncertainty there is none anywhere, and the expectation is the cost itself
  const UncertainObstacle certain(Vector2d::Zero(), Eigen::Matrix2d::Zero(), unit, 0.1);
  EXPECT_NEAR(value(certain.cumulant(2), Vector2d(0.5, 0.0)), 0.0, 1e-17);
  EXPECT_NEAR(certain.expected().value(Vector2d(1.0, 1.0)), 0.1 * std::exp(-1.0), 1e-16);
}

TEST(UncertainObstacle, ExpectationKeepsItsVolume)
{
  // averaging over the place is a convolution: the integral over the plane, a 2 pi |Q|^-1/2, does not change
  phri_core::Random random(25);
  const UncertainObstacle obstacle(Vector2d::Zero(), randomCovariance(random, 2, 0.5), randomCovariance(random, 2, 3.0),
                                   0.7);
  const Bump expected = obstacle.expected();
  EXPECT_NEAR(expected.amplitude / std::sqrt(expected.weight.determinant()),
              0.7 / std::sqrt(obstacle.weight().determinant()), 1e-12);
}

TEST(UncertainCosts, GradientsAndHessiansAreExact)
{
  phri_core::Random random(26);
  for (int trial = 0; trial < 200; ++trial)
  {
    const Eigen::Index n = 1 + trial % 4;
    const VectorXd centre = randomVector(random, n);
    expectDerivatives(Quadratic{ centre, randomCovariance(random, n, 2.0), 0.3 }, randomVector(random, n));
    expectDerivatives(Bump{ centre, randomCovariance(random, n, 2.0), 0.8 }, randomVector(random, n));
  }
}

TEST(UncertainCosts, BumpHessianChangesSignAtTheWidth)
{
  // along d the curvature is h P (P d^2 - 1): concave inside one width, convex outside, not "convex" as in 4.5.2
  const Bump bump{ Vector2d::Zero(), 200.0 * Eigen::Matrix2d::Identity(), 0.1 };
  const auto curvature = [&](double distance) {
    CostVector gradient = CostVector::Zero(2);
    CostMatrix hessian = CostMatrix::Zero(2, 2);
    bump.expand(Vector2d(distance, 0.0), gradient, hessian);
    return hessian(0, 0);
  };
  const double width = 1.0 / std::sqrt(200.0);
  EXPECT_LT(curvature(0.99 * width), 0.0);
  EXPECT_GT(curvature(1.01 * width), 0.0);
}

TEST(UncertainCosts, RefusesBadInput)
{
  const Eigen::Matrix2d unit = Eigen::Matrix2d::Identity(), indefinite = Vector2d(1.0, -1.0).asDiagonal();
  EXPECT_THROW(UncertainGoal(Vector2d::Zero(), indefinite, unit), std::invalid_argument);
  EXPECT_THROW(UncertainGoal(Vector2d::Zero(), unit, indefinite), std::invalid_argument);
  EXPECT_THROW(UncertainGoal(VectorXd::Zero(3), unit, unit), std::invalid_argument);
  EXPECT_THROW(UncertainGoal(VectorXd::Zero(5), MatrixXd::Identity(5, 5), MatrixXd::Identity(5, 5)),
               std::invalid_argument);
  EXPECT_THROW(UncertainGoal(Vector2d(NAN, 0.0), unit, unit), std::invalid_argument);
  EXPECT_THROW(UncertainObstacle(Vector2d::Zero(), unit, unit, NAN), std::invalid_argument);
  const UncertainObstacle obstacle(Vector2d::Zero(), unit, unit, 1.0);
  EXPECT_THROW(obstacle.cumulant(5), std::invalid_argument);
  EXPECT_THROW(obstacle.moment(0), std::invalid_argument);
  const UncertainGoal goal(Vector2d::Zero(), unit, unit);
  EXPECT_THROW(goal.cumulant(0), std::invalid_argument);
  EXPECT_THROW(goal.riskSensitive(NAN), std::invalid_argument);
}
