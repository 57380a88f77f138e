#pragma once
/// Kinematics of one serial arm of revolute joints: KDL's chain of the URDF text, and differential inverse kinematics
/// with damping, posture, joint limits and pose feedback. Vectors of motion have their linear part first, in the axes
/// of the chain's base link, for the origin of its tip. What runs in the tick is noexcept and allocates nothing.

#include <Eigen/Geometry>
#include <kdl/chain.hpp>
#include <string>
#include <vector>

#include "phri_core/random.hpp"

namespace phri_control
{
constexpr int kMaxArmJoints = 8;
using Twist = Eigen::Matrix<double, 6, 1>;  ///< linear first [m/s, rad/s]
/// One value per joint of an arm [rad, rad/s]. Lives on the stack.
using VectorJoints = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxArmJoints, 1>;
/// Joint velocities to twist; lives on the stack.
using ArmJacobian = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kMaxArmJoints>;

/// Geometry and limits of the joints between two links; fixed links in between are merged, so that a chain from
/// `base_link` to `<arm>_tool0` includes the mount. The joint vector has them in order from base to tip. Trap: KDL's
/// joints cache their last pose, so that one object must not be used by two threads at once; copies are independent.
class ArmKinematics
{
public:
  /// Reads the URDF text (not a file name). Throws std::invalid_argument naming the joint or link and what is wrong: no
  /// URDF, unknown link, tip not below base, a joint that neither turns nor is fixed, none or more than kMaxArmJoints
  /// joints, a limit that is missing or not in order. A continuous joint has infinite limits of position.
  ArmKinematics(const std::string& urdf, const std::string& base_link, const std::string& tip_link);

  int joints() const { return static_cast<int>(names_.size()); }
  const std::vector<std::string>& jointNames() const { return names_; }
  const VectorJoints& lower() const { return lower_; }        ///< [rad]
  const VectorJoints& upper() const { return upper_; }        ///< [rad]
  const VectorJoints& velocity() const { return velocity_; }  ///< largest [rad/s]
  const KDL::Chain& chain() const { return chain_; }

  /// Pose of the tip in the base link. `q` must have `joints()` elements here and below.
  Eigen::Isometry3d forward(const VectorJoints& q) const noexcept;
  /// The same, and the Jacobian at the tip's origin in axes of the base link.
  Eigen::Isometry3d forward(const VectorJoints& q, ArmJacobian& jacobian) const noexcept;

private:
  KDL::Chain chain_;
  std::vector<std::string> names_;
  VectorJoints lower_, upper_, velocity_;
};

/// Yoshikawa's measure sqrt(det(J J')) [m^3]: product of the singular values, 0 in a singular posture.
double manipulability(const ArmJacobian& jacobian) noexcept;
/// Its derivative by the joint positions [m^3/rad]; 0 where the measure itself is 0.
VectorJoints manipulabilityGradient(const ArmJacobian& jacobian) noexcept;

/// Difference [m, rad] that leads from `actual` to `desired`, in the axes both are expressed in: difference of the
/// origins, then rotation vector of R_desired R_actual' (at most pi long; at pi its sign is arbitrary).
Twist poseError(const Eigen::Isometry3d& desired, const Eigen::Isometry3d& actual) noexcept;

/// Bounds of every joint's velocity in a tick [rad/s].
struct VelocityBounds
{
  VectorJoints lower, upper;
};

/// Velocities from which every joint can still stop before its limit with a deceleration `acceleration` [rad/s^2]:
///   v dt + v^2 / (2 a) <= d    or    v <= a (sqrt(dt^2 + 2 d / a) - dt),
/// with the distance d to the limit less `margin` [rad], and never above the joint's largest velocity. Following the
/// bound needs no deceleration above a. Beyond a limit the bound outward is 0 and inward as ever: 0 is always allowed.
VelocityBounds jointFunnel(const ArmKinematics& arm, const VectorJoints& q, double acceleration, double margin,
                           double dt) noexcept;

struct InverseSettings
{
  double dt = 0.001;                 ///< [s] of a tick
  double length = 0.3;               ///< [m] a rotation of 1 rad counts like a motion of so much
  double singular_value = 0.04;      ///< [m] eps: below it a direction of motion is damped
  double pose_gain = 20.0;           ///< [1/s] feedback of the pose error; 0 for none
  double feedback_linear = 0.1;      ///< [m/s] largest speed that the feedback asks for
  double feedback_angular = 0.5;     ///< [rad/s] likewise
  double posture_gain = 1.0;         ///< [1/s] null-space motion toward the posture; 0 for none
  double posture_velocity = 0.5;     ///< [rad/s] largest of any joint, before projection
  double manipulability_gain = 0.0;  ///< [rad^2/(m^3 s)] null-space motion up the manipulability's gradient
  double joint_acceleration = 5.0;   ///< [rad/s^2] of the funnel before the joint limits
  double limit_margin = 0.02;        ///< [rad] kept from the joint limits
  double velocity_share = 1.0;       ///< (0, 1] of the largest joint velocities
  VectorJoints posture;              ///< preferred [rad]; empty: the middle of the limits (0 where infinite)
};

/// What one differential inverse gives.
struct ArmRates
{
  VectorJoints velocity;        ///< command [rad/s]; 0 unless `valid`
  double scale = 0.0;           ///< [0, 1] share of the twist that the joint limits leave; its direction is kept
  double singular_value = 0.0;  ///< [m] smallest of the Jacobian, rotations weighted by `length`
  double manipulability = 0.0;  ///< [m^3]
  bool valid = false;           ///< false: input not finite (or of another size), the arm is told to stand still
};

/// Twist and pose of the tip -> joint velocities. With the weighted Jacobian W J = U diag(sigma) V', W = diag(1, 1, 1,
/// length, length, length), and the corrected twist v = V_d + pose_gain * (pose error, limited):
///   q'_t = sum_i sigma_i / (sigma_i^2 + lambda_i^2) v_i (u_i' W v),
///   lambda_i^2 = (eps / 2)^2 (1 - (sigma_i / eps)^2) for sigma_i < eps, else 0.
/// Only directions near a singularity are damped, continuously, and |q'_t| <= 2 / (sqrt(3) eps) |W v| for any posture.
/// The posture's motion is projected onto the null space of J. If the sum leaves jointFunnel's bounds, the largest
/// share s of q'_t that some motion along the null direction of the worst joint makes possible is taken (with seven
/// joints: the largest possible at all), s in [0, 1], so that the tip slows down but keeps its direction. State law:
/// none; feedback and bounds depend on the present q alone. Trap: while `scale` < 1, or where damped, the tip lags
/// behind the desired pose and catches up later with at most the feedback's speed.
class DifferentialInverse
{
public:
  /// Throws std::invalid_argument naming the setting, its value and its range.
  DifferentialInverse(const ArmKinematics& arm, const InverseSettings& settings);

  /// For the posture `q` [rad]; `pose` and `twist` desired of the tip, in the chain's base link. `correct` = false
  /// ignores `pose`.
  ArmRates solve(const VectorJoints& q, const Eigen::Isometry3d& pose, const Twist& twist,
                 bool correct = true) const noexcept;
  /// The same where pose and Jacobian at `q` are known already.
  ArmRates solve(const VectorJoints& q, const Eigen::Isometry3d& actual, const ArmJacobian& jacobian,
                 const Eigen::Isometry3d& pose, const Twist& twist, bool correct = true) const noexcept;

  const ArmKinematics& arm() const { return arm_; }
  const InverseSettings& settings() const { return settings_; }

private:
  ArmKinematics arm_;
  InverseSettings settings_;
};

/// A posture for a pose of the tip.
struct PostureResult
{
  VectorJoints posture;    ///< [rad] best found, within the limits less the margin
  double error = 0.0;      ///< [m] its pose error, rotations weighted by `length`
  int iterations = 0;      ///< of all attempts
  bool converged = false;  ///< error at most `tolerance`
};

/// Position-level inverse by iterated damped steps, first from `start`, then from up to `attempts` random postures;
/// returns the first solution found, drawn toward `settings.posture` on the way. For start-up, not for the tick. Throws
/// std::invalid_argument if `start` has the wrong size or is not finite, or `pose` is not finite.
PostureResult findPosture(const DifferentialInverse& inverse, const Eigen::Isometry3d& pose, const VectorJoints& start,
                          phri_core::Random& random, int attempts = 20, double tolerance = 1e-9);
}  // namespace phri_control
