// Does learning disturb control? A real-time trial of emerging assistance with the threads of the experiment node and
// its learner: ticks at 1 kHz by absolute deadlines (SCHED_FIFO if allowed), predictions and plans at 50 Hz, and a
// thread of low priority that, in every other second, does nothing but learn from segments of earlier trials. Prints
// one line of JSON: microseconds from a tick's deadline to its end, from the tick that a plan was due after to the
// plan's adoption, and of the planning alone, each with and without learning beside it.
//   bench_learning [SECONDS]   how long (default 60)
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "phri_core/mailbox.hpp"
#include "phri_learning/emerging_partner.hpp"
#include "phri_sim/monotonic.hpp"
#include "phri_sim/trial.hpp"

namespace
{
using phri_learning::CommittedSegment;
using phri_learning::LearnedPrimitives;

constexpr int kPriority = 80, kNice = 10;     // of the tick, of learning: as in the nodes
constexpr std::int64_t kPeriod = 1000000;     // [ns] of the tick
constexpr std::int64_t kSecond = 1000000000;  // [ns] without learning beside, then with it
constexpr int kLessons = 6;                   // trials whose segments are learned from
constexpr auto kLook = std::chrono::microseconds(200);

/// Times [us] without and with learning beside.
using Times = std::array<std::vector<double>, 2>;

struct Shared
{
  std::atomic<bool> stop{ false }, learning{ false };
  std::atomic<std::int64_t> learned_segments{ 0 };
  phri_core::Mailbox<std::pair<phri_core::Observation, std::int64_t>> due;
  phri_core::Mailbox<std::shared_ptr<const LearnedPrimitives>> learned;
};

double percentile(std::vector<double> values, double share)
{
  if (values.empty())
    return 0.0;
  const std::size_t rank = std::min(values.size() - 1, static_cast<std::size_t>(share * double(values.size())));
  std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(rank), values.end());
  return values[rank];
}

nlohmann::json summary(const Times& times)
{
  nlohmann::json out;
  for (int beside = 0; beside < 2; ++beside)
    out[beside ? "learning" : "alone"] = { { "count", times[beside].size() },
                                           { "median", percentile(times[beside], 0.5) },
                                           { "p99", percentile(times[beside], 0.99) },
                                           { "p999", percentile(times[beside], 0.999) },
                                           { "max", percentile(times[beside], 1.0) } };
  return out;
}

/// What the earlier trials of a block were cut into.
std::vector<CommittedSegment> lessons(const std::shared_ptr<const phri_sim::Experiment>& experiment,
                                      const phri_sim::Block& block)
{
  const auto partner = std::make_shared<phri_learning::EmergingPartner>(experiment->model.emergingOptions());
  std::vector<CommittedSegment> segments;
  for (int trial = 0; trial < kLessons; ++trial)
    phri_sim::runTrial(experiment, block.trials[trial], partner, [&] {
      for (CommittedSegment& segment : partner->takeSegments())
        segments.push_back(std::move(segment));
    });
  return segments;
}

/// Learns all segments from nothing, again and again, whenever it is its turn.
void learn(const phri_learning::EmergingOptions& options, const std::vector<CommittedSegment>& segments, Shared* shared)
{
  setpriority(PRIO_PROCESS, gettid(), kNice);
  while (!shared->stop)
  {
    phri_learning::PrimitiveLearner learner(options);
    for (const CommittedSegment& segment : segments)
    {
      while (!shared->learning && !shared->stop)
        std::this_thread::sleep_for(kLook);
      if (shared->stop)
        return;
      learner.add(segment);
      ++shared->learned_segments;
    }
    shared->learned.post(learner.snapshot());
  }
}

struct PlanTimes
{
  Times response, work;
};

void plan(phri_sim::Trial* trial, phri_learning::EmergingPartner* partner, const std::atomic<bool>& over,
          Shared* shared, PlanTimes* times)
{
  const phri_sim::ModelSettings& model = trial->experiment().model;
  while (!over)
  {
    std::this_thread::sleep_for(kLook);
    const auto* due = shared->due.take();
    if (!due)
      continue;
    const bool learning = shared->learning;
    const std::int64_t begin = phri_sim::monotonicNs();
    if (const auto* fresh = shared->learned.take())
      partner->adopt(*fresh);
    partner->observe(due->first);
    trial->plan(due->first, partner->predict(model.horizon, model.dt));
    const std::int64_t end = phri_sim::monotonicNs();
    if (learning != shared->learning)
      continue;
    times->work[learning].push_back(1e-3 * double(end - begin));
    times->response[learning].push_back(1e-3 * double(end - due->second));
  }
}

/// The 1 kHz thread. Returns what the system refused it.
std::string tick(phri_sim::Trial* trial, std::int64_t first, std::int64_t last, Shared* shared, Times* times)
{
  const bool locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  const sched_param priority{ kPriority };
  const bool scheduled = pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority) == 0;
  std::int64_t deadline = phri_sim::monotonicNs() + kPeriod;
  while (!trial->finished() && deadline < last)
  {
    const timespec at{ deadline / kSecond, deadline % kSecond };
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) != 0)
    {
    }
    const bool learning = (deadline - first) / kSecond % 2 == 1;
    shared->learning = learning;
    trial->step();
    const std::int64_t done = phri_sim::monotonicNs();
    (*times)[learning].push_back(1e-3 * double(done - deadline));
    if (trial->planDue())
      shared->due.post({ trial->observation(), done });
    deadline = std::max(deadline + kPeriod, done);
  }
  return locked ? (scheduled ? "" : "SCHED_FIFO") : (scheduled ? "mlockall" : "mlockall and SCHED_FIFO");
}

nlohmann::json measure(double seconds)
{
  const auto experiment = std::make_shared<const phri_sim::Experiment>(phri_sim::loadExperiment("emerging_assistance"));
  const phri_sim::Block block = phri_sim::schedule(*experiment, 1, kLessons + 1, experiment->seed).front();
  const phri_learning::EmergingOptions options = experiment->model.emergingOptions();
  const std::vector<CommittedSegment> segments = lessons(experiment, block);
  phri_learning::PrimitiveLearner known(options);
  for (const CommittedSegment& segment : segments)
    known.add(segment);

  Shared shared;
  Times ticks;
  PlanTimes plans;
  std::string refused;
  for (std::vector<double>& condition : ticks)
    condition.reserve(std::size_t(1000 * seconds) + 1000);
  std::thread beside(learn, options, std::cref(segments), &shared);
  const std::int64_t first = phri_sim::monotonicNs(), last = first + std::int64_t(1e9 * seconds);
  while (phri_sim::monotonicNs() < last)
  {
    phri_sim::Trial trial(experiment, block.trials.back());
    phri_learning::EmergingPartner partner(options);
    partner.adopt(known.snapshot());
    std::atomic<bool> over{ false };
    std::thread planner([&] { plan(&trial, &partner, over, &shared, &plans); });
    std::thread control([&] { refused = tick(&trial, first, last, &shared, &ticks); });
    control.join();
    over = true;
    planner.join();
  }
  shared.stop = true;
  beside.join();
  if (shared.learned_segments == 0)
    throw std::runtime_error("nothing was learned beside the trials");
  return { { "tick", summary(ticks) },
           { "response", summary(plans.response) },
           { "plan", summary(plans.work) },
           { "learned_segments", shared.learned_segments.load() },
           { "refused", refused } };
}
}  // namespace

int main(int argc, char** argv)
{
  const double seconds = argc > 1 ? std::atof(argv[1]) : 60.0;
  if (argc > 2 || !(seconds >= 3.0 && seconds <= 3600.0))
  {
    std::cerr << "usage: bench_learning [SECONDS]   (3 to 3600)\n";
    return 64;
  }
  try
  {
    std::cout << measure(seconds).dump() << '\n';
  }
  catch (const std::exception& error)
  {
    std::cerr << "bench_learning: " << error.what() << '\n';
    return 70;
  }
  return 0;
}
