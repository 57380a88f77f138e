#pragma once
/// Risk-sensitive control over an infinite horizon: the gain that the recursion of risk_sensitive.hpp converges to for
/// constant A, B, Q, R and noise. The recursion itself is iterated from W = 0, with its tests of existence at every
/// stage, so a gain is the limit of finite-horizon optima. Trap: algebraic Riccati solvers return finite gains beyond
/// the breakdown too; these are no policies.

#include <Eigen/Core>
#include <vector>

#include "phri_control/attitude.hpp"

namespace phri_control
{
struct StationaryOptions
{
  double tolerance = 1e-13;      ///< largest change of any W over a stage, relative to its largest element. The error
                                 ///< of the gain is that times the time constants in stages: 1e-10 for 1 s at 1 kHz
  int max_iterations = 1000000;  ///< stages
};

struct StationaryPolicy
{
  Eigen::MatrixXd gain;            ///< L (m, n); empty unless converged
  std::vector<Eigen::MatrixXd> W;  ///< (n, n) per source (one without noise), before the stage
  double rate = 0.0;               ///< growth of the criterion per stage of horizon
  RiskStatus status;               ///< its stage counts from the end of the horizon, 1 being the last
  bool converged = false;          ///< false without a breakdown: W still changes after max_iterations
  int iterations = 0;

  explicit operator bool() const { return converged; }
};

/// `factors` (n, p) are those of the sources of noise, one theta each. Throws std::invalid_argument for shapes,
/// non-finite and asymmetric matrices; breakdown and divergence end in the result, which must be looked at. Q must
/// reach every unstable mode of A: as in any iteration from W = 0, a mode without cost is left alone.
StationaryPolicy stationaryGain(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, const Eigen::MatrixXd& Q,
                                const Eigen::MatrixXd& R, const std::vector<Eigen::MatrixXd>& factors,
                                const RiskSensitive& attitude, const StationaryOptions& options = {});
}  // namespace phri_control
