// Times single ticks of a real trial with a policy in force: the whole Trial::step (person, device, contact, loop) and
// InteractionLoop::tick alone on the same readings. Prints one line of JSON. Google Benchmark has no percentiles of
// single calls, hence a loop of its own: CLOCK_MONOTONIC before and after each call; the median cost of the clock
// itself is measured on empty intervals, subtracted, and printed.
//   bench_tick [TRIALS]   how many times the trial is run (default 1)
#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <vector>

#include "recorded_case.hpp"

namespace
{
using phri_sim_bench::RecordedCase;

std::int64_t now()
{
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return std::int64_t(t.tv_sec) * 1000000000 + t.tv_nsec;
}

double percentile(std::vector<std::int64_t>& values, double share)
{
  const std::size_t rank = std::min(values.size() - 1, static_cast<std::size_t>(share * double(values.size())));
  std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(rank), values.end());
  return double(values[rank]);
}

double clockCost()
{
  std::vector<std::int64_t> empty(20000);
  for (std::int64_t& value : empty)
  {
    const std::int64_t start = now();
    value = now() - start;
  }
  return percentile(empty, 0.5);
}

nlohmann::json summary(std::vector<std::int64_t>& values, double clock)
{
  double sum = 0.0;
  for (const std::int64_t value : values)
    sum += double(value);
  const double p50 = percentile(values, 0.5), p99 = percentile(values, 0.99), p999 = percentile(values, 0.999);
  return { { "median", p50 - clock },
           { "p99", p99 - clock },
           { "p999", p999 - clock },
           { "max", double(*std::max_element(values.begin(), values.end())) - clock },
           { "mean", sum / double(values.size()) - clock } };
}

/// Readings and policies of the trial, in the order in which the loop got them.
struct Readings
{
  std::vector<phri_core::Measurement> measurement;
  std::vector<std::int64_t> now_ns;
  std::vector<phri_control::TickRecord> record;
};

/// Runs the trial once, calls `after` with the time of each step, and returns what the loop read if asked to.
template <typename After>
void runTrial(const RecordedCase& recorded, Readings* readings, After&& after)
{
  const phri_sim::ModelSettings& settings = recorded.experiment->model;
  phri_sim::Trial trial(recorded.experiment, recorded.spec);
  if (readings)
    trial.tamper = [readings](phri_core::Measurement& measurement, std::int64_t now_ns) {
      readings->measurement.push_back(measurement);
      readings->now_ns.push_back(now_ns);
    };
  recorded.model->reset();
  while (!trial.finished())
  {
    const std::int64_t start = now();
    trial.step();
    const std::int64_t elapsed = now() - start;
    after(trial.record(), elapsed);
    if (readings)
      readings->record.push_back(trial.record());
    if (trial.planDue())
    {
      recorded.model->observe(trial.observation());
      trial.plan(recorded.model->predict(settings.horizon, settings.dt));
    }
  }
}

/// The loop alone on the same readings; throws if it does not do what it did within the trial.
std::vector<std::int64_t> replay(const RecordedCase& recorded, const Readings& readings)
{
  const phri_sim::Experiment& experiment = *recorded.experiment;
  phri_control::InteractionLoop loop(experiment.loop);
  loop.place(experiment.scene->start);
  loop.start();
  const auto controller = phri_control::makeAssistance(recorded.spec.controller, experiment.assistance);
  recorded.model->reset();
  std::vector<std::int64_t> times;
  times.reserve(readings.record.size());
  for (std::size_t k = 0; k < readings.record.size(); ++k)
  {
    const std::int64_t start = now();
    loop.tick(readings.measurement[k], readings.now_ns[k]);
    const std::int64_t elapsed = now() - start;
    if (loop.record().source >= 0)
      times.push_back(elapsed);
    if (loop.record().assistance_wrench != readings.record[k].assistance_wrench ||
        loop.record().velocity != readings.record[k].velocity)
      throw std::runtime_error("bench: tick " + std::to_string(k) + " of the loop alone differs from the trial's");
    if (k % std::size_t(experiment.replanTicks()) != 0)
      continue;
    recorded.model->observe(loop.observation());
    const auto prediction = recorded.model->predict(experiment.model.horizon, experiment.model.dt);
    if (!prediction || !phri_control::withinGate(loop.observation(), *prediction, experiment.model.gate))
      continue;
    if (auto policy = controller->plan(loop.observation(), *prediction))
      loop.adopt(std::move(*policy));
  }
  return times;
}
}  // namespace

int main(int argc, char** argv)
{
  const int repeats = argc > 1 ? std::atoi(argv[1]) : 1;
  if (argc > 2 || repeats < 1 || repeats > 1000)
  {
    std::cerr << "usage: bench_tick [TRIALS]   (1 to 1000)\n";
    return 64;
  }
  try
  {
    const RecordedCase recorded = phri_sim_bench::recordCase();
    Readings readings;
    runTrial(recorded, &readings, [](const auto&, std::int64_t) {});
    const double clock = clockCost();
    std::vector<std::int64_t> step, tick;
    for (int repeat = 0; repeat < repeats; ++repeat)
    {
      runTrial(recorded, nullptr, [&step](const phri_control::TickRecord& record, std::int64_t elapsed) {
        if (record.source >= 0)
          step.push_back(elapsed);
      });
      const std::vector<std::int64_t> alone = replay(recorded, readings);
      tick.insert(tick.end(), alone.begin(), alone.end());
    }
    if (step.empty() || tick.empty())
      throw std::runtime_error("bench: no policy was in force in any tick");
    const nlohmann::json out = {
      { "unit", "ns" },   { "ticks", step.size() },         { "ticks_of_trial", readings.record.size() },
      { "clock", clock }, { "step", summary(step, clock) }, { "tick", summary(tick, clock) }
    };
    std::cout << out << '\n';
  }
  catch (const std::exception& error)
  {
    std::cerr << error.what() << '\n';
    return 70;
  }
}
