// Google Benchmark of the scenes of chapter 4 and of the backward pass alone, for scripts/bench. Beside Google's own
// options:
//   --write_case=FILE   write our results for the peer, and stop
// Names: <scene>/<quantity>. `solve` is risk-neutral, `ileqr` and `ikccr` are whole solves in two phases from zero
// controls (counter `steps`); `backward` and `risk_backward` are one pass at the risk-neutral solution,
// derivatives given (counter `stages`).
#include <benchmark/benchmark.h>

#include <fstream>
#include <iomanip>
#include <iostream>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>

#include "phri_control/iterative_solver.hpp"
#include "phri_control/risk_limits.hpp"
#include "scene_cases.hpp"

namespace
{
using namespace phri_control;
using phri_control_bench::SceneCase;

const Attitude kNeutral = CostCumulants{ Eigen::MatrixXd(2, 0) };

template <int N>
void wholeSolve(benchmark::State& state, const SceneCase<N>& scene, const Attitude& attitude)
{
  IterativeSolver<N, 2> solver(scene.problem, attitude);
  for (auto _ : state)
  {
    for (Eigen::Vector2d& u : solver.start())
      u.setZero();
    if (!solver.solve(scene.start))
      state.SkipWithError(solver.result().message().c_str());
  }
  state.counters["steps"] = solver.result().iterations;
}

template <int N, typename Solve>
void backwardPass(benchmark::State& state, const LinearQuadraticProblem<N, 2>& problem, const Solve& once)
{
  for (auto _ : state)
    if (!once())
      state.SkipWithError("no policy");
  state.counters["stages"] = static_cast<double>(problem.horizon());
}

/// `problem` has its own noise; the plain pass is measured without.
template <int N>
void registerPasses(const std::string& name, const LinearQuadraticProblem<N, 2>& problem, const RiskSensitive& attitude)
{
  const auto risky = std::make_shared<LinearQuadraticProblem<N, 2>>(problem);
  const auto plain = std::make_shared<LinearQuadraticProblem<N, 2>>(problem);
  plain->noise.clear();
  const auto plain_solution = std::make_shared<LqSolution<N, 2>>();
  const auto risk_solution = std::make_shared<RiskSolution<N, 2>>();
  benchmark::RegisterBenchmark((name + "/backward").c_str(), [plain, plain_solution](benchmark::State& state) {
    backwardPass(state, *plain, [&] { return bool(solve(*plain, *plain_solution)); });
  });
  benchmark::RegisterBenchmark((name + "/risk_backward").c_str(), [=](benchmark::State& state) {
    backwardPass(state, *risky, [&] { return bool(solve(*risky, attitude, *risk_solution)); });
  });
}

template <int N>
IterativeResult<N, 2> neutralSolution(const SceneCase<N>& scene)
{
  IterativeResult<N, 2> result = solveIterative(scene.problem, scene.start, kNeutral);
  if (!result)
    throw std::runtime_error("bench: " + scene.name + ": " + result.message());
  return result;
}

RiskSensitive half(const LinearQuadraticProblem<4, 2>& problem)
{
  return { { 0.5 * thetaMax(problem, 0), -1.0 } };
}

void registerAll()
{
  phri_control_bench::forEachScene([](const auto& scene) {
    const auto add = [&scene](const std::string& quantity, const Attitude& attitude) {
      benchmark::RegisterBenchmark((scene.name + "/" + quantity).c_str(), [=](benchmark::State& state) {
        wholeSolve(state, scene, attitude);
      })->Unit(benchmark::kMicrosecond);
    };
    add("solve", kNeutral);
    add("ileqr", scene.risk);
    add("ikccr", scene.cumulants);
    registerPasses(scene.name, approximate(scene.problem, neutralSolution(scene).nominal),
                   std::get<RiskSensitive>(scene.risk));
  });
  const auto problem = phri_control_bench::massDamper(200, 2);
  registerPasses("mass_damper", problem, half(problem));
}

/// "key": [every element, matrix by matrix, row-major]
template <typename Matrices>
void writeList(std::ostream& file, const std::string& key, const Matrices& matrices)
{
  file << '"' << key << "\": [";
  const char* separator = "";
  for (const auto& matrix : matrices)
    for (Eigen::Index i = 0; i < matrix.rows(); ++i)
      for (Eigen::Index j = 0; j < matrix.cols(); ++j)
      {
        file << separator << matrix(i, j);
        separator = ", ";
      }
  file << ']';
}

/// Risk-neutral results as JSON: cost, nominal, gains of all stages.
void writeCase(const std::string& path)
{
  LqSolution<4, 2> solution;
  if (!solve(phri_control_bench::massDamper(200, 0), solution))
    throw std::runtime_error("bench: mass_damper: no solution");
  std::ofstream file(path);
  file << std::setprecision(std::numeric_limits<double>::max_digits10) << '{';
  phri_control_bench::forEachScene([&file](const auto& scene) {
    const auto result = neutralSolution(scene);
    file << '"' << scene.name << "\": {\"cost\": " << result.nominal.cost << ", ";
    writeList(file, "states", result.nominal.states);
    file << ", ";
    writeList(file, "controls", result.nominal.controls);
    file << ", ";
    writeList(file, "gains", result.policy.gains);
    file << "},\n";
  });
  file << "\"mass_damper\": {";
  writeList(file, "gains", solution.gains);
  if (!(file << "}}\n"))
    throw std::runtime_error("bench: cannot write " + path);
}
}  // namespace

int main(int argc, char** argv)
{
  const std::string option = "--write_case=";
  try
  {
    if (argc == 2 && std::string(argv[1]).rfind(option, 0) == 0)
    {
      writeCase(argv[1] + option.size());
      return 0;
    }
    registerAll();
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv))
      return 64;
    benchmark::RunSpecifiedBenchmarks();
  }
  catch (const std::exception& error)
  {
    std::cerr << error.what() << '\n';
    return 70;
  }
}
