// Google Benchmark of the risk-sensitive backward pass beside the plain one, in one run: a mass-damper in two
// dimensions (n = 4, m = 2) under force noise, T = 50 to 500.
#include <benchmark/benchmark.h>

#include "phri_control/risk_limits.hpp"
#include "scene_cases.hpp"

namespace
{
using namespace phri_control;
using Problem = LinearQuadraticProblem<4, 2>;
using phri_control_bench::massDamper;

void plain(benchmark::State& state)
{
  const Problem problem = massDamper(state.range(0), 0, false);
  LqSolution<4, 2> solution;
  for (auto _ : state)
  {
    if (!solve(problem, solution))
      state.SkipWithError("no solution");
    benchmark::DoNotOptimize(solution.gains.data());
  }
}

void risk(benchmark::State& state, int sources, bool full)
{
  const Problem problem = massDamper(state.range(0), sources, full);
  RiskSensitive attitude;
  for (int s = 0; s < sources; ++s)
    attitude.theta.push_back(s % 2 ? -1.0 : 0.5 * thetaMax(problem, s));
  RiskSolution<4, 2> solution;
  for (auto _ : state)
  {
    if (!solve(problem, attitude, solution))
      state.SkipWithError("no policy");
    benchmark::DoNotOptimize(solution.gains.data());
  }
}

/// The bisection for a limit, and a breakdown with its fallback: what a plan may cost at worst.
void limit(benchmark::State& state)
{
  const Problem problem = massDamper(state.range(0), 1, false);
  for (auto _ : state)
    benchmark::DoNotOptimize(thetaMax(problem, 0));
}

void fallback(benchmark::State& state)
{
  const Problem problem = massDamper(state.range(0), 1, false);
  const RiskSensitive beyond{ { 2.0 * thetaMax(problem, 0) } };
  RiskSolution<4, 2> solution;
  for (auto _ : state)
    benchmark::DoNotOptimize(solveWithFallback(problem, beyond, solution));
}

void horizons(benchmark::internal::Benchmark* bench)
{
  bench->Arg(50)->Arg(200)->Arg(500)->Unit(benchmark::kMicrosecond);
}

BENCHMARK(plain)->Name("lq_plain")->Apply(horizons);
BENCHMARK_CAPTURE(risk, one, 1, false)->Name("risk_force_noise/1_source")->Apply(horizons);
BENCHMARK_CAPTURE(risk, two, 2, false)->Name("risk_force_noise/2_sources")->Apply(horizons);
BENCHMARK_CAPTURE(risk, three, 3, false)->Name("risk_force_noise/3_sources")->Apply(horizons);
BENCHMARK_CAPTURE(risk, full_one, 1, true)->Name("risk_full_noise/1_source")->Apply(horizons);
BENCHMARK_CAPTURE(risk, full_two, 2, true)->Name("risk_full_noise/2_sources")->Apply(horizons);
BENCHMARK(limit)->Name("theta_max")->Arg(200)->Unit(benchmark::kMicrosecond);
BENCHMARK(fallback)->Name("risk_fallback")->Arg(200)->Unit(benchmark::kMicrosecond);
}  // namespace

BENCHMARK_MAIN();
