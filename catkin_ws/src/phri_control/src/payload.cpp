#include "phri_control/payload.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace phri_control
{
namespace
{
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

Matrix3d skew(const Vector3d& a)
{
  Matrix3d matrix;
  matrix << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return matrix;
}

/// Direction of gravity in the sensor's frame.
Vector3d down(const Matrix3d& orientation)
{
  return -orientation.row(2).transpose();
}

struct LeastSquares
{
  VectorXd solution, residual, singular_values;
  MatrixXd covariance;
};

LeastSquares solve(const MatrixXd& A, const VectorXd& b)
{
  const Eigen::JacobiSVD<MatrixXd> svd(A, Eigen::ComputeThinU | Eigen::ComputeThinV);
  LeastSquares result;
  result.singular_values = svd.singularValues();
  result.solution = svd.solve(b);
  result.residual = b - A * result.solution;
  const double variance = result.residual.squaredNorm() / static_cast<double>(A.rows() - A.cols());
  const MatrixXd scaled = svd.matrixV() * svd.singularValues().cwiseInverse().asDiagonal();
  result.covariance = variance * scaled * scaled.transpose();
  return result;
}

std::string joined(const std::vector<std::string>& errors)
{
  std::string text = "payload identification: ";
  for (std::size_t i = 0; i < errors.size(); ++i)
    text += (i ? "; " : "") + errors[i];
  return text;
}

void requirePoses(const std::vector<Matrix3d>& orientations, const std::vector<Vector6d>& wrenches)
{
  std::vector<std::string> errors;
  if (orientations.size() != wrenches.size())
    errors.push_back(std::to_string(orientations.size()) + " orientations and " + std::to_string(wrenches.size()) +
                     " wrenches, expected as many of both");
  if (orientations.size() < kFewestPoses)
    errors.push_back(std::to_string(orientations.size()) + " poses, expected at least " + std::to_string(kFewestPoses));
  for (std::size_t i = 0; i < orientations.size(); ++i)
    if (!isRotation(orientations[i]))
    {
      std::ostringstream text;
      text << "pose " << i << " is not a rotation: R'R is off the identity by "
           << (orientations[i].transpose() * orientations[i] - Matrix3d::Identity()).cwiseAbs().maxCoeff()
           << " and det R = " << orientations[i].determinant() << ", expected at most " << kRotationTolerance
           << " and 1";
      errors.push_back(text.str());
    }
  for (std::size_t i = 0; i < wrenches.size(); ++i)
    if (!wrenches[i].allFinite())
      errors.push_back("wrench " + std::to_string(i) + " is not finite");
  if (!errors.empty())
    throw std::invalid_argument(joined(errors));
}

/// With the bias free, only departures d of gravity's direction from its mean inform: sum |d|^2 about the mass,
/// sum (|d|^2 I - d d') about the centre of mass.
void requireExcitation(const std::vector<Matrix3d>& orientations)
{
  const double count = static_cast<double>(orientations.size());
  Vector3d mean = Vector3d::Zero();
  for (const Matrix3d& orientation : orientations)
    mean += down(orientation) / count;
  double mass = 0.0;
  Matrix3d centre = Matrix3d::Zero();
  for (const Matrix3d& orientation : orientations)
  {
    const Vector3d d = down(orientation) - mean;
    mass += d.squaredNorm() / count;
    centre += (d.squaredNorm() * Matrix3d::Identity() - d * d.transpose()) / count;
  }
  std::vector<std::string> errors;
  const auto require = [&errors](const std::string& what, double square) {
    const double excitation = std::sqrt(std::max(0.0, square));
    if (excitation >= kLeastExcitation)
      return;
    std::ostringstream text;
    text << "the poses do not tell " << what << " from the bias: excitation " << excitation << ", expected at least "
         << kLeastExcitation << " (tilt the sensor about two horizontal axes)";
    errors.push_back(text.str());
  };
  require("the mass", mass);
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(centre);
  for (int i = 0; i < 3; ++i)
  {
    const Vector3d axis = eigen.eigenvectors().col(i);
    std::ostringstream what;
    what.precision(2);
    what << "the centre of mass along (" << axis.x() << ", " << axis.y() << ", " << axis.z() << ")";
    require(what.str(), eigen.eigenvalues()(i));
  }
  if (!errors.empty())
    throw std::invalid_argument(joined(errors));
}

void requireMass(double mass)
{
  if (mass >= kLeastMass)
    return;
  std::ostringstream text;
  text << "payload identification: the mass is " << mass << " kg, expected at least " << kLeastMass << " kg: ";
  if (mass <= -kLeastMass)
    text << "the readings have the opposite sign (they must be what the payload exerts ON the robot), or the "
            "orientations map the inertial frame into the sensor's instead of back";
  else
    text << "nothing hangs on the sensor, or the readings are already compensated";
  throw std::invalid_argument(text.str());
}
}  // namespace

bool isRotation(const Matrix3d& matrix, double tolerance) noexcept
{
  const Matrix3d product = matrix.transpose().lazyProduct(matrix);
  // written so that NaN fails
  return (product - Matrix3d::Identity()).cwiseAbs().maxCoeff() <= tolerance && product.allFinite() &&
         matrix.determinant() > 0.0;
}

Vector6d gravityWrench(const Payload& payload, const Matrix3d& orientation) noexcept
{
  Vector6d wrench;
  wrench.head<3>() = payload.mass * kGravity * down(orientation);
  wrench.tail<3>() = payload.centre.cross(wrench.head<3>());
  return wrench;
}

Vector6d payloadWrench(const Payload& payload, const SensorMotion& motion) noexcept
{
  const Matrix3d to_sensor = motion.orientation.transpose();
  const Vector3d w = to_sensor * motion.angular_velocity, alpha = to_sensor * motion.angular_acceleration;
  const Vector3d acceleration =
      to_sensor * motion.acceleration + alpha.cross(payload.centre) + w.cross(w.cross(payload.centre));
  Vector6d wrench = gravityWrench(payload, motion.orientation);
  const Vector3d inertial = -payload.mass * acceleration;
  wrench.head<3>() += inertial;
  wrench.tail<3>() += payload.centre.cross(inertial) - payload.inertia * alpha - w.cross(payload.inertia * w);
  return wrench;
}

PayloadEstimate identifyPayload(const std::vector<Matrix3d>& orientations, const std::vector<Vector6d>& wrenches)
{
  requirePoses(orientations, wrenches);
  requireExcitation(orientations);

  const auto count = static_cast<Eigen::Index>(orientations.size());
  MatrixXd force_regressor(3 * count, 4), torque_regressor(3 * count, 6);
  VectorXd forces(3 * count), torques(3 * count);
  for (Eigen::Index i = 0; i < count; ++i)
  {
    const Vector3d u = down(orientations[i]);
    force_regressor.middleRows<3>(3 * i) << u, Matrix3d::Identity();
    torque_regressor.middleRows<3>(3 * i) << -skew(u), Matrix3d::Identity();
    forces.segment<3>(3 * i) = wrenches[i].head<3>();
    torques.segment<3>(3 * i) = wrenches[i].tail<3>();
  }
  // unknowns: weight [N] and first moment of the weight [Nm], so that all columns are of order 1
  const LeastSquares force = solve(force_regressor, forces), torque = solve(torque_regressor, torques);

  PayloadEstimate estimate;
  const double mass = estimate.payload.mass = force.solution(0) / kGravity;
  requireMass(mass);
  const double weight = force.solution(0);
  estimate.payload.centre = torque.solution.head<3>() / weight;
  estimate.bias << force.solution.tail<3>(), torque.solution.tail<3>();
  estimate.force_residual = force.residual.norm() / std::sqrt(3.0 * static_cast<double>(count));
  estimate.torque_residual = torque.residual.norm() / std::sqrt(3.0 * static_cast<double>(count));
  estimate.condition = std::max(force.singular_values(0), torque.singular_values(0)) /
                       std::min(force.singular_values(3), torque.singular_values(5));
  for (Eigen::Index i = 0; i < count; ++i)
    estimate.residuals.push_back(
        (Vector6d() << force.residual.segment<3>(3 * i), torque.residual.segment<3>(3 * i)).finished());

  estimate.mass_deviation = std::sqrt(force.covariance(0, 0)) / kGravity;
  for (int i = 0; i < 3; ++i)
  {
    const double moment = torque.covariance(i, i), centre = estimate.payload.centre(i);
    estimate.centre_deviation(i) = std::sqrt(moment + centre * centre * force.covariance(0, 0)) / weight;
    estimate.bias_deviation(i) = std::sqrt(force.covariance(1 + i, 1 + i));
    estimate.bias_deviation(3 + i) = std::sqrt(torque.covariance(3 + i, 3 + i));
  }
  return estimate;
}
}  // namespace phri_control
