#pragma once
#include <Eigen/Core>
#include <vector>

#include "phri_sim/scene.hpp"

namespace phri_sim
{
/// A path through a scene, sampled every `step` of arc length, ends included.
struct Route
{
  double step = 0.001;                    ///< [m]
  std::vector<Eigen::Vector2d> points;    ///< [m]
  std::vector<Eigen::Vector2d> tangents;  ///< unit vectors
  std::vector<double> curvature;          ///< [1/m], signed, left turns positive
  std::vector<double> clearance;          ///< [m] between the object's rim and the walls

  double length() const { return step * (points.size() - 1); }
  /// Interpolates linearly; s [m] is clamped to the route.
  Eigen::Vector2d position(double s) const;
  Eigen::Vector2d tangent(double s) const;
  double interpolate(const std::vector<double>& values, double s) const;
  /// Arc length of the point nearest to x within `reach` [m] of s.
  double project(const Eigen::Vector2d& x, double s, double reach) const;
};

/// The comfortable way from the scene's start to its goal: least time where the pace falls linearly with the clearance
/// below `preferred_clearance` [m] (fast marching on a 2 mm grid, then descent and smoothing over 30 mm), so that it
/// keeps to the middle of narrow passages and rounds corners. The grid gets finer where 2 mm knows no way, coarser
/// where the scene is longer than 2 m; less is smoothed where that would lead too near to a wall. Throws PictureError
/// when no way leads to the goal, or start and goal are nearer than 10 mm. A
/// scene with a path: that path.
Route planRoute(const Scene& scene, double preferred_clearance);

/// An exemplary run along a route, to be followed (the black dot of 5.1.1): all of it in `duration` [s], slower where
/// it bends (two-thirds power law) and at both ends.
class Pace
{
public:
  /// Throws std::invalid_argument unless duration > 0.
  Pace(const Route& route, double duration);
  /// Arc length [m] of the dot, t [s] after the start.
  double at(double t) const;

private:
  double step_;
  std::vector<double> arrivals_;  // [s] at each point of the route
};
}  // namespace phri_sim
