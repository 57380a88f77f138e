#include "realtime_loop.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <time.h>

#include <cstdio>

#include "phri_sim/monotonic.hpp"

namespace phri_sim
{
namespace
{
constexpr std::size_t kRecords = 8192;  // 8 s that a disk may take to answer
constexpr int kPriority = 80;

void sleepUntil(std::int64_t ns) noexcept
{
  const timespec deadline{ ns / 1000000000, ns % 1000000000 };
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, nullptr) != 0)
  {
  }
}
}  // namespace

void LatenessHistogram::add(double lateness) noexcept
{
  std::size_t bin = 0;
  while (bin < kEdges.size() && lateness > kEdges[bin])
    ++bin;
  counts[bin].fetch_add(1, std::memory_order_relaxed);
  if (lateness > worst.load(std::memory_order_relaxed))
    worst.store(lateness, std::memory_order_relaxed);
}

std::string LatenessHistogram::text() const
{
  std::string out;
  char part[64];
  for (std::size_t bin = 0; bin < counts.size(); ++bin)
  {
    const bool last = bin == kEdges.size();
    std::snprintf(part, sizeof(part), "%s%g ms: %llu, ", last ? "> " : "<= ", 1e3 * kEdges[last ? bin - 1 : bin],
                  static_cast<unsigned long long>(counts[bin].load()));
    out += part;
  }
  std::snprintf(part, sizeof(part), "worst %.3f ms, slipped %llu, dropped %llu", 1e3 * worst.load(),
                static_cast<unsigned long long>(slipped.load()), static_cast<unsigned long long>(dropped.load()));
  return out + part;
}

RealtimeLoop::RealtimeLoop(Trial& trial) : trial_(trial), sampler_(trial.stage(), trial.experiment()), ring_(kRecords)
{
  thread_ = std::thread(&RealtimeLoop::run, this);
}

RealtimeLoop::~RealtimeLoop()
{
  stop();
}

void RealtimeLoop::stop()
{
  stop_ = true;
  if (thread_.joinable())
    thread_.join();
}

bool RealtimeLoop::pop(phri_control::TickRecord& record, StageSample* sample)
{
  if (!ring_.pop(out_))
    return false;
  record = out_.record;
  if (sample)
    *sample = out_.sample;
  return true;
}

void RealtimeLoop::run() noexcept
{
  const bool locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  const sched_param priority{ kPriority };
  const bool scheduled = pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority) == 0;
  refused_ = locked ? (scheduled ? "" : "SCHED_FIFO") : (scheduled ? "mlockall" : "mlockall and SCHED_FIFO");

  const std::int64_t period = std::llround(trial_.experiment().loop.dt * 1e9);
  Tick tick;
  std::int64_t deadline = monotonicNs() + period;
  while (!stop_ && !trial_.finished())
  {
    sleepUntil(deadline);
    const std::int64_t late = monotonicNs() - deadline;
    lateness_.add(late * 1e-9);
    if (late >= period)
    {
      lateness_.slipped.fetch_add(late / period, std::memory_order_relaxed);
      deadline += late;
    }
    deadline += period;
    sampler_.before(tick.sample);
    trial_.step(late * 1e-9);
    sampler_.after(tick.sample);
    tick.record = trial_.record();
    if (!ring_.push(tick))
      lateness_.dropped.fetch_add(1, std::memory_order_relaxed);
    if (trial_.planDue())
      due_.post(trial_.record());
  }
  running_ = false;
}
}  // namespace phri_sim
