#include "phri_control/uncertain_costs.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
constexpr int kHighestObstacleCumulant = 4;

CostMatrix symmetricRoot(const CostMatrix& matrix)
{
  const Eigen::SelfAdjointEigenSolver<CostMatrix> eigen(matrix);
  const CostVector root = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  return eigen.eigenvectors() * root.asDiagonal() * eigen.eigenvectors().transpose();
}

/// root f(spread) root for a function of the eigenvalues of `spread`: symmetric, and defined for a singular weight.
template <typename Function>
CostMatrix sandwich(const CostMatrix& root, const CostMatrix& spread, const Function& function)
{
  const Eigen::SelfAdjointEigenSolver<CostMatrix> eigen(spread);
  const CostMatrix outer = root * eigen.eigenvectors();
  const CostVector middle = eigen.eigenvalues().cwiseMax(0.0).unaryExpr(function);
  const CostMatrix product = outer * middle.asDiagonal() * outer.transpose();
  return 0.5 * (product + product.transpose());
}

CostVector spectrum(const CostMatrix& spread)
{
  return Eigen::SelfAdjointEigenSolver<CostMatrix>(spread, Eigen::EigenvaluesOnly).eigenvalues().cwiseMax(0.0);
}

void requireBelief(const std::string& name, const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance,
                   const Eigen::MatrixXd& weight)
{
  if (mean.size() < 1 || mean.size() > kMaxCostSize)
    throw std::invalid_argument(name + ": mean has " + std::to_string(mean.size()) + " elements, expected 1 to " +
                                std::to_string(kMaxCostSize));
  phri_core::requireFinite(name + ": mean", mean);
  phri_core::requireShape(name + ": covariance", covariance, mean.size(), mean.size());
  phri_core::requireShape(name + ": weight", weight, mean.size(), mean.size());
  phri_core::requireCovariance(name + ": covariance", covariance);
  phri_core::requireCovariance(name + ": weight", weight);
}

double factorial(int n)
{
  return std::tgamma(n + 1.0);
}

Bump scaled(double factor, Bump bump)
{
  bump.amplitude *= factor;
  return bump;
}

/// Product of two bumps about one centre.
Bump product(const Bump& a, const Bump& b)
{
  return { a.centre, CostMatrix(a.weight + b.weight), a.amplitude * b.amplitude };
}
}  // namespace

double Quadratic::value(const CostVector& y) const
{
  const CostVector d = y - centre;
  return 0.5 * d.dot(weight.lazyProduct(d)) + constant;
}

double Quadratic::expand(const CostVector& y, CostVector& gradient, CostMatrix& hessian) const
{
  const CostVector d = y - centre, slope = weight.lazyProduct(d);
  gradient += slope;
  hessian += weight;
  return 0.5 * d.dot(slope) + constant;
}

double Bump::value(const CostVector& y) const
{
  const CostVector d = y - centre;
  return amplitude * std::exp(-0.5 * d.dot(weight.lazyProduct(d)));
}

double Bump::expand(const CostVector& y, CostVector& gradient, CostMatrix& hessian) const
{
  const CostVector d = y - centre, slope = weight.lazyProduct(d);
  const double h = amplitude * std::exp(-0.5 * d.dot(slope));
  gradient -= h * slope;
  hessian += h * (slope.lazyProduct(slope.transpose()) - weight);
  return h;
}

double value(const std::vector<Bump>& bumps, const CostVector& y)
{
  double sum = 0.0;
  for (const Bump& bump : bumps)
    sum += bump.value(y);
  return sum;
}

UncertainGoal::UncertainGoal(const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance,
                             const Eigen::MatrixXd& weight)
{
  requireBelief("UncertainGoal", mean, covariance, weight);
  mean_ = mean;
  covariance_ = covariance;
  weight_ = weight;
  root_ = symmetricRoot(weight_);
  spread_ = root_ * covariance_ * root_;
}

double UncertainGoal::thetaLimit() const
{
  const double largest = spectrum(spread_).maxCoeff();
  return largest > 0.0 ? 1.0 / largest : std::numeric_limits<double>::infinity();
}

Quadratic UncertainGoal::riskSensitive(double theta) const
{
  if (!std::isfinite(theta))
    throw std::invalid_argument("UncertainGoal: theta = " + std::to_string(theta) +
                                " 1/cost, expected a finite number");
  const double limit = thetaLimit();
  if (theta >= limit)
  {
    RiskStatus status;
    status.kind = BreakdownKind::Expectation;
    status.theta = theta;
    status.limit = limit;
    throw RiskBreakdown(status);
  }
  const CostVector eigenvalues = spectrum(spread_);
  Quadratic result{ mean_, sandwich(root_, spread_, [theta](double s) { return 1.0 / (1.0 - theta * s); }), 0.0 };
  for (Eigen::Index i = 0; i < eigenvalues.size(); ++i)
    result.constant += theta == 0.0 ? 0.5 * eigenvalues(i) : -0.5 * std::log1p(-theta * eigenvalues(i)) / theta;
  return result;
}

Quadratic UncertainGoal::cumulant(int r) const
{
  if (r < 1)
    throw std::invalid_argument("UncertainGoal: cumulant of order " + std::to_string(r) + ", expected at least 1");
  const double scale = factorial(r);
  return { mean_, sandwich(root_, spread_, [r, scale](double s) { return scale * std::pow(s, r - 1); }),
           0.5 * factorial(r - 1) * spectrum(spread_).array().pow(r).sum() };
}

Quadratic UncertainGoal::cumulants(const std::vector<double>& gamma) const
{
  Quadratic sum = cumulant(1);
  for (std::size_t i = 0; i < gamma.size(); ++i)
  {
    const Quadratic term = cumulant(static_cast<int>(i) + 2);
    sum.weight += gamma[i] * term.weight;
    sum.constant += gamma[i] * term.constant;
  }
  return sum;
}

UncertainObstacle::UncertainObstacle(const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance,
                                     const Eigen::MatrixXd& weight, double amplitude)
  : amplitude_(amplitude)
{
  requireBelief("UncertainObstacle", mean, covariance, weight);
  if (!std::isfinite(amplitude))
    throw std::invalid_argument("UncertainObstacle: amplitude = " + std::to_string(amplitude) +
                                ", expected a finite number");
  mean_ = mean;
  covariance_ = covariance;
  weight_ = weight;
  root_ = symmetricRoot(weight_);
  spread_ = root_ * covariance_ * root_;
}

Bump UncertainObstacle::moment(int p) const
{
  if (p < 1)
    throw std::invalid_argument("UncertainObstacle: moment of order " + std::to_string(p) + ", expected at least 1");
  return { mean_, sandwich(root_, spread_, [p](double s) { return p / (1.0 + p * s); }),
           std::pow(amplitude_, p) / std::sqrt((1.0 + p * spectrum(spread_).array()).prod()) };
}

std::vector<Bump> UncertainObstacle::cumulant(int r) const
{
  if (r < 1 || r > kHighestObstacleCumulant)
    throw std::invalid_argument("UncertainObstacle: cumulant of order " + std::to_string(r) + ", expected 1 to " +
                                std::to_string(kHighestObstacleCumulant));
  const Bump m1 = moment(1);
  if (r == 1)
    return { m1 };
  const Bump m2 = moment(2), m1m1 = product(m1, m1);
  if (r == 2)
    return { m2, scaled(-1.0, m1m1) };
  const Bump m3 = moment(3);
  if (r == 3)
    return { m3, scaled(-3.0, product(m2, m1)), scaled(2.0, product(m1m1, m1)) };
  return { moment(4), scaled(-4.0, product(m3, m1)), scaled(-3.0, product(m2, m2)), scaled(12.0, product(m2, m1m1)),
           scaled(-6.0, product(m1m1, m1m1)) };
}

std::vector<Bump> UncertainObstacle::cumulants(const std::vector<double>& gamma) const
{
  std::vector<Bump> sum = cumulant(1);
  for (std::size_t i = 0; i < gamma.size(); ++i)
    for (const Bump& bump : cumulant(static_cast<int>(i) + 2))
      sum.push_back(scaled(gamma[i], bump));
  return sum;
}
}  // namespace phri_control
