// Google Benchmark of the time-HMM's inner loops, for scripts/bench. Beside Google's own options:
//   --write_case=FILE   write models, data and our results for the peer, and stop
// viterbi/S: the path through 30 samples in 6 dimensions. baum_welch/S: one iteration over 12 demonstrations of 500
// samples in 7 dimensions, full covariances: model from parameters, E-step, M-step, no prior.
#include <benchmark/benchmark.h>

#include <cmath>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <limits>
#include <string>
#include <vector>

#include "phri_core/random.hpp"
#include "phri_learning/hmm_expectation.hpp"
#include "phri_learning/hmm_training.hpp"

namespace
{
using phri_learning::TimeHmm;
using phri_learning::TimeHmmParameters;

constexpr int kWindow = 30, kWindows = 20;

/// Curves of many harmonics, each demonstration with its own pace, offset and noise.
std::vector<Eigen::MatrixXd> curves(int count, int samples, int d)
{
  phri_core::Random random = phri_core::Random::stream(7, "bench_hmm", static_cast<std::uint64_t>(d));
  std::vector<Eigen::MatrixXd> all;
  for (int e = 0; e < count; ++e)
  {
    const double wobble = 0.1 * random.normal();
    Eigen::VectorXd offset(d);
    for (int j = 0; j < d; ++j)
      offset(j) = 0.05 * random.normal();
    Eigen::MatrixXd x(samples, d);
    for (int t = 0; t < samples; ++t)
    {
      const double u = static_cast<double>(t) / samples, s = u + wobble * std::sin(2.0 * M_PI * u);
      for (int j = 0; j < d; ++j)
        x(t, j) = std::sin((3.0 + j) * s + j) + offset(j) + 0.05 * random.normal();
    }
    all.push_back(x);
  }
  return all;
}

phri_learning::TrainingOptions options(int states)
{
  phri_learning::TrainingOptions o;
  o.states = states;
  o.shrinkage = 0.0;
  o.max_iterations = 3;
  o.tolerance = 0.0;
  return o;
}

struct Case
{
  int states = 0;
  TimeHmm tracked, trained;
  std::vector<Eigen::MatrixXd> windows, demonstrations;
};

Case makeCase(int states)
{
  const std::vector<Eigen::MatrixXd> motions = curves(6, 500, 6), demonstrations = curves(12, 500, 7);
  Case c{
    states, train(motions, options(states)).model, train(demonstrations, options(states)).model, {}, demonstrations
  };
  for (int w = 0; w < kWindows; ++w)
    c.windows.push_back(motions[static_cast<std::size_t>(w % 6)].middleRows(w * 470 / kWindows, kWindow));
  return c;
}

std::vector<int> path(const Case& c, std::size_t window)
{
  return c.tracked.viterbi(c.windows[window], phri_learning::Start::kAnywhere);
}

double iterate(const Case& c, TimeHmmParameters* p)
{
  const phri_learning::Expectation sums = expectation(TimeHmm(*p), c.demonstrations);
  phri_learning::maximize(sums, {}, 0.0, p);
  return sums.log_likelihood;
}

void viterbi(benchmark::State& state, const Case& c)
{
  std::size_t next = 0;
  for (auto _ : state)
  {
    auto result = path(c, next);
    benchmark::DoNotOptimize(result.data());
    next = (next + 1) % c.windows.size();
  }
}

void baumWelch(benchmark::State& state, const Case& c)
{
  for (auto _ : state)
  {
    state.PauseTiming();
    TimeHmmParameters p = c.trained.parameters();
    state.ResumeTiming();
    benchmark::DoNotOptimize(iterate(c, &p));
  }
}

void write(std::ostream& file, const Eigen::MatrixXd& m)
{
  file << '[';
  for (Eigen::Index i = 0; i < m.rows(); ++i)
  {
    file << (i ? ", [" : "[");
    for (Eigen::Index j = 0; j < m.cols(); ++j)
      file << (j ? ", " : "") << m(i, j);
    file << ']';
  }
  file << ']';
}

template <typename Matrices>
void writeAll(std::ostream& file, const std::string& key, const Matrices& matrices)
{
  file << '"' << key << "\": [";
  for (std::size_t k = 0; k < matrices.size(); ++k)
  {
    file << (k ? ", " : "");
    write(file, matrices[k]);
  }
  file << ']';
}

void writeModel(std::ostream& file, const std::string& key, const TimeHmmParameters& p)
{
  file << '"' << key << "\": {\"transition\": ";
  write(file, p.transition);
  file << ", \"initial\": ";
  write(file, p.initial.transpose());
  file << ", \"mean_s\": ";
  write(file, p.mean_s);
  file << ", ";
  writeAll(file, "ss", p.ss);
  file << '}';
}

void writeCase(const std::vector<Case>& cases, const std::string& name)
{
  std::ofstream file(name);
  file << std::setprecision(std::numeric_limits<double>::max_digits10) << "{";
  writeAll(file, "demonstrations", cases.front().demonstrations);
  for (const Case& c : cases)
  {
    file << ",\n\"" << c.states << "\": {";
    writeModel(file, "tracked", c.tracked.parameters());
    file << ", ";
    writeAll(file, "windows", c.windows);
    file << ", \"paths\": [";
    for (std::size_t w = 0; w < c.windows.size(); ++w)
    {
      const std::vector<int> states = path(c, w);
      write(file << (w ? ", " : ""), Eigen::Map<const Eigen::RowVectorXi>(states.data(), kWindow).cast<double>());
    }
    file << "], ";
    TimeHmmParameters p = c.trained.parameters();
    writeModel(file, "before", p);
    file << ", \"log_likelihood\": " << iterate(c, &p) << ", ";
    writeModel(file, "after", p);
    file << '}';
  }
  file << "}\n";
  file.close();
  if (!file)
    throw std::runtime_error("cannot write " + name);
}
}  // namespace

int main(int argc, char** argv)
{
  const std::string option = "--write_case=";
  try
  {
    std::vector<Case> cases;
    for (const int states : { 10, 20, 40 })
      cases.push_back(makeCase(states));
    if (argc == 2 && std::string(argv[1]).rfind(option, 0) == 0)
    {
      writeCase(cases, argv[1] + option.size());
      return 0;
    }
    for (const Case& c : cases)
    {
      const std::string states = std::to_string(c.states);
      benchmark::RegisterBenchmark(("viterbi/" + states).c_str(), [&c](benchmark::State& s) {
        viterbi(s, c);
      })->Unit(benchmark::kMicrosecond);
      benchmark::RegisterBenchmark(("baum_welch/" + states).c_str(), [&c](benchmark::State& s) {
        baumWelch(s, c);
      })->Unit(benchmark::kMicrosecond);
    }
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
