#pragma once
/// Exact derivatives of functions that are written once for any scalar, by Eigen's forward-mode AutoDiff: first ones of
/// the dynamics, gradient and Hessian of the cost (a dual number of dual numbers), for optimal_control_problem.hpp.
///
///   struct Unicycle
///   {
///     template <typename T>
///     Eigen::Matrix<T, 3, 1> operator()(const Eigen::Matrix<T, 3, 1>& x, const Eigen::Matrix<T, 2, 1>& u) const
///     {
///       using std::cos, std::sin;
///       return { x(0) + 0.1 * u(0) * cos(x(2)), x(1) + 0.1 * u(0) * sin(x(2)), x(2) + 0.1 * u(1) };
///     }
///   };
///   OptimalControlProblem<3, 2> problem = autodiff<3, 2>(Unicycle(), cost, terminal_cost, horizon, dt);
///
/// dynamics(x, u) or dynamics(x, u, k) returns x+ as Eigen::Matrix<T, N, 1>; cost(x, u) or cost(x, u, k) of one sample
/// (times the time step where the task wants that) and terminal_cost(x) return T. T is double, a dual number, or a dual
/// number of dual numbers. Noise and limits are added to the problem afterwards.
///
/// The functions are copied into the problem and called as const from any thread. Nothing is allocated and nothing
/// thrown, if they do neither. Where a function has no derivative (sqrt(0), the norm of a zero vector) the numbers are
/// not finite and the solver says so; where it branches (if, abs) it is the derivative of the branch taken.
///
/// Traps:
///  - Arithmetic of dual numbers gives expressions that refer to their operands: hold intermediate results as T, never
///    as auto, and return T (refused by the compiler otherwise).
///  - `using std::sin;` and then `sin(x(0))`: std::sin itself takes numbers only.
///  - The Hessian costs (N + M)^2 operations for each of the cost's own: for ten variables or more, derivatives by hand
///    are worth it.

#include <Eigen/Core>
#include <memory>
#include <type_traits>
#include <unsupported/Eigen/AutoDiff>
#include <utility>

#include "phri_control/optimal_control_problem.hpp"

namespace phri_control
{
namespace detail
{
/// A number and its derivatives by `Size` variables; the second kind also carries the second derivatives.
template <int Size>
using Dual = Eigen::AutoDiffScalar<Eigen::Matrix<double, Size, 1>>;
template <int Size>
using SecondDual = Eigen::AutoDiffScalar<Eigen::Matrix<Dual<Size>, Size, 1>>;

/// `value` as variable number `index` of `Size`.
template <int Size>
void seed(double value, Eigen::Index index, Dual<Size>& variable)
{
  variable = Dual<Size>(value, Size, index);
}
template <int Size>
void seed(double value, Eigen::Index index, SecondDual<Size>& variable)
{
  variable.value() = Dual<Size>(value, Size, index);
  variable.derivatives().setZero();
  variable.derivatives()(index) = Dual<Size>(1.0);
}

/// The elements of `values` as the variables from number `first` on.
template <typename Scalar, int Size, int Rows>
Eigen::Matrix<Scalar, Rows, 1> variables(const Eigen::Matrix<double, Rows, 1>& values, Eigen::Index first)
{
  Eigen::Matrix<Scalar, Rows, 1> result;
  for (Eigen::Index i = 0; i < Rows; ++i)
    seed<Size>(values(i), first + i, result(i));
  return result;
}

/// function(x, u, k) or function(x, u), which must return a `Result` and not an expression that dies with its operands.
template <typename Result, typename Function, typename X, typename U>
Result callStage(const Function& function, const X& x, const U& u, int k)
{
  if constexpr (std::is_invocable_v<const Function&, const X&, const U&, int>)
  {
    using Returned = std::decay_t<std::invoke_result_t<const Function&, const X&, const U&, int>>;
    static_assert(
        std::is_same_v<Returned, Result> || std::is_arithmetic_v<Returned>,
        "autodiff: the function must return T or Eigen::Matrix<T, N, 1>, not an expression: declare its type");
    return Result(function(x, u, k));
  }
  else
  {
    using Returned = std::decay_t<std::invoke_result_t<const Function&, const X&, const U&>>;
    static_assert(
        std::is_same_v<Returned, Result> || std::is_arithmetic_v<Returned>,
        "autodiff: the function must return T or Eigen::Matrix<T, N, 1>, not an expression: declare its type");
    return Result(function(x, u));
  }
}

template <int N, int M, typename Function>
class AutodiffDynamics final : public Dynamics<N, M>
{
public:
  using typename Dynamics<N, M>::State;
  using typename Dynamics<N, M>::Control;
  using typename Dynamics<N, M>::StateMatrix;
  using typename Dynamics<N, M>::InputMatrix;

  explicit AutodiffDynamics(Function function) : function_(std::move(function)) {}
  Eigen::Index stateSize() const override { return N; }
  Eigen::Index controlSize() const override { return M; }

  void step(int k, const State& x, const Control& u, State& next) const override
  {
    next = callStage<State>(function_, x, u, k);
  }
  void linearise(int k, const State& x, const Control& u, StateMatrix& A, InputMatrix& B) const override
  {
    using Scalar = Dual<N + M>;
    const auto next = callStage<Eigen::Matrix<Scalar, N, 1>>(function_, variables<Scalar, N + M>(x, 0),
                                                             variables<Scalar, N + M>(u, N), k);
    for (Eigen::Index i = 0; i < N; ++i)
    {
      A.row(i) = next(i).derivatives().template head<N>();
      B.row(i) = next(i).derivatives().template tail<M>();
    }
  }

private:
  Function function_;
};

template <int N, int M, typename Running, typename Terminal>
class AutodiffCost final : public CostFunction<N, M>
{
public:
  using typename CostFunction<N, M>::State;
  using typename CostFunction<N, M>::Control;

  AutodiffCost(Running running, Terminal terminal) : running_(std::move(running)), terminal_(std::move(terminal)) {}

  double running(int k, const State& x, const Control& u) const override
  {
    return callStage<double>(running_, x, u, k);
  }
  double terminal(const State& x) const override { return endOf<double>(x); }

  void expand(int k, const State& x, const Control& u, CostExpansion<N, M>& expansion) const override
  {
    using Scalar = SecondDual<N + M>;
    const auto cost = callStage<Scalar>(running_, variables<Scalar, N + M>(x, 0), variables<Scalar, N + M>(u, N), k);
    const Eigen::Matrix<double, N + M, 1>& gradient = cost.value().derivatives();
    expansion.q0 = cost.value().value();
    expansion.q = gradient.template head<N>();
    expansion.r = gradient.template tail<M>();
    expansion.has_cross = false;
    for (Eigen::Index i = 0; i < N; ++i)
      expansion.Q.row(i) = cost.derivatives()(i).derivatives().template head<N>();
    for (Eigen::Index i = 0; i < M; ++i)
    {
      const Eigen::Matrix<double, N + M, 1>& row = cost.derivatives()(N + i).derivatives();
      expansion.S.row(i) = row.template head<N>();
      expansion.R.row(i) = row.template tail<M>();
      expansion.has_cross = expansion.has_cross || (row.template head<N>().array().abs() > 0.0).any();
    }
    symmetrise(expansion.Q);
    symmetrise(expansion.R);
  }
  void expandTerminal(const State& x, LqTerminal<N>& expansion) const override
  {
    using Scalar = SecondDual<N>;
    const auto cost = endOf<Scalar>(variables<Scalar, N>(x, 0));
    expansion.q0 = cost.value().value();
    expansion.q = cost.value().derivatives();
    for (Eigen::Index i = 0; i < N; ++i)
      expansion.Q.row(i) = cost.derivatives()(i).derivatives();
    symmetrise(expansion.Q);
  }

private:
  template <typename Scalar>
  Scalar endOf(const Eigen::Matrix<Scalar, N, 1>& x) const
  {
    using Returned = std::decay_t<std::invoke_result_t<const Terminal&, const Eigen::Matrix<Scalar, N, 1>&>>;
    static_assert(std::is_same_v<Returned, Scalar> || std::is_arithmetic_v<Returned>,
                  "autodiff: the terminal cost must return T, not an expression: declare its return type");
    return Scalar(terminal_(x));
  }
  /// d2/dx dy and d2/dy dx are computed apart and may differ in their last digit.
  template <int Size>
  static void symmetrise(Eigen::Matrix<double, Size, Size>& matrix)
  {
    for (Eigen::Index i = 0; i < Size; ++i)
      for (Eigen::Index j = 0; j < i; ++j)
        matrix(i, j) = matrix(j, i) = 0.5 * (matrix(i, j) + matrix(j, i));
  }

  Running running_;
  Terminal terminal_;
};
}  // namespace detail

/// The problem of these functions (see above) over `horizon` samples of `dt` [s], without noise and limits. Checked by
/// the solver (`validate`) like any other problem.
template <int N, int M, typename Step, typename Running, typename Terminal>
OptimalControlProblem<N, M> autodiff(Step dynamics, Running cost, Terminal terminal_cost, int horizon, double dt = 1.0)
{
  static_assert(N > 0 && M > 0, "autodiff: N and M must be known at compile time");
  OptimalControlProblem<N, M> problem;
  problem.dynamics = std::make_shared<detail::AutodiffDynamics<N, M, Step>>(std::move(dynamics));
  problem.cost =
      std::make_shared<detail::AutodiffCost<N, M, Running, Terminal>>(std::move(cost), std::move(terminal_cost));
  problem.horizon = horizon;
  problem.dt = dt;
  return problem;
}
}  // namespace phri_control
