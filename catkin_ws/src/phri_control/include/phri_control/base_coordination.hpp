#pragma once
#include <Eigen/Geometry>

namespace phri_control
{
/// Planar velocity of an omnidirectional base in its own axes: [x', y', yaw'] [m/s, m/s, rad/s].
using BaseTwist = Eigen::Vector3d;

/// Where the base ought to be, seen from where it is (figure 5.5), in the base's axes.
struct BaseErrors
{
  double heading = 0.0;     ///< e_hdg [rad], in (-pi, pi]
  double distance = 0.0;    ///< e_dst [m], along the base's x: positive, the end-effector is too far ahead
  double tangential = 0.0;  ///< e_tng [m], along the base's y
};

/// Errors of the base pose with respect to the end-effector pose x_m, given the preferred one x_d (both in the base's
/// frame R; only x, y and the rotation about the vertical count). The base pose that would see the end-effector at x_d
/// is x_m x_d^-1 in R, hence
///   e_hdg = yaw of R_m R_d',   [e_dst; e_tng] = p_m - Rot(e_hdg) p_d.
/// All three vanish exactly if x_m = x_d. The thesis draws the errors but does not define them; this reading makes the
/// three laws independent: with the end-effector at rest e_hdg decays with K_hdg alone, and the distance of the base
/// from its goal with K_dst = K_tng alone, however the base turns. Its x axis is "distance" since the arms are mounted
/// at the front. Trap: turning the end-effector by an angle sends the base round it on an arc of radius |p_d|.
BaseErrors baseErrors(const Eigen::Isometry3d& actual, const Eigen::Isometry3d& preferred) noexcept;

struct CoordinationSettings
{
  double heading_gain = 3.0;       ///< K_hdg [1/s]
  double distance_gain = 3.0;      ///< K_dst [1/s]
  double tangential_gain = 3.0;    ///< K_tng [1/s]
  double feedforward = 0.0;        ///< [0, 1] of the end-effector's own motion; 0: the thesis' law
  double speed = 0.8;              ///< [m/s] largest
  double turn_rate = 1.2;          ///< [rad/s] largest
  double acceleration = 0.8;       ///< [m/s^2] largest change of the commanded velocity, in the base's axes
  double turn_acceleration = 1.5;  ///< [rad/s^2]
  double dead_zone = 0.0;          ///< [m] distance of the base from its goal that is not corrected
  double heading_dead_zone = 0.0;  ///< [rad] likewise
  double dt = 0.001;               ///< [s]
  Eigen::Isometry3d preferred = Eigen::Isometry3d::Identity();  ///< x_d of the end-effector in the base's frame
};

/// The base control law of 5.1.2,
///   [yaw'; x'; y'] = diag(K_hdg, K_dst, K_tng) [e_hdg; e_dst; e_tng].
/// A proportional law brakes with K v; where that is more than the acceleration a, the speed follows the parabola of
/// braking instead, v = sqrt(2 a e - a^2 / K^2) for e > a / K^2, so that the base does not overshoot. Speeds are
/// limited with their direction kept, then the changes. While its goal moves at v the base lags v / K behind, for which
/// the arm's workspace must have room; the feed-forward of the goal's velocity, not in the thesis, removes the lag.
/// `update` is noexcept and allocates nothing.
class BaseCoordination
{
public:
  /// Throws std::invalid_argument naming the setting, its value and its range.
  explicit BaseCoordination(const CoordinationSettings& settings);

  /// Command of this tick for the end-effector's pose in the base's frame, and for its planar velocity [x', y', yaw']
  /// over the ground, in the base's axes (used by the feed-forward only). What is not finite brings the base to rest
  /// within the acceleration limits.
  BaseTwist update(const Eigen::Isometry3d& end_effector, const Eigen::Vector3d& motion = { 0, 0, 0 }) noexcept;
  /// Brakes within the acceleration limits.
  BaseTwist brake() noexcept { return approach(BaseTwist::Zero()); }
  void reset() noexcept { command_.setZero(); }

  const BaseErrors& errors() const { return errors_; }  ///< of the last update, before the dead zone
  const CoordinationSettings& settings() const { return settings_; }

private:
  BaseTwist approach(const BaseTwist& wanted) noexcept;
  CoordinationSettings settings_;
  BaseErrors errors_;
  BaseTwist command_ = BaseTwist::Zero();
};
}  // namespace phri_control
