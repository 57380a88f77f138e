#pragma once
#include <Eigen/Core>

namespace phri_core
{
/// Normal distribution N(mean, covariance); mean (d), covariance (d, d), symmetric positive semi-definite.
struct Gaussian
{
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

/// Symmetric inverse square root of (covariance + floor I), both (d, d); used for the weights of (5.29). `floor` has
/// the unit of the covariance. The text's I + Sigma is dimensionally wrong: the floor is small and explicit.
Eigen::MatrixXd inverseSquareRoot(const Eigen::MatrixXd& covariance, double floor);
}  // namespace phri_core
