#pragma once
/// Shared by the tests of this package: synthetic demonstrations and a model small enough to enumerate.

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "phri_core/random.hpp"
#include "phri_learning/time_hmm.hpp"

namespace phri_learning::testing
{
constexpr double kDt = 0.02;  // [s]

/// A movement along a curve, (T, 4) = position [m] and velocity [m/s], about T = `samples` long. Every demonstration
/// has its own pace and its own slowly varying offset of `deviation` [m].
inline Eigen::MatrixXd movement(phri_core::Random* random, int samples = 200, double deviation = 0.004)
{
  const int length = static_cast<int>(std::lround(samples * std::exp(0.1 * random->normal())));
  const double keep = std::exp(-kDt / 0.5), wobble = 0.15 * random->normal(), phase = 6.28 * random->uniform();
  Eigen::Vector2d offset(deviation * random->normal(), deviation * random->normal()), smooth = offset;
  Eigen::MatrixXd x(length, 4);
  for (int t = 0; t < length; ++t)
  {
    const double u = static_cast<double>(t) / (length - 1);
    const double s = u + wobble * (std::sin(6.28 * u + phase) - std::sin(phase)) / 6.28;
    const Eigen::Vector2d noise(random->normal(), random->normal());
    offset = keep * offset + deviation * std::sqrt(1.0 - keep * keep) * noise;
    smooth += 0.2 * (offset - smooth);
    x.row(t).head(2) << 0.13 * std::cos(3.0 * s) + smooth(0), 0.1 * std::sin(5.0 * s) + smooth(1);
  }
  for (int t = 0; t < length; ++t)
  {
    const int before = std::max(t - 1, 0), after = std::min(t + 1, length - 1);
    x.row(t).tail(2) = (x.row(after).head(2) - x.row(before).head(2)) / (kDt * (after - before));
  }
  return x;
}

inline std::vector<Eigen::MatrixXd> movements(std::uint64_t seed, int count, int samples = 200)
{
  phri_core::Random random(seed);
  std::vector<Eigen::MatrixXd> all;
  for (int e = 0; e < count; ++e)
    all.push_back(movement(&random, samples));
  return all;
}

/// Random left-to-right model with `states` states and `components` components in `d` dimensions.
inline TimeHmmParameters randomModel(std::uint64_t seed, int states, int components, int d)
{
  phri_core::Random random(seed);
  const Eigen::Index count = states * components;
  TimeHmmParameters p;
  p.dt = kDt;
  p.transition = Eigen::MatrixXd::Zero(states, states);
  p.transition(states - 1, states - 1) = 1.0;
  for (int i = 0; i + 1 < states; ++i)
  {
    p.transition(i, i) = random.uniform(0.2, 0.8);
    p.transition(i, i + 1) = 1.0 - p.transition(i, i);
  }
  p.initial = Eigen::VectorXd::Zero(states);
  p.initial(0) = 0.7;
  p.initial(states - 1) += 0.3;
  p.weights.resize(states, components);
  for (int i = 0; i < states; ++i)
    for (int k = 0; k < components; ++k)
      p.weights(i, k) = random.uniform(0.5, 1.5);
  for (int i = 0; i < states; ++i)
    p.weights.row(i) /= p.weights.row(i).sum();
  p.mean_s.resize(count, d);
  p.ts.resize(count, d);
  p.mean_t.resize(count);
  p.tt.resize(count);
  p.between_tt = Eigen::VectorXd::Zero(count);
  for (Eigen::Index c = 0; c < count; ++c)
  {
    Eigen::MatrixXd factor(d + 1, d + 1);
    for (Eigen::Index i = 0; i <= d; ++i)
      for (Eigen::Index j = 0; j <= d; ++j)
        factor(i, j) = random.normal();
    const Eigen::MatrixXd joint = factor * factor.transpose() + 0.1 * Eigen::MatrixXd::Identity(d + 1, d + 1);
    p.ss.push_back(joint.topLeftCorner(d, d));
    const double unit = 0.04;  // [s] per unit of the joint's last row
    p.tt(c) = unit * unit * joint(d, d);
    p.ts.row(c) = unit * joint.row(d).head(d);
    p.mean_t(c) = 0.1 * (static_cast<double>(c) + 0.5);
    for (Eigen::Index j = 0; j < d; ++j)
      p.mean_s(c, j) = static_cast<double>(c) + random.normal();
  }
  p.scale = Eigen::VectorXd::Ones(d);
  p.memory = Eigen::VectorXd::Constant(d, 0.5);
  p.covariance_floor = 1e-9;
  return p;
}

inline Eigen::MatrixXd randomSamples(std::uint64_t seed, int samples, int d, double scale = 2.0)
{
  phri_core::Random random(seed);
  Eigen::MatrixXd x(samples, d);
  for (int t = 0; t < samples; ++t)
    for (int j = 0; j < d; ++j)
      x(t, j) = scale * random.normal() + static_cast<double>(t);
  return x;
}
}  // namespace phri_learning::testing
