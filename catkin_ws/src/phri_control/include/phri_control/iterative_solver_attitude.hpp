#pragma once
// Definitions of iterative_solver.hpp, which see: phase 2 and what stands in where it has no solution.

#include <algorithm>
#include <utility>

#include "phri_control/iterative_solver_impl.hpp"

namespace phri_control
{
template <int N, int M>
typename IterativeSolver<N, M>::Outcome IterativeSolver<N, M>::attitudePhase(double share)
{
  setShare(share);
  if (!evaluate(now_, false, 0.0))
    return Outcome::Breakdown;
  while (true)
  {
    if (now_.max_feedforward < options_.tolerance)
    {
      record(2, 0.0, 0.0, share);
      return Outcome::Converged;
    }
    if (exhausted())
      return Outcome::Exhausted;
    double step = 1.0;
    bool stepped = false;
    while (!(stepped = tryStep(step, false, 0.0)) && step > options_.min_step && !exhausted())
      step *= 0.5;
    ++result_.iterations;
    record(2, stepped ? step : 0.0, 0.0, share);
    if (!stepped)
      return exhausted() ? Outcome::Exhausted : Outcome::Stuck;
    std::swap(now_, next_);
  }
}

template <int N, int M>
void IterativeSolver<N, M>::setShare(double share)
{
  result_.share = share;
  detail::scaleAttitude(attitude_, share, scale_all_, used_);
}

template <int N, int M>
double IterativeSolver<N, M>::existingShare()
{
  const auto exists = [&](double share) {
    setShare(share);
    return evaluate(now_, false, 0.0);
  };
  if (!exists(0.0))
  {
    scale_all_ = true;
    if (!exists(0.0))
      return 0.0;
  }
  double low = 0.0, high = 1.0;
  for (int i = 0; i < detail::kBisections; ++i)
    (exists(0.5 * (low + high)) ? low : high) = 0.5 * (low + high);
  return low;
}

template <int N, int M>
double IterativeSolver<N, M>::follow(double share, double aim, double step, RiskStatus& end)
{
  const double finest = detail::kFinest * aim;
  result_.refused = 0.0;
  kept_ = now_;
  while (share < aim)
  {
    const double next = std::min(aim, share + step);
    const Outcome outcome = attitudePhase(next);
    if (outcome == Outcome::Converged)
    {
      share = next;
      kept_ = now_;
      continue;
    }
    result_.refused = next;
    end = now_.risk;
    now_ = kept_;
    step = 0.5 * (next - share);
    if (outcome == Outcome::Exhausted || step < finest)
      break;
  }
  if (share == aim)
    result_.refused = 0.0;
  return share;
}

template <int N, int M>
void IterativeSolver<N, M>::standBy(double share)
{
  result_.fallback = share > 0.0 ? Fallback::Reduced : Fallback::RiskNeutral;
  setShare(share);
  result_.converged = (share > 0.0 ? evaluate(now_, false, 0.0) : evaluate(now_, true, 0.0)) &&
                      now_.max_feedforward < options_.tolerance;
}

template <int N, int M>
typename IterativeSolver<N, M>::Outcome IterativeSolver<N, M>::withAttitude()
{
  if (!options_.skip_neutral)
    kept_ = now_;
  Outcome outcome = attitudePhase(1.0);
  if (outcome == Outcome::Stuck && !options_.skip_neutral)
  {
    scale_all_ = true;  // a path from the risk-neutral solution: all weights grow together
    std::swap(stuck_, now_);
    now_ = kept_;
    RiskStatus end;
    const double share = follow(0.0, 1.0, 0.25, end);
    if (share == 1.0)
      return Outcome::Converged;
    outcome = exhausted() ? Outcome::Exhausted : Outcome::Stuck;
    if (share > 0.0 && options_.reduce)
    {
      result_.risk = end;
      standBy(share);
      return outcome;
    }
    std::swap(stuck_, now_);
    setShare(1.0);
    result_.refused = 0.0;
    return outcome;
  }
  if (outcome != Outcome::Breakdown || now_.risk.kind == BreakdownKind::NotFinite)
    return outcome;
  result_.risk = now_.risk;
  double share = 0.0;
  for (int round = 0; options_.reduce && round < detail::kReductions; ++round)
  {
    const double candidate = detail::kReduction * existingShare();
    if (!(candidate > detail::kWorthwhile * share))
      break;
    RiskStatus end;
    const double reached = follow(share, candidate, candidate - share, end);
    if (!(reached > share))
      break;
    share = reached;
    if (share < candidate)
      break;
    if (attitudePhase(1.0) == Outcome::Converged)
      return Outcome::Converged;
    now_ = kept_;
  }
  standBy(share);
  return Outcome::Breakdown;
}

// the sizes that Python uses are compiled once, in the library
extern template class IterativeSolver<>;
}  // namespace phri_control
