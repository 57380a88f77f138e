// Backward pass for cost cumulants against the plain one (lq_solver) on the same problem, in one run: n = 8, m = 2 (two
// point masses in the plane), noise on the velocities (p columns per source), per-stage time as the counter `stage`.
//   Plain/T            expected cost
//   Cumulants/T/S/K/p  S sources, K cumulants
#include <benchmark/benchmark.h>

#include "phri_control/cost_cumulants.hpp"
#include "phri_control/lq_solver.hpp"

namespace
{
using namespace phri_control;
constexpr int kStates = 8, kControls = 2;
constexpr double kDt = 0.01;

LinearQuadraticProblem<kStates, kControls> pointMasses(int horizon, int sources, int columns)
{
  LqStage<kStates, kControls> stage = LqStage<kStates, kControls>::zero();
  stage.A.setIdentity();
  stage.A.topRightCorner<4, 4>() = kDt * Eigen::Matrix4d::Identity();
  stage.A.bottomLeftCorner<4, 4>() = -kDt * Eigen::Matrix4d::Identity();  // a spring: nothing drifts away for T = 500
  stage.A.bottomRightCorner<4, 4>() *= 1.0 - kDt;
  stage.B.block<2, 2>(4, 0) = kDt * Eigen::Matrix2d::Identity();
  stage.d.setConstant(1e-3);
  stage.Q.setIdentity();
  stage.Q.topRightCorner<4, 4>().setConstant(0.1);
  stage.Q.bottomLeftCorner<4, 4>().setConstant(0.1);
  stage.q.setConstant(0.1);
  stage.R = 1e-2 * Eigen::Matrix2d::Identity();
  LinearQuadraticProblem<kStates, kControls> problem;
  problem.stages.assign(horizon, stage);
  problem.terminal = LqTerminal<kStates>::zero();
  problem.terminal.Q.setIdentity();
  for (int s = 0; s < sources; ++s)
  {
    Eigen::MatrixXd factor = Eigen::MatrixXd::Zero(kStates, columns);
    for (int column = 0; column < columns; ++column)
      factor(kStates - 1 - (column + s) % kStates, column) = 0.01;
    problem.noise.push_back(NoiseSource::fromFactor("noise", factor));
  }
  return problem;
}

void perStage(benchmark::State& state)
{
  state.counters["stage"] = benchmark::Counter(
      static_cast<double>(state.range(0)), benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void Plain(benchmark::State& state)
{
  const auto problem = pointMasses(state.range(0), 1, 4);
  LqSolution<kStates, kControls> solution;
  for (auto _ : state)
    if (!solve(problem, solution))
      state.SkipWithError("no policy");
  perStage(state);
}

void Cumulants(benchmark::State& state)
{
  const int sources = state.range(1), count = state.range(2);
  const auto problem = pointMasses(state.range(0), sources, state.range(3));
  const CostCumulants attitude{ Eigen::MatrixXd::Constant(sources, count - 1, 0.01) };
  CumulantSolution<kStates, kControls> solution;
  for (auto _ : state)
    if (!solve(problem, attitude, solution))
      state.SkipWithError("no policy");
  perStage(state);
}

BENCHMARK(Plain)->Arg(50)->Arg(500);
BENCHMARK(Cumulants)
    ->ArgNames({ "T", "S", "K", "p" })
    ->ArgsProduct({ { 50 }, { 1, 2, 3 }, { 1, 2, 4 }, { 2, 4, 8 } })
    ->Args({ 500, 1, 4, 4 })
    ->Args({ 500, 2, 4, 4 });
}  // namespace

BENCHMARK_MAIN();
