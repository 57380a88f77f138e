#include <algorithm>
#include <cmath>

#include "phri_sim/scene.hpp"

namespace phri_sim
{
namespace
{
constexpr int kLevels = 1 << 14;  // half pixels above and below the radius that are told apart
}  // namespace

// Dijkstra's search for the way whose narrowest place is widest, with a bucket per half pixel of distance.
Passage widestPassage(const DistanceField& walls, const Eigen::Vector2d& from, const Eigen::Vector2d& to, double radius)
{
  const int width = walls.width(), height = walls.height();
  const double half = 0.5 * walls.resolution();
  const auto level = [&](std::uint32_t at) {  // 0 and above where the object fits
    const double over = (walls.cell(int(at % width), int(at / width)) - radius) / half;
    return int(std::ceil(std::clamp(over, double(-kLevels), double(kLevels)))) - 1;
  };
  // the freest of the four pixels around a point: the field between them is no larger
  const auto pixelAt = [&](const Eigen::Vector2d& x) {
    const Eigen::Vector2d u = (x - walls.origin()) / walls.resolution() - Eigen::Vector2d::Constant(0.5);
    const int i = std::clamp(int(std::floor(u(0))), 0, width - 2), j = std::clamp(int(std::floor(u(1))), 0, height - 2);
    int column = i, row = j;
    for (const auto& [a, b] : { std::pair(i + 1, j), { i, j + 1 }, { i + 1, j + 1 } })
      if (walls.cell(a, b) > walls.cell(column, row))
      {
        column = a;
        row = b;
      }
    return std::uint32_t(row) * std::uint32_t(width) + std::uint32_t(column);
  };
  const std::uint32_t start = pixelAt(from), goal = pixelAt(to);
  std::vector<bool> seen(std::size_t(width) * height);
  std::vector<std::vector<std::uint32_t>> open(2 * kLevels + 2);
  int now = level(start);
  const auto push = [&](std::uint32_t at) {
    if (seen[at] || walls.cell(int(at % width), int(at / width)) <= 0.0)
      return;
    seen[at] = true;
    open[std::size_t(std::min(level(at), now) + kLevels + 1)].push_back(at);
  };
  push(start);
  for (; now >= -kLevels - 1; --now)
  {
    std::vector<std::uint32_t>& bucket = open[std::size_t(now + kLevels + 1)];
    while (!bucket.empty())
    {
      const std::uint32_t at = bucket.back();
      bucket.pop_back();
      if (at == goal)
        return { 2.0 * (radius + (now + 0.5) * half), now >= 0 };
      // the field has a rim of wall, so that free pixels have four neighbours
      for (const std::uint32_t next : { at - 1, at + 1, at - std::uint32_t(width), at + std::uint32_t(width) })
        push(next);
    }
    std::vector<std::uint32_t>().swap(bucket);
  }
  return {};
}
}  // namespace phri_sim
