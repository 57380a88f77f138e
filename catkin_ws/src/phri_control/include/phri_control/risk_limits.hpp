#pragma once
/// How far risk aversion can go, and what to do beyond. For one source with Q >= 0 the criterion does not decrease in
/// theta, so the thetas >= 0 that have a policy are an interval and bisection finds its end. For several sources that
/// is not proven; then the end found is one of an interval that bisection met, and what is returned has a policy.
///
/// Trap: theta is not to be recomputed as a share of the limit at every plan: in proportion to the limit the policy no
/// longer depends on the size of the noise, which was the point. The limit is for breakdowns.

#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "phri_control/risk_sensitive.hpp"

namespace phri_control
{
constexpr double kThetaTolerance = 1e-10;  ///< relative, of the limits by bisection

namespace detail
{
constexpr double kHugeScale = 1e200;  // far beyond any limit, and its products with costs still finite
constexpr double kTinyScale = 1e-200;

/// Attitude with its averse thetas scaled, the others as they are.
inline auto scaleAverse(const RiskSensitive& attitude, double scale)
{
  return [&attitude, scale](std::size_t s) {
    const double theta = attitude.theta[s];
    return theta > 0.0 ? scale * theta : theta;
  };
}

/// The largest scale below `high`, which has no policy, that was seen to have one; at most `tolerance` (relative) below
/// one that has none. 0: none above kTinyScale.
template <typename Admissible>
double bisect(const Admissible& admissible, double high, double tolerance)
{
  double low = 0.5 * high;
  for (; !admissible(low); low *= 0.5)
  {
    if (low < kTinyScale)
      return 0.0;
    high = low;
  }
  while (high - low > tolerance * low)
  {
    const double middle = 0.5 * (low + high);
    (admissible(middle) ? low : high) = middle;
  }
  return low;
}
}  // namespace detail

/// The supremum of the scales t >= 0 such that there is a policy with every theta_s > 0 multiplied by t, the other
/// thetas kept: to a relative `tolerance`, from below, so that the attitude at the scale returned has a policy.
/// Infinite where the noise cannot reach the cost, or no theta is positive; 0 where even t = 0 has no policy. `room` is
/// scratch. About 40 backward passes; neither validates nor throws.
template <int N, int M>
double admissibleScale(const LinearQuadraticProblem<N, M>& problem, const RiskSensitive& attitude,
                       RiskSolution<N, M>& room, double tolerance = kThetaTolerance)
{
  const auto admissible = [&](double scale) {
    return static_cast<bool>(detail::solveRisk(problem, detail::scaleAverse(attitude, scale), room));
  };
  if (!admissible(0.0))
    return 0.0;
  if (admissible(detail::kHugeScale))
    return std::numeric_limits<double>::infinity();
  // Behind the stage that breaks at a huge scale the noise does not reach the cost: its own limit bounds the scale.
  const RiskStatus& status = room.status;
  double high = detail::kHugeScale;
  if (status.kind == BreakdownKind::Expectation && status.limit > 0.0 && status.theta > 0.0)
    high = status.limit / attitude.theta[status.source] * (1.0 + tolerance);
  while (high < detail::kHugeScale && admissible(high))  // the limit's own rounding
    high *= 2.0;
  return detail::bisect(admissible, high, tolerance);
}

/// The supremum of theta >= 0 for one source of noise with all others neutral (theta = 0, counted in 1/S): to a
/// relative `tolerance`, from below. Infinity without bound, such as for zero noise. Throws std::invalid_argument, and
/// RiskBreakdown where there is no policy for theta = 0 either.
template <int N, int M>
double thetaMax(const LinearQuadraticProblem<N, M>& problem, std::size_t source, double tolerance = kThetaTolerance)
{
  if (source >= problem.noise.size())
    throw std::invalid_argument("thetaMax: source " + std::to_string(source) + ", expected below " +
                                std::to_string(problem.noise.size()) + ", the number of sources of noise");
  if (!(tolerance > std::numeric_limits<double>::epsilon() && tolerance < 1.0))
    throw std::invalid_argument("thetaMax: tolerance = " + std::to_string(tolerance) + ", expected in (2e-16, 1)");
  RiskSensitive attitude{ std::vector<double>(problem.noise.size(), 0.0) };
  RiskSolution<N, M> room = solve(problem, attitude);
  attitude.theta[source] = 1.0;
  return admissibleScale(problem, attitude, room, tolerance);
}

/// What a solve with fallback ended in.
enum class RiskFallback
{
  None,      ///< the attitude asked for
  Reduced,   ///< averse thetas scaled to `fraction` of what has a policy
  Neutral,   ///< all thetas 0: the expected cost
  NoPolicy,  ///< none exists: hold the last valid gains for at most one planning period, then apply no force
};

struct FallbackReport
{
  RiskFallback used = RiskFallback::None;
  double scale = 1.0;  ///< of the averse thetas
  RiskStatus asked;    ///< of the attitude asked for
};

/// The order in which to give way when there is no policy for the attitude asked for: its averse thetas together at
/// `fraction` of their limit (which is found to 1e-3, in some 15 backward passes, more the farther it is); theta = 0,
/// which always has a policy for Q >= 0, R > 0; nothing. `solution` holds the policy unless NoPolicy. As with `solve`,
/// nothing is allocated, validated or thrown: for real-time use, give the time of those passes.
template <int N, int M>
FallbackReport solveWithFallback(const LinearQuadraticProblem<N, M>& problem, const RiskSensitive& attitude,
                                 RiskSolution<N, M>& solution, double fraction = 0.9)
{
  constexpr double kTolerance = 1e-3;  // a tenth of a hundredth of a margin of a tenth
  FallbackReport report;
  report.asked = solve(problem, attitude, solution);
  if (report.asked)
    return report;
  const auto admissible = [&](double scale) {
    return static_cast<bool>(detail::solveRisk(problem, detail::scaleAverse(attitude, scale), solution));
  };
  report.used = RiskFallback::Reduced;
  report.scale = admissible(0.0) ? fraction * detail::bisect(admissible, 1.0, kTolerance) : 0.0;
  if (report.scale > 0.0 && admissible(report.scale))
    return report;
  report.used = RiskFallback::Neutral;
  report.scale = 0.0;
  if (!detail::solveRisk(
          problem, [](std::size_t) { return 0.0; }, solution))
    report.used = RiskFallback::NoPolicy;
  return report;
}
}  // namespace phri_control
