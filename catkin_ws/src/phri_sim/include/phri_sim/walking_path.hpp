#pragma once
#include <Eigen/Core>
#include <vector>

namespace phri_sim
{
/// A place along a walking path.
struct PathPoint
{
  Eigen::Vector2d position{ 0, 0 };  ///< [m]
  double heading = 0.0;              ///< [rad] of the tangent from the x axis, continuous along the path
  double curvature = 0.0;            ///< [1/m] left turns positive
};

/// Motion of a point that walks along a path.
struct PathMotion
{
  Eigen::Vector2d position{ 0, 0 }, velocity{ 0, 0 }, acceleration{ 0, 0 };  ///< [m, m/s, m/s2]
  double heading = 0.0;                                                      ///< [rad]
  double heading_rate = 0.0;                                                 ///< [rad/s]
};

/// How fast somebody walks along a path.
struct WalkingPace
{
  double speed = 0.16;        ///< [m/s] where it is straight
  double exponent = 0.33;     ///< beta: speed ~ curvature^-beta in bends
  double straight = 0.5;      ///< [1/m] less curvature slows nobody
  double slowest = 0.75;      ///< share of `speed` that is kept in any bend
  double acceleration = 0.1;  ///< [m/s2] along the path
};

/// A smooth path through waypoints, by arc length. Between the corners it is straight; in a corner of angle theta the
/// heading turns as theta h(s / l), h(u) = 10 u^3 - 15 u^4 + 6 u^5 (minimum jerk, Flash and Hogan 1985) over the length
/// l = 1.875 |theta| r, so that curvature and its derivative are continuous and the tightest radius is r. The path cuts
/// the corner: it passes through the first and the last waypoint only.
class WalkingPath
{
public:
  /// `tightest_radius` r [m]. Throws std::invalid_argument naming all that is wrong: fewer than two waypoints, two
  /// equal ones in succession, a reversal (more than 170 degrees), a leg too short for its corners.
  WalkingPath(const std::vector<Eigen::Vector2d>& waypoints, double tightest_radius);

  double length() const noexcept { return length_; }  ///< [m]
  /// s [m] is clamped to the path. Heading and curvature are exact, the position is better than 1e-8 m.
  PathPoint at(double s) const noexcept;
  /// Walking at `speed` [m/s] that changes by `rate` [m/s2] along the path.
  PathMotion motion(double s, double speed, double rate) const noexcept;
  /// Arc length of the point nearest to x within `reach` [m] of s, to second order in the distance moved.
  double project(const Eigen::Vector2d& x, double s, double reach) const noexcept;

  static constexpr double kStep = 0.005;  ///< [m] between samples of whatever is tabulated along a path

private:
  struct Piece  ///< a straight (turn = 0) or a corner
  {
    double start, length, heading, turn;
  };
  PathPoint direction(double s) const noexcept;  // all but the position
  std::vector<Piece> pieces_;
  std::vector<Eigen::Vector2d> points_;
  double length_ = 0.0, step_ = kStep;
};

/// Values tabulated along a path, every `step` [m] from s = 0.
struct AlongPath
{
  double step = WalkingPath::kStep;
  std::vector<double> values;
  double at(double s) const noexcept;     ///< linear in between, clamped
  double slope(double s) const noexcept;  ///< [1/m]
};

/// Speed [m/s] along the path: slower in bends, braking in time for them and for the end. At the very ends it is 10
/// mm/s and not 0, so that whoever integrates it gets away and arrives.
AlongPath paceAlong(const WalkingPath& path, const WalkingPace& pace);

/// Yaw [rad] of a rod of `length` [m] whose front end is drawn along the path, its rear end trailing without moving
/// sideways (tractrix: d yaw / d s = sin(heading - yaw) / length). It points from rear to front. Throws
/// std::invalid_argument unless length > 0.
AlongPath trailingYaw(const WalkingPath& path, double length, double initial_yaw);

/// 10 u^3 - 15 u^4 + 6 u^5 between 0 and 1, constant outside.
double minimumJerk(double u) noexcept;
}  // namespace phri_sim
