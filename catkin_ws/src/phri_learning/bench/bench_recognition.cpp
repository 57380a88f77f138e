// Recognition of many primitives: one call of filter(sample) for all of them, 6-dimensional samples, window 30, which
// does not change the work. Per sample: time of one call.
#include <benchmark/benchmark.h>

#include <Eigen/Core>
#include <cmath>
#include <memory>
#include <vector>

#include "phri_core/random.hpp"
#include "phri_learning/hmm_training.hpp"
#include "phri_learning/primitive_recogniser.hpp"

namespace
{
using namespace phri_learning;
constexpr int kDimension = 6, kSamples = 60, kExamples = 3;

/// A smooth random movement with full covariances of its states.
std::vector<Eigen::MatrixXd> examples(std::uint64_t seed)
{
  phri_core::Random random(seed);
  Eigen::VectorXd frequency(kDimension), phase(kDimension);
  for (int j = 0; j < kDimension; ++j)
  {
    frequency(j) = random.uniform(2.0, 8.0);
    phase(j) = random.uniform(0.0, 6.28);
  }
  std::vector<Eigen::MatrixXd> all(kExamples, Eigen::MatrixXd(kSamples, kDimension));
  for (Eigen::MatrixXd& x : all)
    for (int t = 0; t < kSamples; ++t)
      for (int j = 0; j < kDimension; ++j)
        x(t, j) = std::sin(frequency(j) * t / kSamples + phase(j)) + 0.05 * random.normal();
  return all;
}

void recognise(benchmark::State& state)
{
  const int primitives = static_cast<int>(state.range(0));
  TrainingOptions o;
  o.states = static_cast<int>(state.range(1));
  o.dt = 0.05;
  std::vector<RecognisedModel> models;
  Eigen::MatrixXd movement;
  for (int i = 0; i < primitives; ++i)
  {
    const std::vector<Eigen::MatrixXd> x = examples(static_cast<std::uint64_t>(i + 1));
    const auto hmm = std::make_shared<const TimeHmm>(train(x, o).model);
    models.push_back({ hmm, typicalIncrement(*hmm, x, RecogniserOptions().leak) });
    if (i == 0)
      movement = x[0].transpose();
  }
  PrimitiveRecogniser recogniser(models);
  Eigen::Index t = 0;
  for (auto _ : state)
  {
    benchmark::DoNotOptimize(recogniser.filter(movement.col(t)).data());
    t = (t + 1) % movement.cols();
  }
}
BENCHMARK(recognise)
    ->ArgNames({ "primitives", "states" })
    ->Args({ 5, 10 })
    ->Args({ 5, 40 })
    ->Args({ 50, 10 })
    ->Args({ 50, 30 })
    ->Unit(benchmark::kMicrosecond);
}  // namespace

BENCHMARK_MAIN();
