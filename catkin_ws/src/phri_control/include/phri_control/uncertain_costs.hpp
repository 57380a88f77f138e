#pragma once
/// Costs of goals and obstacles that stand still at an uncertain place (section 4.5), in closed form. Averaging over
/// the place ahead of the control problem turns each into a certain function of the robot's own y: a `Quadratic` for a
/// goal, a sum of `Bump`s for an obstacle, whatever the cumulant. Goals and obstacles that move at random are not
/// here: their uncertainty enters through the joint state and its noise (planar_scene.hpp).
///
/// With x ~ N(mean, covariance S), d = y - mean, weight Q, all of one size (1 to 4):
///   goal      h = 1/2 (y - x)'Q(y - x)
///     theta^-1 log E exp(theta h) = 1/2 d'(I - theta Q S)^-1 Q d - 1/(2 theta) log|I - theta Q S|
///       exists if and only if I - theta Q^1/2 S Q^1/2 > 0; theta > 0 is risk-averse
///     kappa_r = r!/2 d'(QS)^(r-1) Q d + (r-1)!/2 tr (QS)^r
///   obstacle  h = a exp(-1/2 (y - x)'Q(y - x))
///     E h^p = a^p |I + p Q S|^-1/2 exp(-p/2 d'(I + p Q S)^-1 Q d), and from these every cumulant
/// Errata of the thesis: (4.39) lacks the factor -1/2 of the log-determinant; its variance has a spurious 1/2, (4.40)
/// lacks one; (4.42) has the wrong sign, no 1/2 and I - QS; the higher cumulants of an obstacle do depend on y.
///
/// Covariances and weights are symmetric positive semi-definite, singular and zero ones included; everything else
/// throws std::invalid_argument. Evaluation (`value`, `expand`) does not allocate.

#include <Eigen/Core>
#include <string>
#include <vector>

#include "phri_control/attitude.hpp"

namespace phri_control
{
constexpr int kMaxCostSize = 4;
using CostVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxCostSize, 1>;
using CostMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxCostSize, kMaxCostSize>;

/// 1/2 d'W d + constant, d = y - centre.
struct Quadratic
{
  CostVector centre;
  CostMatrix weight;
  double constant = 0.0;

  double value(const CostVector& y) const;
  /// Adds value (returned), gradient and Hessian at y.
  double expand(const CostVector& y, CostVector& gradient, CostMatrix& hessian) const;
};

/// a exp(-1/2 d'P d), d = y - centre; gradient -h P d, Hessian h (P d d'P - P): exact, hence indefinite (negative
/// definite inside the unit ellipse of P).
struct Bump
{
  CostVector centre;
  CostMatrix weight;
  double amplitude = 0.0;

  double value(const CostVector& y) const;
  double expand(const CostVector& y, CostVector& gradient, CostMatrix& hessian) const;
};

double value(const std::vector<Bump>& bumps, const CostVector& y);

/// A goal at an uncertain place.
class UncertainGoal
{
public:
  UncertainGoal(const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance, const Eigen::MatrixXd& weight);

  /// theta^-1 log E exp(theta h) as a function of y; theta = 0: E h. Throws RiskBreakdown (kind Expectation, with the
  /// limit) at theta >= thetaLimit().
  Quadratic riskSensitive(double theta) const;
  /// r-th cumulant of h, r >= 1.
  Quadratic cumulant(int r) const;
  /// kappa_1 + sum_i gamma_i kappa_{i+2}. The weight may be indefinite if some gamma is negative.
  Quadratic cumulants(const std::vector<double>& gamma) const;
  /// 1 / lam_max(Q^1/2 S Q^1/2); infinite for a certain goal.
  double thetaLimit() const;

  const CostVector& mean() const { return mean_; }
  const CostMatrix& covariance() const { return covariance_; }
  const CostMatrix& weight() const { return weight_; }

private:
  CostVector mean_;
  CostMatrix covariance_, weight_, root_, spread_;  ///< root_ = Q^1/2, spread_ = Q^1/2 S Q^1/2
};

/// An obstacle at an uncertain place.
class UncertainObstacle
{
public:
  /// amplitude a [cost] of any sign: a < 0 is an attractor.
  UncertainObstacle(const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance, const Eigen::MatrixXd& weight,
                    double amplitude);

  /// E h^p as a function of y, p >= 1.
  Bump moment(int p) const;
  Bump expected() const { return moment(1); }
  /// r-th cumulant of h as a sum of bumps about the mean, 1 <= r <= 4; the second is Var h = E h^2 - (E h)^2.
  std::vector<Bump> cumulant(int r) const;
  /// kappa_1 + sum_i gamma_i kappa_{i+2}, at most three gammas.
  std::vector<Bump> cumulants(const std::vector<double>& gamma) const;

  const CostVector& mean() const { return mean_; }
  const CostMatrix& covariance() const { return covariance_; }
  const CostMatrix& weight() const { return weight_; }
  double amplitude() const { return amplitude_; }

private:
  CostVector mean_;
  CostMatrix covariance_, weight_, root_, spread_;
  double amplitude_;
};
}  // namespace phri_control
