#pragma once
#include <semaphore.h>
#include <time.h>

#include <atomic>
#include <thread>

#include "robot_tick.hpp"

namespace phri_control
{
/// CLOCK_MONOTONIC [ns].
inline std::int64_t monotonicNs() noexcept
{
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1000000000LL + now.tv_nsec;
}

/// Steps a RobotTick at its own rate in a thread of its own, by absolute deadlines on the monotonic clock. The thread
/// does nothing else: what a cycle gives out leaves through a mailbox, and a semaphore wakes who reads it. A cycle that
/// comes a period or more late is not made up for: the deadlines move.
class TickThread
{
public:
  /// `period` [s]. Times are counted from `start_ns`. But for posts and the loop's requests the tick must not be
  /// touched from outside until `stop` has returned.
  TickThread(RobotTick& tick, double period, std::int64_t start_ns);
  ~TickThread();
  void stop();

  /// For one reader thread: the newest output, after waiting for one; nullptr after `timeout` [s].
  const RobotOutput* wait(double timeout);
  /// [s] the latest cycle so far.
  double worstLateness() const { return worst_; }
  std::uint64_t lateCycles() const { return late_; }  ///< a whole period or more
  /// What the system refused (locked memory, real-time priority); empty if nothing.
  const char* refused() const { return refused_; }

private:
  void run() noexcept;

  RobotTick& tick_;
  std::int64_t period_ns_, start_ns_;
  phri_core::Mailbox<RobotOutput> out_;
  sem_t fresh_;
  std::atomic<double> worst_{ 0.0 };
  std::atomic<std::uint64_t> late_{ 0 };
  std::atomic<const char*> refused_{ "" };
  std::atomic<bool> stop_{ false };
  std::thread thread_;
};
}  // namespace phri_control
