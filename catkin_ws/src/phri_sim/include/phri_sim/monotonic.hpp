#pragma once
#include <time.h>

#include <cstdint>

namespace phri_sim
{
/// A clock that no one sets [ns]; called within the tick, so it may neither block nor allocate. Tests pass their own.
using MonotonicClock = std::int64_t (*)() noexcept;

/// CLOCK_MONOTONIC [ns]. (ros::Time stands still while the session's clock does, and watchdogs on it never fire.)
inline std::int64_t monotonicNs() noexcept
{
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1000000000LL + now.tv_nsec;
}
}  // namespace phri_sim
