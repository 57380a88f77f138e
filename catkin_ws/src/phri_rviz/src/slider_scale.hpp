#pragma once

namespace phri_rviz
{
/// Maps the positions 0 .. kPositions of a slider to the values of a parameter.
///
/// Limits of a parameter may lie 26 decades apart, where one pixel would be a factor of 1.3. So the slider spans the
/// limits when that is usable, else two decades to either side of the default (for limits of both signs: ten times the
/// default to either side); the text field beside it reaches every value between the limits, and `cover` widens the
/// slider to a value that was typed. A lower limit of 0 on a logarithmic slider is its leftmost position alone.
/// Values between the ends are rounded to three digits. Does not decrease with the position.
class SliderScale
{
public:
  static constexpr int kPositions = 1000;

  SliderScale() = default;
  /// Limits must be finite with minimum <= maximum; a default outside them is moved inside.
  SliderScale(double minimum, double maximum, double standard);

  /// Widens the span to a value between the limits.
  void cover(double value);
  double value(int position) const;
  /// The position nearest to a value; values outside the span get an end.
  int position(double value) const;

  double low() const { return zero_ ? 0.0 : low_; }
  double high() const { return high_; }
  bool logarithmic() const { return logarithmic_; }

private:
  double minimum_ = 0, maximum_ = 1;  // of the parameter
  double low_ = 0, high_ = 1;         // of the slider; logarithmic with zero_: of its positions 1 .. kPositions
  bool logarithmic_ = false, zero_ = false;
};
}  // namespace phri_rviz
