#pragma once
/// Arm and base together, so that the admittance can live in the inertial frame (figure 5.4). An inertial frame is the
/// odometry's `odom`: its drift is not seen here.

#include <Eigen/Geometry>

#include "phri_control/base_coordination.hpp"
#include "phri_control/kinematics.hpp"
#include "phri_core/spatial.hpp"

namespace phri_control
{
/// What the base's odometry says.
struct BaseState
{
  Eigen::Vector3d pose = Eigen::Vector3d::Zero();  ///< [x, y, yaw] of base_link in the inertial frame [m, rad]
  BaseTwist twist = BaseTwist::Zero();             ///< measured, in the base's axes [m/s, rad/s]
  Eigen::Isometry3d transform() const noexcept;    ///< base_link in the inertial frame
};

/// Where the end-effector (the chain's tip) is to be and how it is to move, in the inertial frame.
struct EndEffectorCommand
{
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  Twist twist = Twist::Zero();  ///< of the tip's origin, in inertial axes
};

/// From a planar admittance [x, y, yaw]: fixed height [m], level: `level` is the tip's orientation at yaw = 0.
EndEffectorCommand planarCommand(const phri_core::VectorDof& position, const phri_core::VectorDof& velocity,
                                 double height, const Eigen::Matrix3d& level) noexcept;
/// From an admittance [x, y, z] at a fixed orientation.
EndEffectorCommand pointCommand(const phri_core::VectorDof& position, const phri_core::VectorDof& velocity,
                                const Eigen::Matrix3d& orientation) noexcept;

struct WholeBodySettings
{
  InverseSettings inverse;
  CoordinationSettings coordination;
  bool base_moves = true;  ///< false: the base is told to stand; motion it has nevertheless is compensated for
};

struct WholeBodyCommand
{
  BaseTwist base = BaseTwist::Zero();  ///< for the base's velocity loop, in its axes
  ArmRates arm;
  Eigen::Isometry3d end_effector = Eigen::Isometry3d::Identity();  ///< actual, in the inertial frame
  Twist error = Twist::Zero();  ///< pose error before this tick's command [m, rad], in inertial axes
};

/// The position control of figure 5.4: the base follows the end-effector by BaseCoordination, the arm gets the
/// commanded twist less what the base's measured motion contributes,
///   v_arm = R_b' v_cmd - [v_b + w_b x p; w_b],
/// plus DifferentialInverse's pose feedback, so that the base's motion does not move the end-effector. The arm's chain
/// starts at base_link (the mount is part of it), whose z axis is vertical.
/// Limits: errors of the measured base twist (e.g. its delay T) appear at the end-effector as |a_b| T / pose_gain.
class WholeBody
{
public:
  /// Throws std::invalid_argument like DifferentialInverse and BaseCoordination, or if their dt differ.
  WholeBody(const ArmKinematics& arm, const WholeBodySettings& settings);

  /// One tick, noexcept and without allocation. What is not finite stops the arm and brakes the base.
  WholeBodyCommand update(const VectorJoints& q, const BaseState& base, const EndEffectorCommand& command) noexcept;
  void reset() noexcept { coordination_.reset(); }

  const DifferentialInverse& inverse() const { return inverse_; }
  const BaseCoordination& coordination() const { return coordination_; }

private:
  DifferentialInverse inverse_;
  BaseCoordination coordination_;
  bool base_moves_;
};
}  // namespace phri_control
