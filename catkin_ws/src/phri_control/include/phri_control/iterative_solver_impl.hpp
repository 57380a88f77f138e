#pragma once
// Definitions of iterative_solver.hpp, which see.

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

#include "phri_control/iterative_solver.hpp"

namespace phri_control
{
namespace detail
{
/// Throws std::invalid_argument unless `attitude` has one finite weight per source and element.
void requireAttitude(const Attitude& attitude, std::size_t sources);
void requireOptions(const IterativeOptions& options);
void requireStart(const Eigen::Ref<const Eigen::VectorXd>& x0, Eigen::Index n, std::size_t count, int horizon);
void requireControl(std::size_t k, const Eigen::Ref<const Eigen::VectorXd>& control, Eigen::Index m);
std::string describe(IterativeStatus status, const RiskStatus& risk, Fallback fallback, double share, double refused,
                     int iterations, double max_feedforward);
/// `used` <- `attitude` with its averse part (theta > 0; for cumulants the gamma < 0, which are what breaks H), or
/// `all` of it, times `share`.
void scaleAttitude(const Attitude& attitude, double share, bool all, Attitude& used);

constexpr int kActiveSetPasses = 10;   // the set of held controls settles in two or three
constexpr int kBisections = 30;        // existing share to 1e-9
constexpr int kReductions = 5;         // rounds of reduced attitude, then whole attitude
constexpr double kReduction = 0.9;     // of the share that exists
constexpr double kWorthwhile = 1.05;   // a further round must raise the share by this
constexpr double kFinest = 1.0 / 128;  // of the share aimed at: the last step along the path of solutions
constexpr double kSufficient = 1e-4;   // Armijo's share of the predicted decrease
constexpr double kFirstMu = 1e-3;      // first regularisation, relative to the largest element of R
constexpr double kMuFactor = 10.0;     // up and down
constexpr double kLastMu = 1e10;       // relative too: beyond it a step cannot be told from none
constexpr double kRounding = 1e-13;    // of the cost: differences below are noise
}  // namespace detail

template <int N, int M>
std::string IterativeResult<N, M>::message() const
{
  return detail::describe(status, risk, fallback, share, refused, iterations, max_feedforward);
}

template <int N, int M>
IterativeSolver<N, M>::IterativeSolver(OptimalControlProblem<N, M> problem, Attitude attitude, IterativeOptions options)
  : problem_(std::move(problem)), attitude_(std::move(attitude)), used_(attitude_), options_(options)
{
  validate(problem_);
  detail::requireAttitude(attitude_, problem_.noise.size());
  detail::requireOptions(options_);
  const Eigen::Index n = problem_.stateSize(), m = problem_.controlSize();
  start_.assign(problem_.horizon, Control::Zero(m));
  for (Iterate* iterate : { &now_, &next_, &kept_, &stuck_ })
  {
    iterate->nominal.resize(problem_.horizon, n, m);
    iterate->approximation.resize(problem_);
    iterate->policy.resize(problem_.horizon, n, m);
  }
  // a pass of each kind over the zero problem with R = I sizes the storage of all
  for (LqStage<N, M>& stage : now_.approximation.problem.stages)
    stage.R.setIdentity();
  for (int i = 0; i < 2; ++i)  // twice: a pass swaps its policy with the one given
  {
    backward_.neutral(now_.approximation.problem, now_.policy, now_.criterion);
    backward_(now_.approximation.problem, attitude_, now_.policy, now_.criterion);
    backward_(now_.approximation.problem, attitude_, next_.policy, next_.criterion);
  }
  if (options_.cumulants > 0)
    backward_.cumulants(now_.approximation.problem, options_.cumulants, kept_.policy, result_.cumulants);
  result_.nominal = now_.nominal;
  result_.policy = now_.policy;
  result_.multipliers = start_;
  result_.trace.reserve(options_.max_iterations + 1);
}

template <int N, int M>
bool IterativeSolver<N, M>::exhausted() const
{
  return result_.iterations >= options_.max_iterations ||
         (options_.max_passes > 0 && result_.passes >= options_.max_passes);
}

template <int N, int M>
bool IterativeSolver<N, M>::evaluate(Iterate& iterate, bool neutral, double mu)
{
  for (int pass = 0; pass < detail::kActiveSetPasses; ++pass)
  {
    if (!iterate.approximation.assemble(mu))
    {
      iterate.risk = { BreakdownKind::Hessian, -1, -1, 0.0, 0.0 };
      return false;
    }
    ++result_.passes;
    LinearQuadraticProblem<N, M>& lq = iterate.approximation.problem;
    iterate.risk = neutral ? backward_.neutral(lq, iterate.policy, iterate.criterion)
                           : backward_(lq, used_, iterate.policy, iterate.criterion);
    if (!iterate.risk)
      return false;
    if (iterate.approximation.settle(problem_, iterate.nominal, iterate.policy))
      break;
  }
  iterate.max_feedforward = 0.0;
  for (const Control& l : iterate.policy.feedforward)
    iterate.max_feedforward = std::max(iterate.max_feedforward, l.template lpNorm<Eigen::Infinity>());
  return true;
}

template <int N, int M>
bool IterativeSolver<N, M>::tryStep(double step, bool neutral, double mu)
{
  if (!stepForward(problem_, now_.nominal, now_.policy, step, now_.nominal.states[0], next_.nominal))
    return false;
  if (neutral)
  {
    const double predicted = std::max(0.0, (2.0 - step) * step * (now_.nominal.cost - now_.criterion));
    const double noise = detail::kRounding * std::abs(now_.nominal.cost);
    if (!(next_.nominal.cost <= now_.nominal.cost - detail::kSufficient * predicted + noise))
      return false;
  }
  next_.approximation.copyPins(now_.approximation);
  next_.approximation.linearise(problem_, next_.nominal);
  if (neutral)
    return true;
  if (!evaluate(next_, neutral, mu))
    return false;
  if (options_.line_search == LineSearch::Criterion)
    return next_.criterion < now_.criterion || next_.max_feedforward < options_.tolerance;
  return next_.max_feedforward < (1.0 - 0.1 * step) * now_.max_feedforward;
}

template <int N, int M>
void IterativeSolver<N, M>::record(int phase, double step, double mu, double share)
{
  if (result_.trace.size() < result_.trace.capacity())
    result_.trace.push_back({ phase, now_.nominal.cost, now_.criterion, now_.max_feedforward, step, mu, share });
}

template <int N, int M>
typename IterativeSolver<N, M>::Outcome IterativeSolver<N, M>::neutralPhase()
{
  double mu = 0.0;
  const double first = detail::kFirstMu * std::max(now_.approximation.controlScale(), 1e-9);
  const double last = first / detail::kFirstMu * detail::kLastMu;
  const auto raise = [&] { mu = mu > 0.0 ? detail::kMuFactor * mu : first; };
  bool saddle = false;  // without regularisation there is no minimum here
  while (true)
  {
    while (!evaluate(now_, true, mu))
    {
      saddle = saddle || mu == 0.0;
      raise();
      if (now_.risk.kind == BreakdownKind::NotFinite)
        return Outcome::Breakdown;
      if (mu > last)
        return Outcome::Stuck;
    }
    if (now_.max_feedforward < options_.tolerance)
    {
      if (mu == 0.0 || saddle)
      {
        record(1, 0.0, mu, 0.0);
        return mu == 0.0 ? Outcome::Converged : Outcome::Stuck;
      }
      mu = 0.0;
      continue;
    }
    if (exhausted())
      return Outcome::Exhausted;
    double step = 1.0;
    while (step >= options_.min_step && !tryStep(step, true, mu))
      step *= 0.5;
    const bool stepped = step >= options_.min_step;
    ++result_.iterations;
    record(1, stepped ? step : 0.0, mu, 0.0);
    if (stepped)
    {
      std::swap(now_, next_);
      saddle = false;
      mu = mu > first ? mu / detail::kMuFactor : 0.0;
    }
    else
    {
      raise();
      if (mu > last)
        return Outcome::Stuck;
    }
  }
}

template <int N, int M>
const IterativeResult<N, M>& IterativeSolver<N, M>::solve(const State& x0)
{
  result_.risk = {};
  result_.fallback = Fallback::None;
  result_.share = 1.0;
  result_.refused = 0.0;
  result_.converged = false;
  result_.iterations = result_.passes = 0;
  result_.trace.clear();
  scale_all_ = false;
  now_.risk = {};
  now_.criterion = now_.max_feedforward = std::numeric_limits<double>::quiet_NaN();
  std::copy(start_.begin(), start_.end(), now_.nominal.controls.begin());
  now_.approximation.clearPins();
  if (!rollOut(problem_, x0, now_.nominal))
  {
    now_.risk.kind = BreakdownKind::NotFinite;
    finish(Outcome::Breakdown);
    return result_;
  }
  now_.approximation.linearise(problem_, now_.nominal);
  Outcome outcome = options_.skip_neutral ? Outcome::Converged : neutralPhase();
  if (outcome == Outcome::Converged || (outcome == Outcome::Stuck && now_.risk))
    outcome = withAttitude();
  else
    result_.share = 0.0;
  finish(outcome);
  return result_;
}

template <int N, int M>
void IterativeSolver<N, M>::finish(Outcome outcome)
{
  const bool not_finite = outcome == Outcome::Breakdown && now_.risk.kind == BreakdownKind::NotFinite;
  switch (outcome)
  {
    case Outcome::Converged:
      result_.status = IterativeStatus::Converged;
      result_.converged = true;
      break;
    case Outcome::Exhausted:
      result_.status = IterativeStatus::MaxIterations;
      break;
    case Outcome::Stuck:
      result_.status = IterativeStatus::LineSearch;
      break;
    case Outcome::Breakdown:
      result_.status = not_finite ? IterativeStatus::NotFinite : IterativeStatus::Breakdown;
      break;
  }
  if (not_finite || result_.risk)
    result_.risk = now_.risk;
  result_.usable = static_cast<bool>(now_.risk);
  result_.nominal = now_.nominal;
  result_.policy = now_.policy;
  result_.criterion = now_.criterion;
  result_.max_feedforward = now_.max_feedforward;
  std::copy(now_.approximation.multipliers().begin(), now_.approximation.multipliers().end(),
            result_.multipliers.begin());
  if (options_.cumulants > 0 && now_.risk && now_.approximation.assembleFor(now_.policy, next_.policy))
    backward_.cumulants(now_.approximation.problem, options_.cumulants, next_.policy, result_.cumulants);
}

template <int N, int M>
IterativeResult<N, M> solveIterative(const OptimalControlProblem<N, M>& problem, const Eigen::Matrix<double, N, 1>& x0,
                                     const Attitude& attitude, const IterativeOptions& options,
                                     const std::vector<Eigen::Matrix<double, M, 1>>& start)
{
  IterativeSolver<N, M> solver(problem, attitude, options);
  detail::requireStart(x0, problem.stateSize(), start.size(), problem.horizon);
  for (std::size_t k = 0; k < start.size(); ++k)
    detail::requireControl(k, start[k], problem.controlSize());
  if (!start.empty())
    solver.start() = start;
  return solver.solve(x0);
}
}  // namespace phri_control

#include "phri_control/iterative_solver_attitude.hpp"
