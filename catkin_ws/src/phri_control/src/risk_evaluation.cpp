#include "phri_control/risk_evaluation.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>

namespace phri_control::detail
{
namespace
{
/// The eigenvalues are taken of Sigma^1/2 W Sigma^1/2, which has those of E'WE but for zeros and is never larger than
/// W.
template <int Max>
double limitOf(const Eigen::Ref<const Eigen::MatrixXd>& W, const Eigen::MatrixXd& factor, bool averse)
{
  using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, Max, Max>;
  const Square covariance = factor.lazyProduct(factor.transpose());
  const Eigen::SelfAdjointEigenSolver<Square> sigma(covariance);
  const Square half = sigma.eigenvectors() * sigma.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
  const Square behind = W.lazyProduct(half);
  const Square middle = half.transpose().lazyProduct(behind);
  const Eigen::SelfAdjointEigenSolver<Square> solver(middle, Eigen::EigenvaluesOnly);
  return 1.0 / solver.eigenvalues()(averse ? W.rows() - 1 : 0);
}
}  // namespace

double thetaLimit(const Eigen::Ref<const Eigen::MatrixXd>& W, const Eigen::MatrixXd& factor, bool averse)
{
  constexpr int kOnStack = 16;
  return W.rows() <= kOnStack ? limitOf<kOnStack>(W, factor, averse) : limitOf<Eigen::Dynamic>(W, factor, averse);
}

RiskStatus expectationStatus(const Eigen::Ref<const Eigen::MatrixXd>& W, const Eigen::MatrixXd& factor, double theta,
                             int stage, int source)
{
  if (!W.allFinite() || !factor.allFinite() || !std::isfinite(theta))
    return { BreakdownKind::NotFinite, stage, source, theta, 0.0 };
  // A limit of the other sign: rounding alone has made a pivot negative, beyond some 1e14 for -theta E'WE.
  const double limit = thetaLimit(W, factor, theta > 0.0);
  if (!std::isfinite(limit) || !(limit * theta > 0.0))
    return { BreakdownKind::NotFinite, stage, source, theta, 0.0 };
  return { BreakdownKind::Expectation, stage, source, theta, limit };
}
}  // namespace phri_control::detail
