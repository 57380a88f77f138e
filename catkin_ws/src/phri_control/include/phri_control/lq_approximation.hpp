#pragma once
/// What stands between a nonlinear problem (optimal_control_problem.hpp) and the linear-quadratic solvers: the roll-out
/// of a nominal, the quadratic approximation around it, and control limits expressed in a form that every backward pass
/// understands.
///
/// In the deviations xi = x - x_nominal, v = u - u_nominal the dynamics are linear without drift (the nominal satisfies
/// them) and the cost is its second-order expansion. A mixed term v'S xi is removed by v = v~ - R^-1 S xi, which leaves
/// H and the value function as they are. Levenberg regularisation adds mu/2 |v|^2.
///
/// Control limits: a control that would leave its box is pinned to the limit by a quadratic of weight rho, 1e10 times
/// the problem's own scale. The backward pass then returns l_i = delta_i to 1e-10 of the scale, a row of the gain that
/// is 0 to the same precision (both are then set exactly), and in the remaining difference the multiplier
/// d criterion/du_i = -rho (l_i - delta_i), positive at a lower limit and negative at an upper one that holds the
/// optimum back.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "phri_control/attitude.hpp"
#include "phri_control/lq_solver.hpp"
#include "phri_control/optimal_control_problem.hpp"

namespace phri_control
{
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct Trajectory
{
  std::vector<Eigen::Matrix<double, N, 1>> states;    ///< T + 1
  std::vector<Eigen::Matrix<double, M, 1>> controls;  ///< T, inside the limits
  double cost = 0.0;                                  ///< J without noise

  void resize(int horizon, Eigen::Index n, Eigen::Index m)
  {
    states.assign(horizon + 1, Eigen::Matrix<double, N, 1>::Zero(n));
    controls.assign(horizon, Eigen::Matrix<double, M, 1>::Zero(m));
  }
};

/// v_k = L_k xi_k + l_k.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct LqPolicy
{
  std::vector<Eigen::Matrix<double, M, N>> gains;        ///< L_k (m, n)
  std::vector<Eigen::Matrix<double, M, 1>> feedforward;  ///< l_k (m)

  void resize(int horizon, Eigen::Index n, Eigen::Index m)
  {
    gains.assign(horizon, Eigen::Matrix<double, M, N>::Zero(m, n));
    feedforward.assign(horizon, Eigen::Matrix<double, M, 1>::Zero(m));
  }
};

/// The nearest control inside the limits of `problem`.
template <int N, int M>
void clampControl(const OptimalControlProblem<N, M>& problem, Eigen::Matrix<double, M, 1>& u)
{
  if (problem.lower)
    u = u.cwiseMax(*problem.lower);
  if (problem.upper)
    u = u.cwiseMin(*problem.upper);
}

/// Rolls the noise-free dynamics out from `x0` under trajectory.controls (clamped first). False if not finite.
template <int N, int M>
bool rollOut(const OptimalControlProblem<N, M>& problem, const Eigen::Matrix<double, N, 1>& x0,
             Trajectory<N, M>& trajectory)
{
  trajectory.states[0] = x0;
  trajectory.cost = 0.0;
  for (int k = 0; k < problem.horizon; ++k)
  {
    clampControl(problem, trajectory.controls[k]);
    if (!trajectory.controls[k].allFinite() || !trajectory.states[k].allFinite())
      return false;
    trajectory.cost += problem.cost->running(k, trajectory.states[k], trajectory.controls[k]);
    problem.dynamics->step(k, trajectory.states[k], trajectory.controls[k], trajectory.states[k + 1]);
  }
  trajectory.cost += problem.cost->terminal(trajectory.states[problem.horizon]);
  return trajectory.states[problem.horizon].allFinite() && std::isfinite(trajectory.cost);
}

/// Steps along a policy around `old`: u = u_old + step l + L (x - x_old) (4.4 of the thesis), clamped. False if not
/// finite.
template <int N, int M>
bool stepForward(const OptimalControlProblem<N, M>& problem, const Trajectory<N, M>& old, const LqPolicy<N, M>& policy,
                 double step, const Eigen::Matrix<double, N, 1>& x0, Trajectory<N, M>& next)
{
  next.states[0] = x0;
  next.cost = 0.0;
  for (int k = 0; k < problem.horizon; ++k)
  {
    Eigen::Matrix<double, M, 1>& u = next.controls[k];
    u = old.controls[k] + step * policy.feedforward[k];
    u.noalias() += policy.gains[k].lazyProduct(next.states[k] - old.states[k]);
    clampControl(problem, u);
    if (!u.allFinite() || !next.states[k].allFinite())
      return false;
    next.cost += problem.cost->running(k, next.states[k], u);
    problem.dynamics->step(k, next.states[k], u, next.states[k + 1]);
  }
  next.cost += problem.cost->terminal(next.states[problem.horizon]);
  return next.states[problem.horizon].allFinite() && std::isfinite(next.cost);
}

/// The approximation at one nominal, with its storage: allocates in `resize` only (fixed sizes).
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
class LqApproximation
{
public:
  LinearQuadraticProblem<N, M> problem;

  void resize(const OptimalControlProblem<N, M>& source)
  {
    const Eigen::Index n = source.stateSize(), m = source.controlSize();
    problem.stages.assign(source.horizon, LqStage<N, M>::zero(n, m));
    problem.terminal = LqTerminal<N>::zero(n);
    problem.noise.resize(source.noise.size());
    for (std::size_t s = 0; s < source.noise.size(); ++s)
    {
      problem.noise[s].name = source.noise[s].name;
      problem.noise[s].factor.assign(source.horizon, Eigen::MatrixXd::Zero(n, source.noise[s].width));
    }
    cost_.assign(source.horizon, CostExpansion<N, M>::zero(n, m));
    A_.assign(source.horizon, problem.stages.front().A);
    cross_.assign(source.horizon, Eigen::Matrix<double, M, N>::Zero(m, n));
    pinned_.assign(source.horizon * m, 0);
    target_.assign(source.horizon, Eigen::Matrix<double, M, 1>::Zero(m));
    multiplier_ = target_;
  }

  /// Linearises and expands around `nominal`. Pins are kept and aim at the limits as seen from this nominal.
  void linearise(const OptimalControlProblem<N, M>& source, const Trajectory<N, M>& nominal)
  {
    double b_scale = 0.0, q_scale = 0.0;
    r_scale_ = 0.0;
    for (int k = 0; k < source.horizon; ++k)
    {
      const Eigen::Matrix<double, N, 1>& x = nominal.states[k];
      const Eigen::Matrix<double, M, 1>& u = nominal.controls[k];
      source.dynamics->linearise(k, x, u, A_[k], problem.stages[k].B);
      source.cost->expand(k, x, u, cost_[k]);
      for (std::size_t s = 0; s < source.noise.size(); ++s)
        source.noise[s].factor(k, x, u, problem.noise[s].factor[k]);
      r_scale_ = std::max(r_scale_, cost_[k].R.cwiseAbs().maxCoeff());
      q_scale = std::max(q_scale, cost_[k].Q.cwiseAbs().maxCoeff());
      b_scale = std::max(b_scale, problem.stages[k].B.squaredNorm());
    }
    source.cost->expandTerminal(nominal.states[source.horizon], problem.terminal);
    q_scale = std::max(q_scale, problem.terminal.Q.cwiseAbs().maxCoeff());
    rho_ = kPinWeight * (r_scale_ + b_scale * q_scale);
    aim(source, nominal);
  }

  /// Writes the stages: the expansion with regularisation `mu` and the pins, mixed terms removed. A mixed term cannot
  /// be where R + mu I is not positive definite (Hessian) or not finite.
  RiskStatus assemble(double mu)
  {
    for (std::size_t k = 0; k < cost_.size(); ++k)
    {
      LqStage<N, M>& stage = problem.stages[k];
      const CostExpansion<N, M>& cost = cost_[k];
      const Eigen::Index m = cost.r.size();
      stage.A = A_[k];
      stage.Q = cost.Q;
      stage.q = cost.q;
      stage.q0 = cost.q0;
      stage.R = cost.R;
      stage.r = cost.r;
      for (Eigen::Index i = 0; i < m; ++i)
      {
        stage.R(i, i) += mu;
        const int pin = pinned_[k * m + i];
        if (pin == 0 || std::abs(pin) == kMuted)
          continue;
        stage.R(i, i) += rho_;
        stage.r(i) -= rho_ * target_[k](i);
        stage.q0 += 0.5 * rho_ * target_[k](i) * target_[k](i);
      }
      if (!cost.has_cross)
        continue;
      Eigen::Matrix<double, M, M> factor = stage.R;
      if (!detail::factorise(factor))
      {
        const BreakdownKind kind = stage.R.allFinite() ? BreakdownKind::Hessian : BreakdownKind::NotFinite;
        return { kind, static_cast<int>(k), -1, 0.0, 0.0 };
      }
      cross_[k] = cost.S;
      detail::solveNegative(factor, cross_[k]);  // -R^-1 S
      stage.A.noalias() += stage.B.lazyProduct(cross_[k]);
      stage.Q.noalias() += cost.S.transpose().lazyProduct(cross_[k]);
      stage.Q = (0.5 * (stage.Q + stage.Q.transpose())).eval();
      stage.q.noalias() += cross_[k].transpose().lazyProduct(stage.r);
    }
    return {};
  }

  /// Writes the stages without regularisation and pins and `policy` into `own`, as that problem sees it (without the
  /// mixed terms): for evaluating the policy. False as in `assemble`.
  bool assembleFor(const LqPolicy<N, M>& policy, LqPolicy<N, M>& own)
  {
    for (signed char& pin : pinned_)
      pin *= kMuted;
    const bool ok = static_cast<bool>(assemble(0.0));
    for (signed char& pin : pinned_)
      pin /= kMuted;
    own = policy;
    for (std::size_t k = 0; k < cost_.size(); ++k)
      if (cost_[k].has_cross)
        own.gains[k] -= cross_[k];
    return ok;
  }

  /// Puts the mixed terms back into the policy, then compares it with the limits: a control that leaves them is pinned,
  /// a pinned one whose multiplier points inward is released. True if nothing changed: the policy is then the optimum
  /// within the limits.
  bool settle(const OptimalControlProblem<N, M>& source, const Trajectory<N, M>& nominal, LqPolicy<N, M>& policy)
  {
    bool settled = true;
    for (std::size_t k = 0; k < cost_.size(); ++k)
    {
      if (cost_[k].has_cross)
        policy.gains[k] += cross_[k];
      if (!source.lower && !source.upper)
        continue;
      const Eigen::Index m = policy.feedforward[k].size();
      for (Eigen::Index i = 0; i < m; ++i)
      {
        double& l = policy.feedforward[k](i);
        signed char& pin = pinned_[k * m + i];
        const signed char before = pin;
        if (pin)
        {
          multiplier_[k](i) = -rho_ * (l - target_[k](i));
          if (pin * multiplier_[k](i) > 0.0)
            pin = 0;
          l = target_[k](i);
          policy.gains[k].row(i).setZero();
        }
        else
        {
          multiplier_[k](i) = 0.0;
          const double u = nominal.controls[k](i) + l;
          pin = source.upper && u > (*source.upper)(i) ? 1 : source.lower && u < (*source.lower)(i) ? -1 : 0;
        }
        settled = settled && pin == before;
      }
    }
    aim(source, nominal);
    return settled;
  }

  /// d criterion/du (m) per stage at the controls that are held, 0 at the free ones.
  const std::vector<Eigen::Matrix<double, M, 1>>& multipliers() const { return multiplier_; }
  /// Largest element of R: the scale of a regularisation.
  double controlScale() const { return r_scale_; }
  /// -1: u_i of stage k is held at its lower limit, 1: at its upper one, 0: free.
  int pinned(int k, Eigen::Index i) const { return pinned_[k * cost_.front().r.size() + i]; }
  void copyPins(const LqApproximation& other) { pinned_ = other.pinned_; }
  void clearPins() { std::fill(pinned_.begin(), pinned_.end(), 0); }

private:
  static constexpr double kPinWeight = 1e10;
  static constexpr signed char kMuted = 2;  // times a pin: remembered, not applied

  void aim(const OptimalControlProblem<N, M>& source, const Trajectory<N, M>& nominal)
  {
    const Eigen::Index m = source.controlSize();
    for (int k = 0; k < source.horizon; ++k)
      for (Eigen::Index i = 0; i < m; ++i)
        if (const int pin = pinned_[k * m + i])
          target_[k](i) = (pin > 0 ? *source.upper : *source.lower)(i)-nominal.controls[k](i);
  }

  std::vector<CostExpansion<N, M>> cost_;
  std::vector<Eigen::Matrix<double, N, N>> A_;
  std::vector<Eigen::Matrix<double, M, N>> cross_;
  std::vector<signed char> pinned_;
  std::vector<Eigen::Matrix<double, M, 1>> target_, multiplier_;
  double rho_ = 0.0, r_scale_ = 0.0;
};

/// The linear-quadratic problem in deviations from `nominal`, as the solver sees it. With a mixed term v'S xi in the
/// cost its control is v + R^-1 S xi.
template <int N, int M>
LinearQuadraticProblem<N, M> approximate(const OptimalControlProblem<N, M>& problem, const Trajectory<N, M>& nominal)
{
  LqApproximation<N, M> approximation;
  approximation.resize(problem);
  approximation.linearise(problem, nominal);
  if (!approximation.assemble(0.0))
    throw std::invalid_argument("approximate: the cost has a mixed term but its R is not positive definite");
  return approximation.problem;
}
}  // namespace phri_control
