#include "phri_control/stationary_gain.hpp"

#include <cmath>

#include "phri_control/risk_sensitive.hpp"

namespace phri_control
{
StationaryPolicy stationaryGain(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, const Eigen::MatrixXd& Q,
                                const Eigen::MatrixXd& R, const std::vector<Eigen::MatrixXd>& factors,
                                const RiskSensitive& attitude, const StationaryOptions& options)
{
  LinearQuadraticProblem<> problem;
  problem.terminal = LqTerminal<>::zero(A.rows());
  problem.stages.push_back(LqStage<>::zero(A.rows(), B.cols()));
  LqStage<>& stage = problem.stages.front();
  stage.A = A;
  stage.B = B;
  stage.Q = Q;
  stage.R = R;
  for (std::size_t s = 0; s < factors.size(); ++s)
    problem.noise.push_back(NoiseSource::fromFactor(std::to_string(s), factors[s]));
  validate(problem, attitude);
  phri_core::requireRange("stationaryGain: tolerance", options.tolerance, 0.0, 1.0, "");
  phri_core::requireRange("stationaryGain: max_iterations", options.max_iterations, 1.0, 1e9, "stages");

  const auto theta = [&](std::size_t s) { return attitude.theta[s]; };
  std::vector<QuadraticValue<>> values;
  detail::startValues(problem, values);
  detail::Mean<Eigen::Dynamic, Eigen::Dynamic> mean;
  detail::ClosedLoop<Eigen::Dynamic> loop;
  Eigen::MatrixXd L, before;
  Eigen::VectorXd l;
  StationaryPolicy policy;
  std::vector<Eigen::MatrixXd> last(values.size(), Eigen::MatrixXd::Zero(A.rows(), A.rows()));
  while (!policy.converged && policy.iterations < options.max_iterations)
  {
    ++policy.iterations;
    policy.status = detail::throughNoise(problem, theta, 0, values);
    if (policy.status && !detail::improve(stage, values, mean, L, l))
      policy.status.kind = mean.H.allFinite() ? BreakdownKind::Hessian : BreakdownKind::NotFinite;
    if (!policy.status)
    {
      policy.status.stage = policy.iterations;
      return policy;
    }
    detail::close<Eigen::Dynamic, Eigen::Dynamic>(stage, L, l, loop);
    policy.converged = true;
    policy.rate = 0.0;
    for (std::size_t s = 0; s < values.size(); ++s)
    {
      detail::throughLoop<Eigen::Dynamic>(loop, values[s]);
      const double change = (values[s].W - last[s]).cwiseAbs().maxCoeff(), size = values[s].W.cwiseAbs().maxCoeff();
      policy.converged = policy.converged && std::isfinite(size) && change <= options.tolerance * size;
      policy.rate += values[s].c / static_cast<double>(values.size());
      values[s].c = 0.0;
      last[s] = values[s].W;
    }
  }
  policy.W = last;
  if (policy.converged)
    policy.gain = L;
  return policy;
}
}  // namespace phri_control
