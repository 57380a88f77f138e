#pragma once
/// Shared by the tests of the emerging partner: a flower, r = a (1 + b cos 5 phi), drawn over and over.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "phri_core/interaction.hpp"
#include "phri_core/random.hpp"
#include "phri_learning/emerging_partner.hpp"

namespace phri_learning::testing
{
constexpr double kSampling = 0.05;  // [s]
constexpr double kPi = 3.14159265358979323846;

struct Drawing
{
  Eigen::MatrixXd samples;      // (T, 6) [x; xdot; u_h]
  std::vector<int> repetition;  // of each sample
};

/// Path speed 0.05 m/s (6 % noise with a memory of 2 s), radius with `deviation` noise (memory 1 s). The force is what
/// an object of 40 kg and 90 Ns/m needs. `turn` [rad] rotates the flower, `petals` gives it another shape.
inline Drawing flower(std::uint64_t seed, int repetitions, double deviation = 0.015, double turn = 0.0, int petals = 5)
{
  constexpr double kRadius = 0.06, kDepth = 0.5, kSpeed = 0.05, kMass = 40.0, kDamping = 90.0, kPaceNoise = 0.06;
  const double hold_pace = std::exp(-kSampling / 2.0), hold_size = std::exp(-kSampling / 1.0);
  phri_core::Random random(seed);
  double pace = 0.0, size = 0.0, smooth = 0.0, phi = 0.0;
  std::vector<Eigen::Vector2d> points;
  Drawing drawing;
  while (phi < 2.0 * kPi * repetitions)
  {
    pace = hold_pace * pace + kPaceNoise * std::sqrt(1.0 - hold_pace * hold_pace) * random.normal();
    size = hold_size * size + deviation * std::sqrt(1.0 - hold_size * hold_size) * random.normal();
    smooth += 0.15 * (size - smooth);
    const double r = kRadius * (1.0 + kDepth * std::cos(petals * phi)) * (1.0 + smooth);
    const double slope = kRadius * kDepth * petals * std::sin(petals * phi);
    points.emplace_back(r * std::cos(phi + turn), r * std::sin(phi + turn));
    drawing.repetition.push_back(static_cast<int>(phi / (2.0 * kPi)));
    phi += kSpeed * (1.0 + pace) / std::hypot(r, slope) * kSampling;
  }
  const Eigen::Index count = static_cast<Eigen::Index>(points.size());
  drawing.samples.resize(count, 6);
  for (Eigen::Index t = 0; t < count; ++t)
    drawing.samples.row(t).head(2) = points[static_cast<std::size_t>(t)].transpose();
  for (const Eigen::Index from : { 0, 2 })  // central differences: of positions, then of velocities
    for (Eigen::Index t = 0; t < count; ++t)
    {
      const Eigen::Index before = std::max<Eigen::Index>(t - 1, 0), after = std::min(t + 1, count - 1);
      drawing.samples.row(t).segment(from + 2, 2) =
          (drawing.samples.row(after).segment(from, 2) - drawing.samples.row(before).segment(from, 2)) /
          (kSampling * static_cast<double>(after - before));
    }
  drawing.samples.rightCols(2) = kMass * drawing.samples.rightCols(2) + kDamping * drawing.samples.middleCols(2, 2);
  return drawing;
}

inline phri_core::Observation observation(double t, const Eigen::Ref<const Eigen::RowVectorXd>& sample)
{
  phri_core::Observation o;
  o.t = t;
  o.state = sample.head(4).transpose();
  o.human_wrench = sample.tail(2).transpose();
  o.environment_wrench = Eigen::VectorXd::Zero(2);
  return o;
}
constexpr int kAhead = 6;  // samples in the 0.3 s of a prediction
constexpr double kHorizon = 0.3, kStep = 0.02;

inline EmergingOptions options(Reference reference = Reference::kPath)
{
  EmergingOptions o;
  o.reference = reference;
  return o;
}

/// A partner and a learner in lockstep.
struct Taught
{
  explicit Taught(const EmergingOptions& o) : partner(o), learner(o) {}
  std::optional<phri_core::Prediction> see(double t, const Eigen::Ref<const Eigen::RowVectorXd>& sample)
  {
    partner.observe(observation(t, sample));
    const auto prediction = partner.predict(kHorizon, kStep);
    segments += learn(&partner, &learner);
    return prediction;
  }
  EmergingPartner partner;
  PrimitiveLearner learner;
  int segments = 0;
};

}  // namespace phri_learning::testing
