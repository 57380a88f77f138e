#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "phri_core/mailbox.hpp"
#include "phri_sim/trial.hpp"
#include "stage_sample.hpp"

namespace phri_sim
{
/// One writer thread, one reader thread, neither waits; all memory is there from the start.
template <typename T>
class SpscRing
{
public:
  explicit SpscRing(std::size_t capacity) : slots_(capacity + 1) {}
  /// False, and nothing is stored, when the reader is too far behind.
  bool push(const T& value) noexcept
  {
    const std::size_t head = head_.load(std::memory_order_relaxed), next = (head + 1) % slots_.size();
    if (next == tail_.load(std::memory_order_acquire))
      return false;
    slots_[head] = value;
    head_.store(next, std::memory_order_release);
    return true;
  }
  bool pop(T& value) noexcept
  {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail == head_.load(std::memory_order_acquire))
      return false;
    value = slots_[tail];
    tail_.store((tail + 1) % slots_.size(), std::memory_order_release);
    return true;
  }

private:
  std::vector<T> slots_;
  std::atomic<std::size_t> head_{ 0 }, tail_{ 0 };
};

/// How late the ticks of a trial came. Written by the tick, read by anybody.
struct LatenessHistogram
{
  static constexpr std::array<double, 8> kEdges = { 50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 5e-3, 10e-3, 20e-3 };  ///< [s]
  std::array<std::atomic<std::uint64_t>, kEdges.size() + 1> counts{};  ///< bin i: up to kEdges[i]; last: later
  std::atomic<std::uint64_t> slipped{ 0 };  ///< ticks that came a whole period late: simulated time lost that much
  std::atomic<std::uint64_t> dropped{ 0 };  ///< records that nobody fetched in time
  std::atomic<double> worst{ 0.0 };         ///< [s]

  void add(double lateness) noexcept;
  std::string text() const;
};

/// Ticks a trial at its own rate in a thread of its own, by absolute deadlines on the monotonic clock. The thread does
/// nothing but tick: records leave through a preallocated ring, the state that the next plan starts from through a
/// mailbox. A tick that comes a period or more late is not made up for: the deadlines move.
class RealtimeLoop
{
public:
  /// The trial must not be touched from outside until `stop` has returned, but for its loop's adopt and requests.
  explicit RealtimeLoop(Trial& trial);
  ~RealtimeLoop();
  void stop();

  /// For one reader thread: the next record, in order, and what the stage looked like then.
  bool pop(phri_control::TickRecord& record, StageSample* sample = nullptr);
  /// For one planner thread: the newest record after which a plan was due, if there is a new one.
  const phri_control::TickRecord* newestDue() { return due_.take(); }
  bool running() const { return running_; }
  const LatenessHistogram& lateness() const { return lateness_; }
  /// What the system refused (locked memory, real-time priority); empty if nothing. Valid once the first tick ran.
  const char* refused() const { return refused_; }

private:
  struct Tick
  {
    phri_control::TickRecord record;
    StageSample sample;
  };
  void run() noexcept;

  Trial& trial_;
  StageSampler sampler_;
  SpscRing<Tick> ring_;
  Tick out_;  // the reader's
  phri_core::Mailbox<phri_control::TickRecord> due_;
  LatenessHistogram lateness_;
  std::atomic<bool> running_{ true }, stop_{ false };
  std::atomic<const char*> refused_{ "" };
  std::thread thread_;
};
}  // namespace phri_sim
