#include "phri_core/gaussian.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <stdexcept>

namespace phri_core
{
double mahalanobisSquared(const Gaussian& gaussian, const Eigen::VectorXd& x)
{
  const Eigen::LLT<Eigen::MatrixXd> factor(gaussian.covariance);
  if (factor.info() != Eigen::Success)
    throw std::invalid_argument("mahalanobisSquared: the covariance is not positive definite");
  return factor.matrixL().solve(x - gaussian.mean).squaredNorm();
}

Eigen::MatrixXd inverseSquareRoot(const Eigen::MatrixXd& covariance, double floor)
{
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance);
  const Eigen::VectorXd roots = (solver.eigenvalues().cwiseMax(0.0).array() + floor).rsqrt();
  return solver.eigenvectors() * roots.asDiagonal() * solver.eigenvectors().transpose();
}
}  // namespace phri_core
