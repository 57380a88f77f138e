#pragma once
#include <Eigen/Core>
#include <vector>

/// What hangs on a force/torque sensor, and what it does to the reading.
///
/// Sign: a reading is the wrench exerted BY everything beyond the sensor (payload, human, environment) ON the robot, in
/// and about the origin of the sensor's frame, force first. A payload of 1 kg at rest under a sensor whose z axis
/// points up reads -9.81 N along z. Orientations R map vectors of the sensor's frame into an inertial frame whose z
/// axis points up; on a mobile base that is `odom` or `world`, never `base_link` on a slope.
namespace phri_control
{
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr double kGravity = 9.81;  ///< [m/s^2]

struct Payload
{
  double mass = 0.0;                                  ///< [kg]
  Eigen::Vector3d centre{ 0, 0, 0 };                  ///< of mass, in the sensor's frame [m]
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  ///< about the centre of mass, in the sensor's axes [kgm2]
};

/// How the sensor's frame moves, seen from the inertial frame and expressed in it. What stays zero is not compensated.
struct SensorMotion
{
  Eigen::Matrix3d orientation = Eigen::Matrix3d::Identity();  ///< sensor's frame -> inertial frame
  Eigen::Vector3d velocity{ 0, 0, 0 };                        ///< of the sensor's origin [m/s]
  Eigen::Vector3d angular_velocity{ 0, 0, 0 };                ///< [rad/s]
  Eigen::Vector3d acceleration{ 0, 0, 0 };                    ///< of the sensor's origin [m/s^2]
  Eigen::Vector3d angular_acceleration{ 0, 0, 0 };            ///< [rad/s^2]
};

/// Reading that the payload's weight causes: the rotated weight, acting at the centre of mass. The moment is the
/// weight's about the sensor's origin; nothing else is moment-transformed.
Vector6d gravityWrench(const Payload& payload, const Eigen::Matrix3d& orientation) noexcept;

/// Weight and inertial wrench (Newton and Euler, minus sign: what the payload exerts on the robot).
Vector6d payloadWrench(const Payload& payload, const SensorMotion& motion) noexcept;

/// Largest deviation of R'R from the identity that counts as a rotation (single-precision recordings stay below).
constexpr double kRotationTolerance = 1e-5;
bool isRotation(const Eigen::Matrix3d& matrix, double tolerance = kRotationTolerance) noexcept;

/// Payload and bias from readings at rest.
///
/// Model per pose i with g_i = R_i' (0, 0, -9.81), force f_i and torque t_i about the sensor's origin:
///   f_i = m g_i + b_f,   t_i = (m c) x g_i + b_t,
/// linear in m, b_f and in m c, b_t: two separate least-squares problems, so that the different noise of forces and
/// torques needs no weights. The payload's inertia does not show at rest and stays zero.
struct PayloadEstimate
{
  Payload payload;
  Vector6d bias = Vector6d::Zero();  ///< reading without load [N, Nm]
  double force_residual = 0.0;       ///< rms per axis [N]
  double torque_residual = 0.0;      ///< rms per axis [Nm]
  /// Largest over smallest singular value of the regressor, of unit gravity: 1.3 for poses that tilt every way.
  double condition = 0.0;
  std::vector<Vector6d> residuals;  ///< reading minus model, per pose: the largest tells a bad pose
  // Standard deviations from the residuals, for readings whose errors are independent between poses:
  double mass_deviation = 0.0;                  ///< [kg]
  Eigen::Vector3d centre_deviation{ 0, 0, 0 };  ///< [m], to first order
  Vector6d bias_deviation = Vector6d::Zero();   ///< [N, Nm]
};

constexpr std::size_t kFewestPoses = 8;
/// Root mean square of how far gravity's direction (a unit vector in the sensor's frame) must depart from its mean,
/// across the direction that is looked for: 0.1 is a tilt of 6 degrees either way.
constexpr double kLeastExcitation = 0.1;
constexpr double kLeastMass = 0.01;  ///< [kg] below it the centre of mass cannot be told

/// Means of the readings at rest in at least 8 poses, `orientations[i]` with `wrenches[i]`. Throws
/// std::invalid_argument, all causes at once: too few poses, unequal counts, a matrix that is no rotation, a reading
/// that is not finite (with the pose's number from 0); poses that do not tell the mass, or one direction of the centre
/// of mass, apart from the bias (that direction, excitation and bound); a negative mass (the readings' sign); a mass
/// too small to have a centre.
PayloadEstimate identifyPayload(const std::vector<Eigen::Matrix3d>& orientations,
                                const std::vector<Vector6d>& wrenches);
}  // namespace phri_control
