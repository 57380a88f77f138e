#pragma once
/// What a policy is to be good at, kept apart from the physics (lq_problem.hpp): attitudes to the uncertainty of the
/// cost J of a `LinearQuadraticProblem`, one per source of noise. The criterion of S sources is the mean of the
/// sources' own, each with that source's noise alone (marginal sources, (4.14)):
///
///   risk-sensitive   1/S sum_s theta_s^-1 log E_s exp(theta_s J)          theta_s = 0: E_s J
///   cumulants        1/S sum_s sum_r gamma_{r,s} kappa_r^s, gamma_1 = 1   kappa_r^s: r-th cumulant of J under source s
///
/// One sign everywhere: theta > 0 is risk-averse, theta < 0 is risk-seeking. Units of theta: 1/[J]; of gamma_r:
/// 1/[J]^(r-1). Risk-averse optima exist below a limit only: at every stage I - theta E'WE must be positive definite
/// ("neurotic breakdown" beyond). Chapter 5 of the thesis has the opposite sign: theta = -theta_5.

#include <Eigen/Core>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

namespace phri_control
{
struct RiskSensitive
{
  std::vector<double> theta;  ///< per source [1/J]; a source with 0 counts in 1/S
};

struct CostCumulants
{
  Eigen::MatrixXd gamma;  ///< (S, K - 1): weights of kappa_2 .. kappa_K, per source; no columns: the expected cost
};

using Attitude = std::variant<RiskSensitive, CostCumulants>;

/// Why there is no policy.
enum class BreakdownKind
{
  None,
  Expectation,  ///< I - theta E'WE is not positive definite: the expectation of exp(theta J) is infinite
  Hessian,      ///< H = R + B'Wbar B is not positive definite: the criterion has no minimum over u_k
  NotFinite     ///< a NaN or an infinity in the problem, overflow, or noise beyond the digits of a double
};

/// Must be looked at: the gains of a failed solution are not a policy.
struct RiskStatus
{
  BreakdownKind kind = BreakdownKind::None;
  int stage = -1;      ///< the first one met going backward; -1: none
  int source = -1;     ///< of an Expectation; -1: not of one source
  double theta = 0.0;  ///< of that source
  double limit = 0.0;  ///< that theta must be below (averse) or above (seeking, W indefinite) at that stage

  explicit operator bool() const { return kind == BreakdownKind::None; }
};

/// What the throwing forms throw: the status in words.
class RiskBreakdown : public std::runtime_error
{
public:
  explicit RiskBreakdown(const RiskStatus& status);
  const RiskStatus& status() const { return status_; }

private:
  RiskStatus status_;
};
}  // namespace phri_control
