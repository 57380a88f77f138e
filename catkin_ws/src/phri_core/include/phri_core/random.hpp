#pragma once
#include <array>
#include <cstdint>
#include <string_view>

namespace phri_core
{
/// The project's only source of random numbers, so that one seed gives the same numbers on every machine and in both
/// shells: xoshiro256++ (Blackman and Vigna 2019) seeded by splitmix64; normal variates by the Marsaglia polar method
/// (std::normal_distribution differs between standard libraries).
class Random
{
public:
  explicit Random(std::uint64_t seed);
  /// An independent stream for a purpose: the same (seed, name, index) gives the same stream.
  static Random stream(std::uint64_t seed, std::string_view name, std::uint64_t index = 0);

  std::uint64_t bits();
  /// Uniform on [0, 1).
  double uniform();
  /// Uniform on [low, high).
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  /// Standard normal.
  double normal();
  double normal(double mean, double deviation) { return mean + deviation * normal(); }
  /// Log-normal by its median and coefficient of variation.
  double logNormal(double median, double variation);

private:
  std::array<std::uint64_t, 4> state_;
  double spare_ = 0.0;
  bool has_spare_ = false;
};
}  // namespace phri_core
