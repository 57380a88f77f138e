#pragma once
/// Iterative solution of a nonlinear `OptimalControlProblem` for an attitude to its noise (section 4.4): iLEQR for
/// `RiskSensitive`, iKCCR for `CostCumulants`. Around a nominal trajectory the problem is linear-quadratic
/// (lq_approximation.hpp); its exact solution is a policy
///
///   u_k = u_nominal,k + l_k + L_k (x_k - x_nominal,k),
///
/// and a solution of the nonlinear problem is a nominal at which max |l_k| < tolerance: a fixed point, which no line
/// search can move. Two phases reach it:
///   1. theta = 0 without noise, started from the controls given: an ordinary iterative LQR with the true cost as merit
///      (Armijo) and a Levenberg term that grows where H is not positive definite or no step descends;
///   2. the attitude, started from 1: a step is taken if it shrinks max |l| below (1 - 0.1 step) of what it was. The
///      step starts at 1 and is halved down to min_step. There is no regularisation here: with an attitude it would
///      move the fixed point.
/// The thesis compares the criterion of the approximation at the new nominal instead (LineSearch::Criterion). It
/// contains traces and log-determinants whose change with the nominal is invisible to l, so that near the optimum it
/// refuses good steps.
///
/// Where the attitude breaks down (no policy) at a nominal, `reduce` takes the averse part of it down to 0.9 of what
/// exists there (theta_s > 0; negative gamma of cumulants), goes on, and tries the whole attitude again at the
/// nominal so found; without `reduce`, or where nothing is left, the risk-neutral solution of phase 1 is returned.
/// Either way the status is Breakdown unless the whole attitude was solved for in the end.
///
/// Where no step progresses, solutions are followed: a share of the attitude is solved for, a larger one from there,
/// with steps that halve down to 1/128. The share grows from 0, all weights together where the whole attitude has a
/// policy at each nominal. Solutions can end at a share below 1 without a breakdown: two of them meet there (a fold)
/// and beyond it there is none nearby. Then, with `reduce`, the result is the last one found, `share` and `refused`
/// say where the end lies, and the status is LineSearch.
///
/// What is guaranteed: the fixed point is stationary for the LQ approximation of the criterion, which is local. The
/// approximation is good only where the noise moves the state less than the cost bends: an obstacle of width 0.07 m
/// under noise of 0.7 m is outside. Different starts may end in different local solutions.

#include <Eigen/Core>
#include <string>
#include <vector>

#include "phri_control/attitude.hpp"
#include "phri_control/backward_pass.hpp"
#include "phri_control/feedback_policy.hpp"
#include "phri_control/lq_approximation.hpp"
#include "phri_control/optimal_control_problem.hpp"

namespace phri_control
{
enum class IterativeStatus
{
  Converged,
  MaxIterations,  ///< or max_passes: the best so far; its gains are those of the last nominal
  Breakdown,      ///< the attitude has no policy: see `risk` and `fallback`
  LineSearch,     ///< no step made progress for the whole attitude: see `fallback`
  NotFinite       ///< dynamics, cost or a derivative is not finite at the start
};

const char* toString(IterativeStatus status);

enum class Fallback
{
  None,
  Reduced,     ///< the result belongs to the attitude reduced by `share`
  RiskNeutral  ///< the result is the risk-neutral one
};

enum class LineSearch
{
  Feedforward,  ///< max |l| must shrink
  Criterion     ///< the thesis': the criterion of the approximation at the new nominal must fall
};

struct IterativeOptions
{
  double tolerance = 1e-6;   ///< on max |l| [units of u]
  int max_iterations = 100;  ///< of both phases together
  int max_passes = 0;        ///< backward passes after which no further step is tried; 0: no limit
  double min_step = 1e-4;    ///< smallest step
  LineSearch line_search = LineSearch::Feedforward;
  bool reduce = true;         ///< fallback on breakdown and where solutions end
  bool skip_neutral = false;  ///< start phase 2 from the controls given: for a warm start near a solution
  int cumulants = 0;          ///< how many cumulants of J per source the result reports
};

/// One line per iteration: the state of affairs at its nominal.
struct IterationTrace
{
  int phase = 0;                 ///< 1: risk-neutral, 2: with the attitude
  double cost = 0.0;             ///< J of the nominal, without noise
  double criterion = 0.0;        ///< of the approximation at the nominal (phase 1: predicted J)
  double max_feedforward = 0.0;  ///< max |l|
  double step = 0.0;             ///< that led away from here; 0: none
  double regularisation = 0.0;   ///< mu
  double share = 0.0;            ///< of the attitude's averse part in use; 0 in phase 1
};

template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct IterativeResult
{
  IterativeStatus status = IterativeStatus::NotFinite;
  RiskStatus risk;  ///< of the first breakdown of the whole attitude, also where the iteration got round it later; of
                    ///< the last share refused where solutions ended
  Fallback fallback = Fallback::None;
  double share = 1.0;      ///< of the attitude's averse part (see above) that the result belongs to
  double refused = 0.0;    ///< smallest share tried from there that had no solution; 0: the share was not limited so
  bool converged = false;  ///< max |l| < tolerance for the attitude that the result belongs to
  bool usable = false;     ///< `policy` is a finite policy around `nominal`, whatever the status
  Trajectory<N, M> nominal;
  LqPolicy<N, M> policy;                                 ///< around `nominal`
  std::vector<Eigen::Matrix<double, M, 1>> multipliers;  ///< d criterion/du at controls that their limits hold, else 0
  double criterion = 0.0;                                ///< of the approximation at the nominal
  double max_feedforward = 0.0;
  int iterations = 0, passes = 0;
  std::vector<IterationTrace> trace;
  Eigen::MatrixXd cumulants;  ///< (S, K) of J in the approximation, if asked for

  explicit operator bool() const { return status == IterativeStatus::Converged; }
  /// What happened, in words with numbers.
  std::string message() const;
};

/// The solver with its storage. After construction with fixed sizes and a problem whose functions do not allocate,
/// `solve` allocates nothing (with CostCumulants or `cumulants` too). Not for use by two threads at a time.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
class IterativeSolver
{
public:
  using State = Eigen::Matrix<double, N, 1>;
  using Control = Eigen::Matrix<double, M, 1>;

  /// Throws std::invalid_argument (see `validate`; attitude: one finite theta or row of gamma per source).
  IterativeSolver(OptimalControlProblem<N, M> problem, Attitude attitude, IterativeOptions options = {});

  /// From `x0` with the controls in `start()`, which holds zeros after construction. Throws nothing of its own.
  const IterativeResult<N, M>& solve(const State& x0);

  /// The controls that the next `solve` starts from (T of m).
  std::vector<Control>& start() { return start_; }
  const IterativeResult<N, M>& result() const { return result_; }
  const OptimalControlProblem<N, M>& problem() const { return problem_; }
  const IterativeOptions& options() const { return options_; }
  void setSkipNeutral(bool skip) { options_.skip_neutral = skip; }

private:
  /// A nominal with everything that belongs to it.
  struct Iterate
  {
    Trajectory<N, M> nominal;
    LqApproximation<N, M> approximation;
    LqPolicy<N, M> policy;
    double criterion = 0.0, max_feedforward = 0.0;
    RiskStatus risk;
  };
  enum class Outcome
  {
    Converged,
    Exhausted,
    Stuck,
    Breakdown
  };

  bool exhausted() const;
  bool evaluate(Iterate& iterate, bool neutral, double mu);
  bool tryStep(double step, bool neutral, double mu);
  void record(int phase, double step, double mu, double share);
  Outcome neutralPhase();
  Outcome attitudePhase(double share);
  double existingShare();
  void setShare(double share);
  double follow(double share, double aim, double step, RiskStatus& end);
  void standBy(double share);
  Outcome withAttitude();
  void finish(Outcome outcome);

  OptimalControlProblem<N, M> problem_;
  Attitude attitude_, used_;
  IterativeOptions options_;
  std::vector<Control> start_;
  Iterate now_, next_, kept_, stuck_;
  bool scale_all_ = false;
  BackwardPass<N, M> backward_;
  IterativeResult<N, M> result_;
};

/// Solves from the controls `start` (empty: zeros). Throws std::invalid_argument for a malformed problem only; look at
/// the status of the result.
template <int N, int M>
IterativeResult<N, M> solveIterative(const OptimalControlProblem<N, M>& problem, const Eigen::Matrix<double, N, 1>& x0,
                                     const Attitude& attitude, const IterativeOptions& options = {},
                                     const std::vector<Eigen::Matrix<double, M, 1>>& start = {});
}  // namespace phri_control

#include "phri_control/iterative_solver_impl.hpp"
