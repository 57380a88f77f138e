#include "phri_core/random.hpp"

#include <cmath>

namespace phri_core
{
namespace
{
std::uint64_t splitMix(std::uint64_t& state)
{
  std::uint64_t z = (state += 0x9e3779b97f4a7c15ULL);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

std::uint64_t rotateLeft(std::uint64_t value, int bits)
{
  return (value << bits) | (value >> (64 - bits));
}
}  // namespace

Random::Random(std::uint64_t seed)
{
  for (std::uint64_t& word : state_)
    word = splitMix(seed);
}

Random Random::stream(std::uint64_t seed, std::string_view name, std::uint64_t index)
{
  // FNV-1a of the name, then mixed with seed and index so that neighbouring seeds give unrelated streams
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const char letter : name)
    hash = (hash ^ static_cast<unsigned char>(letter)) * 0x100000001b3ULL;
  std::uint64_t state = seed;
  state = splitMix(state) ^ hash;
  state = splitMix(state) ^ index;
  return Random(splitMix(state));
}

std::uint64_t Random::bits()
{
  const std::uint64_t result = rotateLeft(state_[0] + state_[3], 23) + state_[0];
  const std::uint64_t shifted = state_[1] << 17;
  state_[2] ^= state_[0];
  state_[3] ^= state_[1];
  state_[1] ^= state_[2];
  state_[0] ^= state_[3];
  state_[2] ^= shifted;
  state_[3] = rotateLeft(state_[3], 45);
  return result;
}

double Random::uniform()
{
  return static_cast<double>(bits() >> 11) * 0x1.0p-53;
}

double Random::normal()
{
  if (has_spare_)
  {
    has_spare_ = false;
    return spare_;
  }
  double u = 0.0, v = 0.0, square = 0.0;
  do
  {
    u = 2.0 * uniform() - 1.0;
    v = 2.0 * uniform() - 1.0;
    square = u * u + v * v;
  } while (square >= 1.0 || square == 0.0);
  const double factor = std::sqrt(-2.0 * std::log(square) / square);
  spare_ = v * factor;
  has_spare_ = true;
  return u * factor;
}

double Random::logNormal(double median, double variation)
{
  return median * std::exp(std::sqrt(std::log1p(variation * variation)) * normal());
}
}  // namespace phri_core
