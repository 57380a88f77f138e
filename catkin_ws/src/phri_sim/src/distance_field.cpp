#include <algorithm>
#include <cmath>
#include <limits>

#include "phri_sim/scene.hpp"

namespace phri_sim
{
namespace
{
constexpr double kFar = 1e12;
constexpr std::uint16_t kNone = 65535;

/// Lower envelope of parabolas: d(q) = min_p (q - p)^2 + f(p), in place.
void transformLine(std::vector<double>& f, std::vector<double>& d, std::vector<int>& v, std::vector<double>& z, int n)
{
  int k = 0;
  v[0] = 0;
  z[0] = -std::numeric_limits<double>::infinity();
  z[1] = std::numeric_limits<double>::infinity();
  for (int q = 1; q < n; ++q)
  {
    double s = 0.0;
    for (;; --k)
    {
      const int p = v[k];
      s = ((f[q] + double(q) * q) - (f[p] + double(p) * p)) / (2.0 * (q - p));
      if (s > z[k])
        break;
    }
    v[++k] = q;
    z[k] = s;
    z[k + 1] = std::numeric_limits<double>::infinity();
  }
  k = 0;
  for (int q = 0; q < n; ++q)
  {
    while (z[k + 1] < q)
      ++k;
    const double offset = q - v[k];
    d[q] = offset * offset + f[v[k]];
  }
}

/// Distance [pixel] along the column to the nearest pixel of the other kind, kNone if the column has none; row by row,
/// as memory lies.
std::vector<std::uint16_t> alongColumns(const std::vector<char>& wall, int width, int height)
{
  std::vector<std::uint16_t> steps(wall.size(), kNone);
  for (const int way : { 1, -1 })
    for (int k = 1; k < height; ++k)
    {
      const std::size_t row = std::size_t(way > 0 ? k : height - 1 - k) * width;
      for (int i = 0; i < width; ++i)
      {
        const std::size_t at = row + i, before = at - std::size_t(way * width);
        if (wall[at] != wall[before])
          steps[at] = 1;
        else if (steps[before] != kNone)
          steps[at] = std::min<std::uint16_t>(steps[at], steps[before] + 1);
      }
    }
  return steps;
}
}  // namespace

DistanceField::DistanceField(const GrayImage& image, double resolution, const Eigen::Vector2d& origin, double occupied)
  : width_(image.width + 2),
    height_(image.height + 2),
    resolution_(resolution),
    origin_(origin - Eigen::Vector2d::Constant(resolution))
{
  // one pixel of wall around the picture: outside is wall
  std::vector<char> wall(std::size_t(width_) * height_, 1);
  for (int row = 0; row < image.height; ++row)
    for (int column = 0; column < image.width; ++column)
      wall[std::size_t(row + 1) * width_ + column + 1] =
          255 - image.pixels[std::size_t(image.height - 1 - row) * image.width + column] > occupied * 255.0;
  const std::vector<std::uint16_t> steps = alongColumns(wall, width_, height_);
  distance_.resize(wall.size());
  std::vector<double> f(width_), d(width_), z(width_ + 1);
  std::vector<int> v(width_);
  for (int row = 0; row < height_; ++row)
  {
    const std::size_t start = std::size_t(row) * width_;
    for (const char target : { 1, 0 })  // distances of free pixels to walls, then of walls to free pixels
    {
      for (int i = 0; i < width_; ++i)
        f[i] = wall[start + i] == target ? 0.0 : steps[start + i] == kNone ? kFar : std::pow(steps[start + i], 2);
      transformLine(f, d, v, z, width_);
      for (int i = 0; i < width_; ++i)
      {
        if (wall[start + i] == target)
          continue;
        // the surface lies half a pixel from the centres on both sides of it
        const double pixels = target ? std::sqrt(d[i]) - 0.5 : 0.5 - std::sqrt(d[i]);
        distance_[start + i] = static_cast<float>(std::clamp(pixels, -1e5, 1e5) * resolution);
      }
    }
  }
}

double DistanceField::cell(int column, int row) const noexcept
{
  column = std::clamp(column, 0, width_ - 1);
  row = std::clamp(row, 0, height_ - 1);
  return distance_[std::size_t(row) * width_ + column];
}

double DistanceField::distance(const Eigen::Vector2d& x) const noexcept
{
  const double u = (x(0) - origin_(0)) / resolution_ - 0.5, v = (x(1) - origin_(1)) / resolution_ - 0.5;
  const double column = std::floor(std::clamp(u, -2.0, width_ + 1.0)),
               row = std::floor(std::clamp(v, -2.0, height_ + 1.0));
  const double a = std::clamp(u - column, 0.0, 1.0), b = std::clamp(v - row, 0.0, 1.0);
  const int i = int(column), j = int(row);
  return (1 - b) * ((1 - a) * cell(i, j) + a * cell(i + 1, j)) +
         b * ((1 - a) * cell(i, j + 1) + a * cell(i + 1, j + 1));
}

Eigen::Vector2d DistanceField::gradient(const Eigen::Vector2d& x) const noexcept
{
  const Eigen::Vector2d ex(resolution_, 0.0), ey(0.0, resolution_);
  const Eigen::Vector2d slope(distance(x + ex) - distance(x - ex), distance(x + ey) - distance(x - ey));
  const double norm = slope.norm();
  return norm > 1e-12 ? Eigen::Vector2d(slope / norm) : Eigen::Vector2d::Zero();
}
}  // namespace phri_sim
