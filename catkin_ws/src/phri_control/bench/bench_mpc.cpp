// The model predictive form at n = 4, T = 200, risk-sensitive, warm-started: single plans in a closed loop with noise
// and a goal that circles, so that every plan has something to change. Prints one line of JSON:
//   backward            [us] mean CPU time of one risk-sensitive backward pass at the loop's last nominal
//   median, p999, max   [us] wall-clock of whole plans (roll-out, derivatives, backward passes, step, copy), less the
//                       median cost of the clock; CLOCK_MONOTONIC around each call
//   allocations         by all timed plans together, malloc and operator new counted
//   passes              backward passes per plan, mean
//   bench_mpc [PLANS]   how many plans are timed (default 5000)
#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "../test/iterative_fixtures.hpp"
#include "phri_control/mpc.hpp"
#include "phri_core/testing.hpp"

namespace
{
using namespace phri_control;
constexpr int kHorizon = 200, kWarmUp = 50;
constexpr double kTheta = 500.0;               // [1/J]; policies exist up to about 2500
constexpr double kNoise = 0.005;               // [m] per sample
constexpr double kRadius = 0.3, kTurn = 0.02;  // [m], [rad per plan] of the goal's circle

std::int64_t now(clockid_t clock)
{
  timespec t;
  clock_gettime(clock, &t);
  return std::int64_t(t.tv_sec) * 1000000000 + t.tv_nsec;
}

/// [us]
double percentile(std::vector<std::int64_t>& values, double share)
{
  const std::size_t rank = std::min(values.size() - 1, static_cast<std::size_t>(share * double(values.size())));
  std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(rank), values.end());
  return 1e-3 * double(values[rank]);
}

/// Mean CPU time [us] of one pass over `problem`.
double backwardTime(const LinearQuadraticProblem<4, 2>& problem, int passes)
{
  RiskSolution<4, 2> solution;
  const RiskSensitive attitude{ { kTheta } };
  std::int64_t start = 0;
  for (int i = -kWarmUp; i < passes; ++i)
  {
    if (i == 0)
      start = now(CLOCK_THREAD_CPUTIME_ID);
    if (!solve(problem, attitude, solution))
      throw std::runtime_error("bench: the attitude has no policy at the last nominal");
  }
  return 1e-3 * double(now(CLOCK_THREAD_CPUTIME_ID) - start) / passes;
}

std::string measure(int plans)
{
  const auto cost = std::make_shared<fixtures::PassBy>();
  OptimalControlProblem<4, 2> problem = fixtures::passBy(kNoise, cost);
  problem.horizon = kHorizon;
  ModelPredictiveController<4, 2> controller(problem, RiskSensitive{ { kTheta } });
  phri_core::Random rng(7);
  Eigen::Vector4d x = Eigen::Vector4d::Zero(), next;
  Eigen::Vector2d u;
  std::vector<std::int64_t> times, empty(20000);
  times.reserve(plans);
  long passes = 0, idle = 0, allocations = 0;
  for (int k = 0; k < kWarmUp + plans; ++k)
  {
    cost->goal << 1.0 + kRadius * std::cos(kTurn * k), kRadius * std::sin(kTurn * k);
    std::int64_t elapsed = 0;
    const long count = phri_core::testing::countAllocations([&] {
      const std::int64_t start = now(CLOCK_MONOTONIC);
      controller.plan(x);
      elapsed = now(CLOCK_MONOTONIC) - start;
    });
    const auto& result = controller.result();
    if (k >= kWarmUp)
    {
      if (!result.usable || result.fallback != Fallback::None)
        throw std::runtime_error("bench: plan " + std::to_string(k) + ": " + result.message());
      times.push_back(elapsed);
      allocations += count;
      passes += result.passes;
      idle += result.iterations == 0;
    }
    if (!controller.act(0, x, u))
      throw std::runtime_error("bench: no control after plan " + std::to_string(k));
    problem.dynamics->step(0, x, u, next);
    x = next;
    for (int i = 0; i < 2; ++i)
      x(i) += rng.normal(0.0, kNoise);
  }
  if (idle > 0)
    throw std::runtime_error("bench: " + std::to_string(idle) + " plans had nothing to change");
  for (std::int64_t& value : empty)
  {
    const std::int64_t start = now(CLOCK_MONOTONIC);
    value = now(CLOCK_MONOTONIC) - start;
  }
  if (!phri_core::testing::kCountsAllocations)
    throw std::runtime_error("bench: built with the address sanitizer, which hides allocations");
  const double clock = percentile(empty, 0.5);
  const double backward = backwardTime(approximate(problem, controller.result().nominal), plans);
  std::ostringstream out;
  out << "{\"plans\": " << plans << ", \"backward\": " << backward << ", \"median\": " << percentile(times, 0.5) - clock
      << ", \"p999\": " << percentile(times, 0.999) - clock
      << ", \"max\": " << 1e-3 * double(*std::max_element(times.begin(), times.end())) - clock
      << ", \"allocations\": " << allocations << ", \"passes\": " << double(passes) / plans << '}';
  return out.str();
}
}  // namespace

int main(int argc, char** argv)
{
  const int plans = argc > 1 ? std::atoi(argv[1]) : 5000;
  if (argc > 2 || plans < 1 || plans > 1000000)
  {
    std::cerr << "usage: bench_mpc [PLANS]   (1 to 1000000)\n";
    return 64;
  }
  try
  {
    std::cout << measure(plans) << '\n';
  }
  catch (const std::exception& error)
  {
    std::cerr << error.what() << '\n';
    return 70;
  }
}
