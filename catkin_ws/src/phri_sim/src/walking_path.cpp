#include "phri_sim/walking_path.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

namespace phri_sim
{
namespace
{
using Eigen::Vector2d;
constexpr double kSteepest = 1.875;                 // of the minimum-jerk turn: h'(1/2)
constexpr double kReversal = 170.0 / 180.0 * M_PI;  // [rad] sharper than this is no corner
constexpr double kShortest = 1e-6;                  // [m] waypoints nearer than this are one
constexpr double kEndSpeed = 0.01;                  // [m/s]
constexpr int kIntervals = 200;                     // of Simpson's rule over a corner

double wrapped(double angle)
{
  return std::remainder(angle, 2.0 * M_PI);
}

Vector2d along(double heading)
{
  return { std::cos(heading), std::sin(heading) };
}

/// Distance from the corner's tip at which a turn by `angle` of length `turn` begins and ends.
double setback(double angle, double turn)
{
  const auto f = [&](int k) { return std::cos(angle * (minimumJerk(double(k) / kIntervals) - 0.5)); };
  double sum = f(0) + f(kIntervals);
  for (int k = 1; k < kIntervals; ++k)
    sum += (k % 2 ? 4.0 : 2.0) * f(k);
  return turn * sum / (3.0 * kIntervals) / (2.0 * std::cos(0.5 * angle));
}
}  // namespace

double minimumJerk(double u) noexcept
{
  u = std::clamp(u, 0.0, 1.0);
  return u * u * u * (10.0 + u * (-15.0 + 6.0 * u));
}

WalkingPath::WalkingPath(const std::vector<Vector2d>& waypoints, double tightest_radius)
{
  std::ostringstream errors;
  const std::size_t n = waypoints.size();
  if (n < 2)
    errors << "; " << n << " waypoints: expected at least 2";
  if (!(tightest_radius > 0.0))
    errors << "; tightest radius " << tightest_radius << " m: expected more than 0";
  std::vector<double> leg, heading, back(std::max<std::size_t>(n, 1), 0.0);
  for (std::size_t k = 0; k + 1 < n; ++k)
  {
    const Vector2d d = waypoints[k + 1] - waypoints[k];
    leg.push_back(d.norm());
    if (!(d.norm() > kShortest))
      errors << "; waypoints " << k << " and " << k + 1 << " are the same: expected a leg between them";
    const double direction = std::atan2(d(1), d(0));
    heading.push_back(k == 0 ? direction : heading.back() + wrapped(direction - heading.back()));
  }
  if (errors.str().empty())
    for (std::size_t k = 1; k + 1 < n; ++k)
    {
      const double turn = heading[k] - heading[k - 1];
      if (std::abs(turn) > kReversal)
        errors << "; at waypoint " << k << " the path turns by " << turn * 180.0 / M_PI << " deg: expected at most 170";
      else
        back[k] = setback(turn, kSteepest * std::abs(turn) * tightest_radius);
    }
  if (errors.str().empty())
    for (std::size_t k = 0; k + 1 < n; ++k)
      if (back[k] + back[k + 1] > leg[k])
        errors << "; the leg from waypoint " << k << " to " << k + 1 << " is " << leg[k]
               << " m long, its corners of radius " << tightest_radius << " m need " << back[k] + back[k + 1] << " m";
  if (!errors.str().empty())
    throw std::invalid_argument("walking path: " + errors.str().substr(2));

  double s = 0.0;
  for (std::size_t k = 0; k + 1 < n; ++k)
  {
    const double straight = leg[k] - back[k] - back[k + 1];
    pieces_.push_back({ s, straight, heading[k], 0.0 });
    s += straight;
    if (k + 2 == n || heading[k + 1] == heading[k])
      continue;
    const double turn = heading[k + 1] - heading[k], length = kSteepest * std::abs(turn) * tightest_radius;
    pieces_.push_back({ s, length, heading[k], turn });
    s += length;
  }
  length_ = s;
  const int steps = std::max(1, int(std::ceil(length_ / kStep)));
  step_ = length_ / steps;
  points_.reserve(steps + 1);
  points_.push_back(waypoints.front());
  for (int k = 0; k < steps; ++k)
  {
    const Vector2d left = along(direction(k * step_).heading), middle = along(direction((k + 0.5) * step_).heading),
                   right = along(direction((k + 1) * step_).heading);
    points_.push_back(points_.back() + step_ / 6.0 * (left + 4.0 * middle + right));
  }
}

PathPoint WalkingPath::direction(double s) const noexcept
{
  auto piece =
      std::upper_bound(pieces_.begin(), pieces_.end(), s, [](double v, const Piece& p) { return v < p.start; });
  const Piece& p = piece == pieces_.begin() ? *piece : *(piece - 1);
  PathPoint point;
  point.heading = p.heading;
  if (p.turn == 0.0)
    return point;
  const double u = std::clamp((s - p.start) / p.length, 0.0, 1.0);
  point.heading += p.turn * minimumJerk(u);
  point.curvature = p.turn / p.length * 30.0 * u * u * (1.0 - u) * (1.0 - u);
  return point;
}

PathPoint WalkingPath::at(double s) const noexcept
{
  s = std::clamp(s, 0.0, length_);
  PathPoint point = direction(s);
  const std::size_t k = std::min(std::size_t(s / step_), points_.size() - 2);
  // cubic with the tangents at both samples
  const double u = s / step_ - double(k), v = 1.0 - u;
  const Vector2d left = along(direction(k * step_).heading), right = along(direction((k + 1) * step_).heading);
  point.position = v * v * (1.0 + 2.0 * u) * points_[k] + u * u * (1.0 + 2.0 * v) * points_[k + 1] +
                   step_ * u * v * (v * left - u * right);
  return point;
}

PathMotion WalkingPath::motion(double s, double speed, double rate) const noexcept
{
  const PathPoint point = at(s);
  const Vector2d tangent = along(point.heading), left(-tangent(1), tangent(0));
  return { point.position, speed * tangent, rate * tangent + speed * speed * point.curvature * left, point.heading,
           speed * point.curvature };
}

double WalkingPath::project(const Vector2d& x, double s, double reach) const noexcept
{
  double found = s;
  for (int iteration = 0; iteration < 3; ++iteration)
  {
    const PathPoint point = at(found);
    found = std::clamp(found + along(point.heading).dot(x - point.position), s - reach, s + reach);
    found = std::clamp(found, 0.0, length_);
  }
  return found;
}

double AlongPath::at(double s) const noexcept
{
  const double place = std::clamp(s / step, 0.0, double(values.size() - 1));
  const std::size_t k = std::min(std::size_t(place), values.size() - 2);
  return values[k] + (place - double(k)) * (values[k + 1] - values[k]);
}

double AlongPath::slope(double s) const noexcept
{
  const std::size_t last = values.size() - 1;
  const auto central = [&](std::size_t k) {
    const std::size_t left = k == 0 ? 0 : k - 1, right = std::min(k + 1, last);
    return (values[right] - values[left]) / (step * double(right - left));
  };
  const double place = std::clamp(s / step, 0.0, double(last));
  const std::size_t k = std::min(std::size_t(place), last - 1);
  const double u = place - double(k);
  return (1.0 - u) * central(k) + u * central(k + 1);
}

AlongPath paceAlong(const WalkingPath& path, const WalkingPace& pace)
{
  const int steps = std::max(1, int(std::ceil(path.length() / WalkingPath::kStep)));
  AlongPath along{ path.length() / steps, std::vector<double>(steps + 1) };
  std::vector<double>& v = along.values;
  for (int k = 0; k <= steps; ++k)
  {
    const double bend = std::max(1.0, std::abs(path.at(k * along.step).curvature) / pace.straight);
    v[k] = pace.speed * std::max(pace.slowest, std::pow(bend, -pace.exponent));
  }
  v.front() = std::min(v.front(), kEndSpeed);
  v.back() = std::min(v.back(), kEndSpeed);
  for (int k = steps - 1; k >= 0; --k)
    v[k] = std::min(v[k], std::sqrt(v[k + 1] * v[k + 1] + 2.0 * pace.acceleration * along.step));
  for (int k = 1; k <= steps; ++k)
    v[k] = std::min(v[k], std::sqrt(v[k - 1] * v[k - 1] + 2.0 * pace.acceleration * along.step));
  return along;
}

AlongPath trailingYaw(const WalkingPath& path, double length, double initial_yaw)
{
  if (!(length > 0.0))
    throw std::invalid_argument("trailing yaw: rod of " + std::to_string(length) + " m: expected more than 0");
  const int steps = std::max(1, int(std::ceil(path.length() / WalkingPath::kStep)));
  AlongPath along{ path.length() / steps, { initial_yaw } };
  const double h = along.step;
  const auto f = [&](double s, double yaw) { return std::sin(path.at(s).heading - yaw) / length; };
  for (int k = 0; k < steps; ++k)
  {
    const double s = k * h, y = along.values.back();
    const double k1 = f(s, y), k2 = f(s + 0.5 * h, y + 0.5 * h * k1), k3 = f(s + 0.5 * h, y + 0.5 * h * k2),
                 k4 = f(s + h, y + h * k3);
    along.values.push_back(y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4));
  }
  return along;
}
}  // namespace phri_sim
