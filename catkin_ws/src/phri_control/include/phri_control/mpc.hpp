#pragma once
/// The iterative solver in a control loop: plans over and over from the measured state, with a fixed budget per call,
/// each plan started from the last one shifted in time. After construction nothing is allocated in `plan` and `act`
/// (fixed sizes; functions of the problem that do not allocate).
///
/// The problem's stage index k counts from the start of each plan. A goal that moves belongs in the state (joint state
/// of robot, goal, obstacle) or in a cost object whose goal the caller changes between plans.
///
/// A call ends after `iterations` steps or `passes` backward passes, whichever comes first; MaxIterations is then the
/// normal status and the policy is the one at the last nominal. Phase 1 (risk-neutral) continues over as many calls as
/// it needs, then the attitude comes in. On breakdown the risk-neutral policy at the nominal takes over in the same
/// call (with `reduce`: the reduced attitude, at the price of some 30 backward passes more). Where no policy is finite,
/// the last one goes on to the end of its horizon, after which `act` returns false: the robot must then be passive.

#include <Eigen/Core>
#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "phri_control/feedback_policy.hpp"
#include "phri_control/iterative_solver.hpp"

namespace phri_control
{
struct MpcOptions
{
  int iterations = 1;       ///< steps per plan
  int passes = 6;           ///< backward passes per plan after which no further step is tried
  double tolerance = 1e-6;  ///< on max |l| [units of u]: a plan this good ends early
  bool reduce = false;      ///< on breakdown: the reduced attitude instead of the risk-neutral one
};

/// The policy of a state whose first 2m elements are [position (m); velocity (m)] of the robot, for the interaction
/// loop; what else is in the state (goal, obstacle) is taken to follow its nominal. Throws std::invalid_argument if
/// n < 2m, m > 6 or an element is not finite. Allocates.
template <int N, int M>
FeedbackPolicy toFeedbackPolicy(const Trajectory<N, M>& nominal, const LqPolicy<N, M>& policy, double t0, double dt,
                                int source = 0)
{
  const Eigen::Index m = nominal.controls.empty() ? 0 : nominal.controls.front().size();
  const Eigen::Index n = nominal.states.empty() ? 0 : nominal.states.front().size();
  if (m < 1 || m > phri_core::kMaxDof || n < 2 * m)
    throw std::invalid_argument("toFeedbackPolicy: " + std::to_string(n) + " states and " + std::to_string(m) +
                                " controls, expected 1 to " + std::to_string(phri_core::kMaxDof) +
                                " controls and twice as many states or more");
  std::vector<FeedbackPolicy::Stage> stages(nominal.controls.size());
  for (std::size_t k = 0; k < stages.size(); ++k)
  {
    stages[k].gain = policy.gains[k].leftCols(2 * m);
    stages[k].reference = nominal.states[k].head(2 * m);
    stages[k].feedforward = nominal.controls[k];
  }
  return FeedbackPolicy(t0, dt, std::move(stages), source);
}

template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
class ModelPredictiveController
{
public:
  using State = Eigen::Matrix<double, N, 1>;
  using Control = Eigen::Matrix<double, M, 1>;

  /// Throws std::invalid_argument as IterativeSolver does, and for a budget below 1.
  ModelPredictiveController(const OptimalControlProblem<N, M>& problem, const Attitude& attitude,
                            const MpcOptions& options = {})
    : solver_(problem, attitude, solverOptions(options)),
      nominal_(solver_.result().nominal),
      policy_(solver_.result().policy),
      offset_(problem.horizon)
  {
  }

  /// Plans from the measured state `x0`, `shift` samples after the last plan. Look at the status of the result.
  const IterativeResult<N, M>& plan(const State& x0, int shift = 1)
  {
    std::vector<Control>& start = solver_.start();
    const int horizon = static_cast<int>(start.size());
    const int move = std::clamp(shift, 0, horizon - 1);
    std::rotate(start.begin(), start.begin() + move, start.end());
    for (int k = horizon - move; k < horizon; ++k)
      start[k] = start[horizon - move - 1];
    solver_.setSkipNeutral(warm_);
    const IterativeResult<N, M>& result = solver_.solve(x0);
    warm_ = result.usable && result.share > 0.0 && result.fallback == Fallback::None;
    if (result.usable)
    {
      nominal_ = result.nominal;
      policy_ = result.policy;
      offset_ = 0;
      start = result.nominal.controls;
    }
    else
    {
      offset_ = std::min(offset_ + std::max(shift, 0), horizon);
    }
    return result;
  }

  /// The control `k` samples after the last plan at state x, inside the limits. False, with u = 0, past the horizon of
  /// the last plan that had a policy, before the first one, or if u would not be finite.
  bool act(int k, const State& x, Control& u) const
  {
    const int stage = offset_ + k;
    const bool valid = k >= 0 && stage < static_cast<int>(policy_.gains.size());
    if (valid)
    {
      u = nominal_.controls[stage];
      u.noalias() += policy_.gains[stage].lazyProduct(x - nominal_.states[stage]);
      if (u.allFinite())
      {
        clampControl(solver_.problem(), u);
        return true;
      }
    }
    u.setZero(solver_.problem().controlSize());
    return false;
  }

  /// The last plan as the policy of the interaction loop (see `toFeedbackPolicy`), dated t0 [s] at its first stage.
  FeedbackPolicy policy(double t0, int source = 0) const
  {
    return toFeedbackPolicy(nominal_, policy_, t0, solver_.problem().dt, source);
  }

  /// Forgets the last plans: the next starts from zero controls.
  void reset()
  {
    for (Control& u : solver_.start())
      u.setZero();
    warm_ = false;
    offset_ = static_cast<int>(solver_.start().size());
  }

  const IterativeResult<N, M>& result() const { return solver_.result(); }

private:
  static IterativeOptions solverOptions(const MpcOptions& options)
  {
    if (options.iterations < 1 || options.passes < 1)
      throw std::invalid_argument("MpcOptions: iterations = " + std::to_string(options.iterations) +
                                  ", passes = " + std::to_string(options.passes) + ", expected at least 1 each");
    IterativeOptions solver;
    solver.tolerance = options.tolerance;
    solver.max_iterations = options.iterations;
    solver.max_passes = options.passes;
    solver.reduce = options.reduce;
    return solver;
  }

  IterativeSolver<N, M> solver_;
  Trajectory<N, M> nominal_;
  LqPolicy<N, M> policy_;
  int offset_;
  bool warm_ = false;
};
}  // namespace phri_control
