#include "phri_control/risk_evaluation.hpp"

#include <Eigen/Eigenvalues>

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
}  // namespace phri_control::detail
