#include <algorithm>
#include <cmath>

#include "phri_sim/image.hpp"

namespace phri_sim
{
namespace
{
constexpr int kSmallestDot = 4;   // [pixel]
constexpr int kRimContrast = 20;  // of the blurred rim that JPEG makes
constexpr int kRim = 3;           // [pixel] how wide that rim may be

/// A connected region of one colour; columns and rows inclusive.
struct Region
{
  int pixels = 0, left = 0, right = 0, top = 0, bottom = 0;
  double sum_column = 0.0, sum_row = 0.0;
  std::uint32_t seed = 0;

  bool dot() const
  {
    const double side = std::max(right - left, bottom - top) + 1;
    return pixels >= kSmallestDot && 2.0 * pixels >= side * side;
  }
};

/// Visits the pixels connected to `seed` (4 neighbours) for which `take` holds; `take` must not hold twice.
template <typename Take>
void flood(std::uint32_t seed, int width, int height, Take&& take)
{
  if (!take(seed))
    return;
  std::vector<std::uint32_t> open{ seed };
  while (!open.empty())
  {
    const std::uint32_t at = open.back();
    open.pop_back();
    const int column = int(at % width), row = int(at / width);
    if (column > 0 && take(at - 1))
      open.push_back(at - 1);
    if (column + 1 < width && take(at + 1))
      open.push_back(at + 1);
    if (row > 0 && take(at - width))
      open.push_back(at - width);
    if (row + 1 < height && take(at + width))
      open.push_back(at + width);
  }
}
}  // namespace

Dot findDot(std::vector<std::uint8_t> contrast, int width, int height, const std::string& color,
            const std::string& meaning)
{
  Region best, second;
  std::vector<bool> seen(contrast.size());
  for (std::uint32_t seed = 0; seed < contrast.size(); ++seed)
  {
    if (seen[seed] || contrast[seed] < kDotContrast)
      continue;
    Region region;
    region.seed = seed;
    region.left = region.right = int(seed % width);
    region.top = region.bottom = int(seed / width);
    flood(seed, width, height, [&](std::uint32_t at) {
      if (seen[at] || contrast[at] < kDotContrast)
        return false;
      seen[at] = true;
      const int column = int(at % width), row = int(at / width);
      ++region.pixels;
      region.sum_column += column + 0.5;
      region.sum_row += row + 0.5;
      region.left = std::min(region.left, column);
      region.right = std::max(region.right, column);
      region.top = std::min(region.top, row);
      region.bottom = std::max(region.bottom, row);
      return true;
    });
    if (!region.dot())
      continue;
    if (region.pixels > best.pixels)
      std::swap(region, best);
    if (region.pixels > second.pixels)
      second = region;
  }

  Dot dot;
  if (best.pixels == 0)
    dot.fault = "has no " + color + " dot: expected one filled " + color + " dot " + meaning + " (" +
                std::to_string(kSmallestDot) + " pixels or more, " + color + " at least " +
                std::to_string(kDotContrast) + " of 255 above both other colours)";
  else if (2 * second.pixels > best.pixels)
    dot.fault = "has more than one " + color + " dot (" + std::to_string(best.pixels) + " and " +
                std::to_string(second.pixels) + " pixels): expected one " + meaning;
  if (!dot.fault.empty())
    return dot;

  dot.found = true;
  dot.center = Eigen::Vector2d(best.sum_column, best.sum_row) / best.pixels;
  // the dot's disc, letters in it included, and the rim that a lossy format has blurred
  dot.radius = std::sqrt(best.pixels / M_PI);
  std::fill(seen.begin(), seen.end(), false);
  const auto inReach = [&](int column, int row) {
    return column >= best.left - kRim && column <= best.right + kRim && row >= best.top - kRim &&
           row <= best.bottom + kRim;
  };
  flood(best.seed, width, height, [&](std::uint32_t at) {
    const int column = int(at % width), row = int(at / width);
    const bool disc = std::hypot(column + 0.5 - dot.center(0), row + 0.5 - dot.center(1)) <= dot.radius;
    if (seen[at] || (!disc && contrast[at] < kRimContrast) || !inReach(column, row))
      return false;
    seen[at] = true;
    dot.pixels.push_back(at);
    return true;
  });
  return dot;
}
}  // namespace phri_sim
