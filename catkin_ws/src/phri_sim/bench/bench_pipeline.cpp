// Google Benchmark of what runs 50 times a second, and of whole trials. Beside Google's own options:
//   --write_case=FILE   write what is measured for the peers, and stop
#include <benchmark/benchmark.h>

#include <iostream>
#include <string>

#include "recorded_case.hpp"

namespace
{
using phri_sim_bench::RecordedCase;

const RecordedCase& recorded()
{
  static const RecordedCase value = phri_sim_bench::recordCase();
  return value;
}

void plan(benchmark::State& state, const std::string& controller, bool gains_kept)
{
  const auto assistance = phri_control::makeAssistance(controller, recorded().experiment->assistance);
  phri_core::Observation now = recorded().now(), later = now;
  later.t += recorded().experiment->assistance.dt;  // one stage less is left: the gains are computed anew
  assistance->plan(now, recorded().prediction);
  for (auto _ : state)
  {
    std::swap(now, later);
    auto policy = assistance->plan(gains_kept ? recorded().now() : now, recorded().prediction);
    if (!policy)
      state.SkipWithError("no policy");
    benchmark::DoNotOptimize(policy);
  }
}

void lqSolve(benchmark::State& state)
{
  phri_control::LqSolution<4, 2> solution;
  for (auto _ : state)
  {
    if (!phri_control::solve(recorded().mahalanobis, solution))
      state.SkipWithError("no solution");
    benchmark::DoNotOptimize(solution.gains.data());
  }
}

/// One observation and one prediction at 50 Hz, with a full window, along the recorded trial.
void prediction(benchmark::State& state)
{
  phri_learning::TimeHmmModel& model = *recorded().model;
  const phri_sim::ModelSettings& settings = recorded().experiment->model;
  std::size_t next = 0;
  for (auto _ : state)
  {
    model.observe(recorded().observations[next]);
    auto result = model.predict(settings.horizon, settings.dt);
    benchmark::DoNotOptimize(result);
    next = (next + 1) % recorded().observations.size();
  }
}

void viterbi(benchmark::State& state)
{
  const std::vector<Eigen::MatrixXd> windows = recorded().windows();
  std::size_t next = 0;
  for (auto _ : state)
  {
    auto path = recorded().hmm().viterbi(windows[next], phri_learning::Start::kAnywhere);
    benchmark::DoNotOptimize(path.data());
    next = (next + 1) % windows.size();
  }
}

/// All trials of one person under `mahalanobis`, as a study runs them: route, person, ticks, predictions, plans,
/// learning between the trials.
void trials(benchmark::State& state)
{
  phri_sim::Block block{ 0, "mahalanobis", recorded().spec.study_seed, {} };
  const int count = recorded().experiment->trials;
  for (int k = 1; k <= count; ++k)
    block.trials.push_back(phri_sim::trialSpec(0, block.controller, k, count, k - 1, block.seed));
  double simulated = 0.0;
  for (auto _ : state)
  {
    simulated = 0.0;
    for (const phri_sim::TrialLog& log : phri_sim::runBlock(recorded().experiment, block))
      simulated += static_cast<double>(log.ticks.size()) * recorded().experiment->loop.dt;
  }
  state.counters["simulated_s"] = simulated;
}

BENCHMARK_CAPTURE(plan, mahalanobis, "mahalanobis", false)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(plan, lqr, "lqr", false)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(plan, lqr_gains_kept, "lqr", true)->Unit(benchmark::kMicrosecond);
BENCHMARK(lqSolve)->Name("lq_solve")->Unit(benchmark::kMicrosecond);
BENCHMARK(prediction)->Unit(benchmark::kMicrosecond);
BENCHMARK(viterbi)->Unit(benchmark::kMicrosecond);
BENCHMARK(trials)->Unit(benchmark::kMillisecond);
}  // namespace

int main(int argc, char** argv)
{
  const std::string option = "--write_case=";
  try
  {
    if (argc == 2 && std::string(argv[1]).rfind(option, 0) == 0)
    {
      phri_sim_bench::writeCase(recorded(), argv[1] + option.size());
      return 0;
    }
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv))
      return 64;
    recorded();
    benchmark::RunSpecifiedBenchmarks();
  }
  catch (const std::exception& error)
  {
    std::cerr << error.what() << '\n';
    return 70;
  }
}
