#pragma once
/// One backward pass of the iterative solver: the solver that belongs to the attitude, with its storage. The criterion
/// is the value at xi = 0 of stage 0.

#include <Eigen/Core>
#include <algorithm>
#include <utility>
#include <variant>
#include <vector>

#include "phri_control/attitude.hpp"
#include "phri_control/cost_cumulants.hpp"
#include "phri_control/lq_approximation.hpp"
#include "phri_control/lq_solver.hpp"
#include "phri_control/risk_sensitive.hpp"

namespace phri_control
{
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
class BackwardPass
{
public:
  /// Expected cost, leaving the noise out: the criterion is then the cost that the approximation predicts.
  RiskStatus neutral(LinearQuadraticProblem<N, M>& problem, LqPolicy<N, M>& policy, double& criterion)
  {
    std::swap(problem.noise, silence_);
    const LqStatus status = solve(problem, neutral_);
    std::swap(problem.noise, silence_);
    criterion = neutral_.value.c;
    take(neutral_, policy);
    if (status.ok)
      return {};
    return { status.kind == LqFailure::Hessian ? BreakdownKind::Hessian : BreakdownKind::NotFinite, status.stage, -1,
             0.0, 0.0 };
  }

  RiskStatus operator()(const LinearQuadraticProblem<N, M>& problem, const Attitude& attitude, LqPolicy<N, M>& policy,
                        double& criterion)
  {
    if (const RiskSensitive* risk = std::get_if<RiskSensitive>(&attitude))
    {
      const RiskStatus status = solve(problem, *risk, risk_);
      criterion = 0.0;
      for (const QuadraticValue<N>& value : risk_.values)
        criterion += value.c / static_cast<double>(risk_.values.size());
      take(risk_, policy);
      return status;
    }
    const RiskStatus status = solve(problem, *std::get_if<CostCumulants>(&attitude), cumulants_);
    criterion = cumulants_.value.c;
    take(cumulants_, policy);
    return status;
  }

  /// The first `count` cumulants of J (S, count) from xi = 0 under `policy`.
  RiskStatus cumulants(const LinearQuadraticProblem<N, M>& problem, int count, const LqPolicy<N, M>& policy,
                       Eigen::MatrixXd& result)
  {
    const RiskStatus status = evaluateCumulants(problem, count, policy.gains, policy.feedforward, values_);
    result.resize(std::max<Eigen::Index>(1, static_cast<Eigen::Index>(problem.noise.size())), count);
    for (Eigen::Index s = 0; s < result.rows(); ++s)
    {
      double factorial = 1.0;
      for (int r = 1; r <= count; ++r)
      {
        factorial *= r;
        result(s, r - 1) = factorial * values_.series[s * count + r - 1].c;
      }
    }
    return status;
  }

private:
  template <typename Solution>
  static void take(Solution& solution, LqPolicy<N, M>& policy)
  {
    std::swap(solution.gains, policy.gains);
    std::swap(solution.feedforward, policy.feedforward);
  }

  std::vector<NoiseSource> silence_;
  LqSolution<N, M> neutral_;
  RiskSolution<N, M> risk_;
  CumulantSolution<N, M> cumulants_;
  CumulantValues<N> values_;
};
}  // namespace phri_control
