#include "phri_core/gaussian.hpp"

#include <Eigen/Eigenvalues>

namespace phri_core
{
Eigen::MatrixXd inverseSquareRoot(const Eigen::MatrixXd& covariance, double floor)
{
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance);
  const Eigen::VectorXd roots = (solver.eigenvalues().cwiseMax(0.0).array() + floor).rsqrt();
  return solver.eigenvectors() * roots.asDiagonal() * solver.eigenvectors().transpose();
}
}  // namespace phri_core
