#include "phri_learning/hmm_chain.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "phri_core/check.hpp"

namespace phri_learning
{
namespace
{
constexpr double kLeastTransition = 1e-6;

template <typename T>
void requireEqual(const std::string& name, T first, T second)
{
  if (first != second)
    throw std::invalid_argument("models of " + name + " " + std::to_string(first) + " and " + std::to_string(second) +
                                ", expected equal ones");
}

Eigen::MatrixXd stacked(const Eigen::MatrixXd& above, const Eigen::MatrixXd& below)
{
  Eigen::MatrixXd result(above.rows() + below.rows(), above.cols());
  result << above, below;
  return result;
}

/// Largest floor that floors neither model's covariances more than its own does, in units of `scale`.
double commonFloor(const TimeHmmParameters& a, const TimeHmmParameters& b, const Eigen::VectorXd& scale)
{
  constexpr double kLeastFloor = 1e-12;
  double floor = 1.0;
  for (const TimeHmmParameters* p : { &a, &b })
    floor = std::min(floor, p->covariance_floor * p->scale.cwiseQuotient(scale).array().square().minCoeff());
  return std::max(floor, kLeastFloor);
}
}  // namespace

TimeHmm concatenate(const TimeHmm& first, const TimeHmm& second)
{
  const TimeHmmParameters &a = first.parameters(), &b = second.parameters();
  requireEqual("dt", a.dt, b.dt);
  requireEqual("dimension", first.dimension(), second.dimension());
  requireEqual("components", first.components(), second.components());
  requireEqual("formulas", static_cast<int>(first.formulas()), static_cast<int>(second.formulas()));
  const Eigen::Index n = first.states(), m = second.states(), last = (n - 1) * first.components();

  TimeHmmParameters p;
  p.dt = a.dt;
  p.transition = Eigen::MatrixXd::Zero(n + m, n + m);
  p.transition.topLeftCorner(n, n) = a.transition;
  p.transition.bottomRightCorner(m, m) = b.transition;
  const double leave = std::clamp(1.0 / first.durations()(n - 1), kLeastTransition, 1.0 - kLeastTransition);
  p.transition(n - 1, n - 1) = 1.0 - leave;
  p.transition(n - 1, n) = leave;
  p.initial = stacked(a.initial, Eigen::VectorXd::Zero(m));
  p.weights = stacked(a.weights, b.weights);
  p.mean_s = stacked(a.mean_s, b.mean_s);
  p.ss = a.ss;
  p.ss.insert(p.ss.end(), b.ss.begin(), b.ss.end());
  p.mean_t = stacked(a.mean_t, (b.mean_t.array() + first.length()).matrix());
  p.tt = stacked(a.tt, b.tt);
  p.ts = stacked(a.ts, b.ts);
  const double end = a.weights.row(n - 1).dot(a.between_tt.segment(last, first.components()));
  p.between_tt = stacked(a.between_tt, (b.between_tt.array() + end).matrix());
  const double share = first.length() / (first.length() + second.length());
  const auto mean = [share](const auto& x, const auto& y) { return (share * x + (1.0 - share) * y).eval(); };
  p.scale = mean(a.scale, b.scale);
  p.memory = mean(a.memory, b.memory);
  p.repeat_variance = share * a.repeat_variance + (1.0 - share) * b.repeat_variance;
  p.pace_variance = share * a.pace_variance + (1.0 - share) * b.pace_variance;
  p.covariance_floor = commonFloor(a, b, p.scale);
  return TimeHmm(std::move(p), first.formulas());
}

WindowHmm windowHmm(const TimeHmm& chain, int center, int states)
{
  phri_core::requireRange("center", center, 0, chain.states() - 1, "");
  phri_core::requireRange("states", states, 1, 1e5, "");
  const Eigen::Index count = std::min(states, chain.states()), k = chain.components();
  const Eigen::Index from = std::clamp<Eigen::Index>(center - (count - 1) / 2, 0, chain.states() - count);
  TimeHmmParameters p = chain.parameters();
  p.transition = p.transition.block(from, from, count, count).eval();
  p.transition(count - 1, count - 1) = 1.0;
  p.initial = Eigen::VectorXd::Constant(count, 1.0 / static_cast<double>(count));
  p.weights = p.weights.middleRows(from, count).eval();
  p.mean_s = p.mean_s.middleRows(from * k, count * k).eval();
  p.ss = { p.ss.begin() + from * k, p.ss.begin() + (from + count) * k };
  p.mean_t = p.mean_t.segment(from * k, count * k).eval();
  p.tt = p.tt.segment(from * k, count * k).eval();
  p.ts = p.ts.middleRows(from * k, count * k).eval();
  p.between_tt = p.between_tt.segment(from * k, count * k).eval();
  return { TimeHmm(std::move(p), chain.formulas()), static_cast<int>(from) };
}
}  // namespace phri_learning
