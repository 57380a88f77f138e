#include "slider_scale.hpp"

#include <algorithm>
#include <cmath>

namespace phri_rviz
{
namespace
{
constexpr double kLinearSpan = 20;  // ratio of the ends up to which a linear slider can still set small values
constexpr double kWholeSpan = 1e6;  // ratio up to which a logarithmic slider spans the limits
constexpr double kWindow = 100;     // beyond that: so many times the default, and so many times less
constexpr double kReach = 10;       // limits of both signs: the slider goes to so many times the default

double roundToThreeDigits(double value)
{
  if (value == 0 || !std::isfinite(value))
    return value;
  // in two factors: one power of ten overflows for the smallest numbers
  const double exponent = std::floor(std::log10(std::abs(value)));
  const double mantissa = value / std::pow(10.0, exponent);
  return std::round(mantissa * 100) / 100 * std::pow(10.0, exponent);
}
}  // namespace

SliderScale::SliderScale(double minimum, double maximum, double standard)
  : minimum_(minimum), maximum_(maximum), low_(minimum), high_(maximum)
{
  standard = std::clamp(standard, minimum, maximum);
  if (minimum < 0)
  {
    const double reach = kReach * (standard == 0 ? 1.0 : std::abs(standard));
    if (maximum - minimum > 2 * kLinearSpan * reach)
    {
      low_ = std::max(minimum, standard - reach);
      high_ = std::min(maximum, standard + reach);
    }
    return;
  }
  const double typical = standard > 0 ? standard : 1.0;
  zero_ = minimum == 0;
  if (maximum <= kLinearSpan * (zero_ ? typical : minimum))
  {
    zero_ = false;
    return;
  }
  logarithmic_ = true;
  if (zero_ || maximum / minimum > kWholeSpan)
  {
    high_ = std::min(maximum, typical * kWindow);
    low_ = std::max(minimum, std::min(typical, high_) / kWindow);
  }
}

void SliderScale::cover(double value)
{
  value = std::clamp(value, minimum_, maximum_);
  if (zero_ && value == 0)
    return;
  low_ = std::min(low_, value);
  high_ = std::max(high_, value);
}

double SliderScale::value(int position) const
{
  if (position <= 0)
    return low();
  if (position >= kPositions)
    return high_;
  const int first = logarithmic_ && zero_ ? 1 : 0;
  const double share = double(position - first) / (kPositions - first);
  const double exact = logarithmic_ ? low_ * std::pow(high_ / low_, share) : low_ + share * (high_ - low_);
  return std::clamp(roundToThreeDigits(exact), low_, high_);
}

int SliderScale::position(double value) const
{
  if (!(value > low()))  // NaN as well
    return 0;
  if (value >= high_)
    return kPositions;
  const int first = logarithmic_ && zero_ ? 1 : 0;
  if (value <= low_)
    return first;
  const double share = logarithmic_ ? std::log(value / low_) / std::log(high_ / low_) : (value - low_) / (high_ - low_);
  return first + int(std::lround(share * (kPositions - first)));
}
}  // namespace phri_rviz
