#include "phri_sim/route.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <stdexcept>

namespace phri_sim
{
namespace
{
using Eigen::Vector2d;
constexpr double kCell = 0.002;            // [m] grid of the arrival times, where the scene is neither large nor narrow
constexpr int kMostCells = 1024;           // along the longer side: a million cells take about half a second
constexpr double kSlowest = 0.05;          // pace next to a wall, relative to the free one
constexpr double kSmoothing = 0.03;        // [m] width of the moving average
constexpr double kRoundedClearance = 0.3;  // of the narrowest place of the line, at least kept when it is rounded
constexpr double kStraight = 5.0;          // [1/m] less curvature makes an exemplary run no faster
constexpr double kRunUp = 0.01;            // [m] within which it gathers and loses speed
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Arrival times at the goal over a grid, by first-order fast marching (Sethian 1996).
class ArrivalTimes
{
public:
  ArrivalTimes(const Scene& scene, double preferred, double cell)
    : cell_(cell),
      origin_(scene.walls.origin()),
      width_(int(std::ceil(scene.walls.width() * scene.walls.resolution() / cell))),
      height_(int(std::ceil(scene.walls.height() * scene.walls.resolution() / cell))),
      pace_(std::size_t(width_) * height_, 0.0),
      time_(pace_.size(), kInfinity)
  {
    for (int j = 0; j < height_; ++j)
      for (int i = 0; i < width_; ++i)
      {
        const double clearance = scene.clearance(center(i, j));
        if (clearance > 0.0)
          pace_[index(i, j)] = std::clamp(clearance / preferred, kSlowest, 1.0);
      }
    march(scene.goal);
  }

  double at(const Vector2d& x) const
  {
    const double u = (x(0) - origin_(0)) / cell_ - 0.5, v = (x(1) - origin_(1)) / cell_ - 0.5;
    const int i = int(std::floor(u)), j = int(std::floor(v));
    if (i < 0 || j < 0 || i + 1 >= width_ || j + 1 >= height_)
      return kInfinity;
    const double a = u - i, b = v - j;
    // 0 * infinity is not a number: a corner without weight must not count
    const auto part = [&](double weight, int column, int row) {
      return weight > 0.0 ? weight * time_[index(column, row)] : 0.0;
    };
    return part((1 - a) * (1 - b), i, j) + part(a * (1 - b), i + 1, j) + part((1 - a) * b, i, j + 1) +
           part(a * b, i + 1, j + 1);
  }

private:
  std::size_t index(int i, int j) const { return std::size_t(j) * width_ + i; }
  Vector2d center(int i, int j) const { return origin_ + cell_ * Vector2d(i + 0.5, j + 0.5); }
  double known(int i, int j) const
  {
    return i < 0 || j < 0 || i >= width_ || j >= height_ ? kInfinity : time_[index(i, j)];
  }

  void march(const Vector2d& goal)
  {
    using Item = std::pair<double, std::size_t>;
    std::priority_queue<Item, std::vector<Item>, std::greater<Item>> front;
    std::vector<char> done(time_.size(), 0);
    for (int j = 0; j < height_; ++j)
      for (int i = 0; i < width_; ++i)
        if (pace_[index(i, j)] > 0.0 && (center(i, j) - goal).norm() < 1.5 * cell_)
        {
          time_[index(i, j)] = (center(i, j) - goal).norm() / pace_[index(i, j)];
          front.push({ time_[index(i, j)], index(i, j) });
        }
    while (!front.empty())
    {
      const std::size_t cell = front.top().second;
      front.pop();
      if (done[cell])
        continue;
      done[cell] = 1;
      const int i = int(cell % width_), j = int(cell / width_);
      for (const auto& [column, row] : { std::pair(i + 1, j), { i - 1, j }, { i, j + 1 }, { i, j - 1 } })
      {
        if (column < 0 || row < 0 || column >= width_ || row >= height_)
          continue;
        const std::size_t next = index(column, row);
        if (done[next] || pace_[next] == 0.0)
          continue;
        const double a = std::min(known(column - 1, row), known(column + 1, row));
        const double b = std::min(known(column, row - 1), known(column, row + 1));
        const double cost = cell_ / pace_[next], gap = std::abs(a - b);
        const double time =
            gap < cost ? 0.5 * (a + b + std::sqrt(2.0 * cost * cost - gap * gap)) : std::min(a, b) + cost;
        if (time < time_[next])
        {
          time_[next] = time;
          front.push({ time, next });
        }
      }
    }
  }

  double cell_;  // [m]
  Vector2d origin_;
  int width_, height_;
  std::vector<double> pace_, time_;
};

/// From the start to the goal along falling arrival times; empty when the grid knows no way.
std::vector<Vector2d> descend(const ArrivalTimes& times, const Scene& scene, double cell)
{
  constexpr int kDirections = 48;
  const double stride = 0.75 * cell;
  std::vector<Vector2d> line{ scene.start };
  double time = times.at(scene.start);
  while ((line.back() - scene.goal).norm() > 2.0 * stride)
  {
    Vector2d best = line.back();
    for (int k = 0; k < kDirections; ++k)
    {
      const double angle = 2.0 * M_PI * k / kDirections;
      const Vector2d candidate = line.back() + stride * Vector2d(std::cos(angle), std::sin(angle));
      const double reached = times.at(candidate);
      if (reached < time)
      {
        time = reached;
        best = candidate;
      }
    }
    if (best == line.back())
      return {};
    line.push_back(best);
  }
  line.push_back(scene.goal);
  return line;
}

/// The line on the coarsest grid that knows a way.
std::vector<Vector2d> findLine(const Scene& scene, double preferred)
{
  const double extent = std::max(scene.walls.width(), scene.walls.height()) * scene.walls.resolution();
  // on a grid wider than the object, a step could pass through a thin wall
  double cell = std::max(std::min(kCell, 2.0 * scene.object_radius), extent / kMostCells);
  for (;; cell = std::max(0.5 * cell, extent / kMostCells))
  {
    std::vector<Vector2d> line = descend(ArrivalTimes(scene, preferred, cell), scene, cell);
    if (!line.empty())
      return line;
    if (cell <= extent / kMostCells || cell <= 0.5 * scene.walls.resolution())
      break;
  }
  throw PictureError("scene " + scene.name + ": no way leads from the start to the goal for an object of radius " +
                     std::to_string(scene.object_radius) + " m on a grid of " + std::to_string(cell) +
                     " m: expected a wider passage");
}

std::vector<Vector2d> resample(const std::vector<Vector2d>& line, double step)
{
  std::vector<Vector2d> points{ line.front() };
  double left = step;
  for (std::size_t k = 1; k < line.size(); ++k)
  {
    const Vector2d piece = line[k] - line[k - 1];
    const double length = piece.norm();
    for (; left <= length; left += step)
      points.push_back(line[k - 1] + piece * (left / length));
    left -= length;
  }
  return points;
}

std::vector<Vector2d> smooth(const std::vector<Vector2d>& line, int half)
{
  std::vector<Vector2d> out(line.size());
  const int last = int(line.size()) - 1;
  for (int k = 0; k <= last; ++k)
  {
    const int reach = std::min({ half, k, last - k });  // the ends stay where they are
    Vector2d sum = Vector2d::Zero();
    for (int i = k - reach; i <= k + reach; ++i)
      sum += line[i];
    out[k] = sum / (2 * reach + 1);
  }
  return out;
}
/// The least clearance [m] along a line; also between its points, as far apart as a wall thinner than the gap could
/// hide.
double narrowest(const Scene& scene, const std::vector<Vector2d>& line, double step)
{
  const int parts = std::max(1, int(std::ceil(step / (2.0 * scene.object_radius))));
  double least = scene.clearance(line.front());
  for (std::size_t k = 1; k < line.size(); ++k)
    for (int i = 1; i <= parts; ++i)
      least = std::min(least, scene.clearance(line[k - 1] + (line[k] - line[k - 1]) * (double(i) / parts)));
  return least;
}

/// Rounds the corners of a line; the less, the nearer that would bring it to the walls.
std::vector<Vector2d> rounded(const Scene& scene, const std::vector<Vector2d>& raw, double step)
{
  const std::vector<Vector2d> line = resample(raw, step);
  const double wanted = kRoundedClearance * narrowest(scene, line, step);
  for (int half = int(0.5 * kSmoothing / step); half > 0; half /= 2)
  {
    std::vector<Vector2d> smoothed = resample(smooth(smooth(line, half), half / 2), step);
    if (narrowest(scene, smoothed, step) > wanted)
      return smoothed;
  }
  return line;
}
}  // namespace

double Route::interpolate(const std::vector<double>& values, double s) const
{
  const double u = std::clamp(s / step, 0.0, double(values.size() - 1));
  const std::size_t k = std::min(std::size_t(u), values.size() - 2);
  return values[k] + (u - k) * (values[k + 1] - values[k]);
}

Vector2d Route::position(double s) const
{
  const double u = std::clamp(s / step, 0.0, double(points.size() - 1));
  const std::size_t k = std::min(std::size_t(u), points.size() - 2);
  return points[k] + (u - k) * (points[k + 1] - points[k]);
}

Vector2d Route::tangent(double s) const
{
  const double u = std::clamp(s / step, 0.0, double(points.size() - 1));
  const std::size_t k = std::min(std::size_t(u), points.size() - 2);
  return tangents[k] + (u - k) * (tangents[k + 1] - tangents[k]);
}

double Route::project(const Vector2d& x, double s, double reach) const
{
  const int last = int(points.size()) - 1;
  const int from = std::clamp(int((s - reach) / step), 0, last), to = std::clamp(int((s + reach) / step), 0, last);
  int best = from;
  for (int k = from; k <= to; ++k)
    if ((points[k] - x).squaredNorm() < (points[best] - x).squaredNorm())
      best = k;
  return best * step;
}

Route planRoute(const Scene& scene, double preferred_clearance)
{
  Route route;
  route.points = scene.path.empty() ? rounded(scene, findLine(scene, preferred_clearance), route.step)
                                    : resample(scene.path, route.step);
  const int last = int(route.points.size()) - 1;
  if (last < 10)
    throw PictureError("scene " + scene.name + ": start and goal are nearer than 10 mm: expected a way to go");
  if (narrowest(scene, route.points, route.step) <= 0.0)
    throw PictureError("scene " + scene.name + ": the way from the start to the goal is too narrow to plan for an " +
                       "object of radius " + std::to_string(scene.object_radius) + " m: expected a wider passage");
  for (int k = 0; k <= last; ++k)
  {
    const Vector2d ahead = route.points[std::min(k + 3, last)], behind = route.points[std::max(k - 3, 0)];
    route.tangents.push_back((ahead - behind).normalized());
    route.clearance.push_back(scene.clearance(route.points[k]));
  }
  for (int k = 0; k <= last; ++k)
  {
    const int ahead = std::min(k + 4, last), behind = std::max(k - 4, 0);
    const Vector2d a = route.tangents[behind], b = route.tangents[ahead];
    route.curvature.push_back(std::atan2(a(0) * b(1) - a(1) * b(0), a.dot(b)) / (route.step * (ahead - behind)));
  }
  return route;
}

Pace::Pace(const Route& route, double duration) : step_(route.step), arrivals_(route.points.size(), 0.0)
{
  if (!(duration > 0.0))
    throw std::invalid_argument("pace = " + std::to_string(duration) + " s: expected more than 0");
  const std::size_t n = arrivals_.size();
  for (std::size_t k = 1; k < n; ++k)
  {
    const double bend = std::max(std::abs(route.curvature[k]), kStraight);
    const double from_end = step_ * double(std::min(k, n - k));
    arrivals_[k] = arrivals_[k - 1] + std::cbrt(bend) * std::max(1.0, std::sqrt(kRunUp / from_end));
  }
  const double scale = duration / arrivals_.back();
  for (double& time : arrivals_)
    time *= scale;
}

double Pace::at(double t) const
{
  const std::size_t last = arrivals_.size() - 1;
  if (t <= 0.0)
    return 0.0;
  if (t >= arrivals_[last])
    return step_ * double(last);
  const std::size_t next = std::size_t(std::upper_bound(arrivals_.begin(), arrivals_.end(), t) - arrivals_.begin());
  const double part = (t - arrivals_[next - 1]) / (arrivals_[next] - arrivals_[next - 1]);
  return step_ * (double(next - 1) + part);
}
}  // namespace phri_sim
