#include "tick_thread.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>

#include <cerrno>
#include <cmath>

namespace phri_control
{
namespace
{
constexpr int kPriority = 80;

void sleepUntil(std::int64_t ns) noexcept
{
  const timespec deadline{ ns / 1000000000, ns % 1000000000 };
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, nullptr) == EINTR)
  {
  }
}
}  // namespace

TickThread::TickThread(RobotTick& tick, double period, std::int64_t start_ns)
  : tick_(tick), period_ns_(std::llround(period * 1e9)), start_ns_(start_ns)
{
  sem_init(&fresh_, 0, 0);
  thread_ = std::thread(&TickThread::run, this);
}

TickThread::~TickThread()
{
  stop();
  sem_destroy(&fresh_);
}

void TickThread::stop()
{
  stop_ = true;
  if (thread_.joinable())
    thread_.join();
}

const RobotOutput* TickThread::wait(double timeout)
{
  timespec until;
  clock_gettime(CLOCK_REALTIME, &until);  // the only one that sem_timedwait knows; a jump costs one wait
  const std::int64_t ns = until.tv_nsec + std::llround(timeout * 1e9);
  until.tv_sec += ns / 1000000000;
  until.tv_nsec = ns % 1000000000;
  if (sem_timedwait(&fresh_, &until) == 0)
    while (sem_trywait(&fresh_) == 0)
    {
    }
  return out_.take();
}

void TickThread::run() noexcept
{
  const bool locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  const sched_param priority{ kPriority };
  const bool scheduled = pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority) == 0;
  refused_ = locked ? (scheduled ? "" : "SCHED_FIFO") : (scheduled ? "mlockall" : "mlockall and SCHED_FIFO");

  std::int64_t deadline = monotonicNs() + period_ns_;
  while (!stop_)
  {
    sleepUntil(deadline);
    const std::int64_t now = monotonicNs(), lateness = now - deadline;
    if (lateness * 1e-9 > worst_)
      worst_ = lateness * 1e-9;
    if (lateness >= period_ns_)
    {
      ++late_;
      deadline = now;
    }
    deadline += period_ns_;
    out_.post(tick_.step(now - start_ns_, lateness * 1e-9));
    sem_post(&fresh_);
  }
}
}  // namespace phri_control
