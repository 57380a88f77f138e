#pragma once
/// The nonlinear stochastic problem that the iterative solver (iterative_solver.hpp) takes: what a plant and a cost
/// implement. For k = 0 .. T-1, from a given x_0,
///
///   x_{k+1} = f(k, x_k, u_k) + sum_s F_s(k, x_k, u_k) n_{s,k},      n_{s,k} ~ N(0, I),
///   J = h_T(x_T) + sum_k h(k, x_k, u_k),                            lower <= u_k <= upper (optional).
///
/// Everything is per sample: f is the discrete step and h is already multiplied by the time step where the task wants
/// that; F_s F_s' is the covariance ADDED TO THE STATE in one step (a diffusion G has F = sqrt(dt) G).
///
/// Sizes: N states and M controls as template parameters, Eigen::Dynamic (the default, what Python uses) where they are
/// known at run time only. Fixed sizes keep every vector on the stack (no allocation, several times faster products),
/// which a maximum size does not do in Eigen 3.4 (it stores on the stack but loses the unrolled products).
///
/// Derivatives: override `linearise`, `expand` and `expandTerminal` with exact ones; the defaults are central
/// differences with the steps below. Outputs come with the right sizes already and must be filled completely. For use
/// in the MPC form an override must neither allocate nor throw. A NaN or an infinity anywhere ends the solver with the
/// status NotFinite.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "phri_control/lq_problem.hpp"

namespace phri_control
{
/// Steps of the central differences, times max(1, |value|): the cube root of the machine precision balances truncation
/// and rounding for first derivatives (error about 1e-10), its fourth root for second ones (error about 1e-8).
constexpr double kFirstDifference = 6.0554544523933429e-6;
constexpr double kSecondDifference = 1.2207031250000000e-4;

template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
class Dynamics
{
public:
  using State = Eigen::Matrix<double, N, 1>;
  using Control = Eigen::Matrix<double, M, 1>;
  using StateMatrix = Eigen::Matrix<double, N, N>;
  using InputMatrix = Eigen::Matrix<double, N, M>;

  virtual ~Dynamics() = default;
  virtual Eigen::Index stateSize() const = 0;
  virtual Eigen::Index controlSize() const = 0;

  /// next = f(k, x, u). `next` is not x.
  virtual void step(int k, const State& x, const Control& u, State& next) const = 0;
  /// A = df/dx (n, n), B = df/du (n, m), of the discrete step.
  virtual void linearise(int k, const State& x, const Control& u, StateMatrix& A, InputMatrix& B) const
  {
    State point = x, up = x, down = x;
    Control effort = u;
    for (Eigen::Index i = 0; i < x.size(); ++i)
    {
      const double h = kFirstDifference * std::max(1.0, std::abs(x(i)));
      point(i) = x(i) + h;
      step(k, point, u, up);
      point(i) = x(i) - h;
      step(k, point, u, down);
      point(i) = x(i);
      A.col(i) = (up - down) / (2.0 * h);
    }
    for (Eigen::Index i = 0; i < u.size(); ++i)
    {
      const double h = kFirstDifference * std::max(1.0, std::abs(u(i)));
      effort(i) = u(i) + h;
      step(k, x, effort, up);
      effort(i) = u(i) - h;
      step(k, x, effort, down);
      effort(i) = u(i);
      B.col(i) = (up - down) / (2.0 * h);
    }
  }
};

/// h(k, x + xi, u + v) = q0 + q'xi + r'v + 1/2 xi'Q xi + v'S xi + 1/2 v'R v + ...; Q, R symmetric.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct CostExpansion
{
  double q0 = 0.0;
  Eigen::Matrix<double, N, 1> q;
  Eigen::Matrix<double, N, N> Q;
  Eigen::Matrix<double, M, 1> r;
  Eigen::Matrix<double, M, M> R;
  Eigen::Matrix<double, M, N> S;  ///< d2h/du dx (m, n); looked at only if has_cross. Needs R > 0
  bool has_cross = false;

  static CostExpansion zero(Eigen::Index n = N, Eigen::Index m = M)
  {
    CostExpansion expansion;
    expansion.q.setZero(n);
    expansion.Q.setZero(n, n);
    expansion.r.setZero(m);
    expansion.R.setZero(m, m);
    expansion.S.setZero(m, n);
    return expansion;
  }
};

template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
class CostFunction
{
public:
  using State = Eigen::Matrix<double, N, 1>;
  using Control = Eigen::Matrix<double, M, 1>;

  virtual ~CostFunction() = default;
  /// h(k, x, u) of one sample, and h_T(x).
  virtual double running(int k, const State& x, const Control& u) const = 0;
  virtual double terminal(const State& x) const = 0;

  /// Value and exact first and second derivatives at (x, u); the Hessian of a non-convex cost is indefinite and must be
  /// given as it is. q0 = running(k, x, u).
  virtual void expand(int k, const State& x, const Control& u, CostExpansion<N, M>& expansion) const
  {
    const Eigen::Index n = x.size(), m = u.size(), size = n + m;
    State shifted_x = x;
    Control shifted_u = u;
    const auto at = [&](Eigen::Index i) -> double& { return i < n ? shifted_x(i) : shifted_u(i - n); };
    const auto width = [&](double order, Eigen::Index i) { return order * std::max(1.0, std::abs(at(i))); };
    const auto value = [&] { return running(k, shifted_x, shifted_u); };
    const auto shifted = [&](Eigen::Index i, double h, Eigen::Index j, double g) {
      const double old_i = at(i), old_j = at(j);
      at(i) = old_i + h;
      if (j != i)
        at(j) = old_j + g;
      const double result = value();
      at(j) = old_j;
      at(i) = old_i;
      return result;
    };
    const auto gradient = [&](Eigen::Index i) -> double& { return i < n ? expansion.q(i) : expansion.r(i - n); };
    expansion.q0 = value();
    expansion.has_cross = true;
    for (Eigen::Index i = 0; i < size; ++i)
    {
      const double first = width(kFirstDifference, i), h = width(kSecondDifference, i);
      gradient(i) = (shifted(i, first, i, 0.0) - shifted(i, -first, i, 0.0)) / (2.0 * first);
      const double diagonal = (shifted(i, h, i, 0.0) - 2.0 * expansion.q0 + shifted(i, -h, i, 0.0)) / (h * h);
      (i < n ? expansion.Q(i, i) : expansion.R(i - n, i - n)) = diagonal;
      for (Eigen::Index j = 0; j < i; ++j)
      {
        const double g = width(kSecondDifference, j);
        const double mixed =
            (shifted(i, h, j, g) - shifted(i, h, j, -g) - shifted(i, -h, j, g) + shifted(i, -h, j, -g)) / (4.0 * h * g);
        if (i < n)
          expansion.Q(i, j) = expansion.Q(j, i) = mixed;
        else if (j >= n)
          expansion.R(i - n, j - n) = expansion.R(j - n, i - n) = mixed;
        else
          expansion.S(i - n, j) = mixed;
      }
    }
  }

  /// The same of h_T: q0, q, Q.
  virtual void expandTerminal(const State& x, LqTerminal<N>& expansion) const
  {
    State point = x;
    const auto value = [&](Eigen::Index i, double h, Eigen::Index j, double g) {
      point(i) += h;
      point(j) += g;
      const double result = terminal(point);
      point(i) = x(i);
      point(j) = x(j);
      return result;
    };
    expansion.q0 = terminal(x);
    for (Eigen::Index i = 0; i < x.size(); ++i)
    {
      const double scale = std::max(1.0, std::abs(x(i))), first = kFirstDifference * scale,
                   h = kSecondDifference * scale;
      expansion.q(i) = (value(i, first, i, 0.0) - value(i, -first, i, 0.0)) / (2.0 * first);
      expansion.Q(i, i) = (value(i, h, i, 0.0) - 2.0 * expansion.q0 + value(i, -h, i, 0.0)) / (h * h);
      for (Eigen::Index j = 0; j < i; ++j)
      {
        const double g = kSecondDifference * std::max(1.0, std::abs(x(j)));
        expansion.Q(i, j) = expansion.Q(j, i) =
            (value(i, h, j, g) - value(i, h, j, -g) - value(i, -h, j, g) + value(i, -h, j, -g)) / (4.0 * h * g);
      }
    }
  }
};

/// One source of noise. The solver evaluates F at the nominal and treats it as additive around it.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct NoiseModel
{
  using State = Eigen::Matrix<double, N, 1>;
  using Control = Eigen::Matrix<double, M, 1>;
  /// Fills F (n, p), which comes with that size.
  using Factor = std::function<void(int k, const State& x, const Control& u, Eigen::MatrixXd& factor)>;

  std::string name;
  Eigen::Index width = 0;  ///< p
  Factor factor;

  /// The same factor at all stages and states.
  static NoiseModel constant(std::string name, const Eigen::MatrixXd& factor)
  {
    return { std::move(name), factor.cols(),
             [factor](int, const State&, const Control&, Eigen::MatrixXd& out) { out = factor; } };
  }
};

/// A problem is a value: plant and cost are shared, so copying it is cheap. `dt` [s] only dates the resulting policy.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct OptimalControlProblem
{
  using State = Eigen::Matrix<double, N, 1>;
  using Control = Eigen::Matrix<double, M, 1>;

  std::shared_ptr<const Dynamics<N, M>> dynamics;
  std::shared_ptr<const CostFunction<N, M>> cost;
  std::vector<NoiseModel<N, M>> noise;
  int horizon = 0;                      ///< T, number of controls
  double dt = 1.0;                      ///< [s]
  std::optional<Control> lower, upper;  ///< control limits, elementwise; infinities are allowed

  Eigen::Index stateSize() const { return dynamics->stateSize(); }
  Eigen::Index controlSize() const { return dynamics->controlSize(); }
};

/// Throws std::invalid_argument naming the field and what was expected.
template <int N, int M>
void validate(const OptimalControlProblem<N, M>& problem)
{
  const auto fail = [](const std::string& text) { throw std::invalid_argument("OptimalControlProblem: " + text); };
  if (!problem.dynamics || !problem.cost)
    fail(problem.dynamics ? "cost is not set" : "dynamics is not set");
  if (problem.horizon < 1)
    fail("horizon = " + std::to_string(problem.horizon) + ", expected at least 1");
  if (!(problem.dt > 0.0) || !std::isfinite(problem.dt))
    fail("dt = " + std::to_string(problem.dt) + " s, expected above 0");
  const Eigen::Index n = problem.stateSize(), m = problem.controlSize();
  if (n < 1 || m < 1 || (N != Eigen::Dynamic && n != N) || (M != Eigen::Dynamic && m != M))
    fail("dynamics has " + std::to_string(n) + " states and " + std::to_string(m) + " controls, expected " +
         (N == Eigen::Dynamic ? "at least 1" : std::to_string(N)) + " and " +
         (M == Eigen::Dynamic ? "at least 1" : std::to_string(M)));
  for (const auto* limit : { &problem.lower, &problem.upper })
    if (*limit && (*limit)->size() != m)
      fail("control limit of " + std::to_string((*limit)->size()) + " elements, expected " + std::to_string(m));
  for (Eigen::Index i = 0; i < m && problem.lower && problem.upper; ++i)
    if (!((*problem.lower)(i) <= (*problem.upper)(i)))
      fail("lower(" + std::to_string(i) + ") = " + std::to_string((*problem.lower)(i)) +
           " is above upper = " + std::to_string((*problem.upper)(i)));
  for (const NoiseModel<N, M>& source : problem.noise)
    if (!source.factor || source.width < 1)
      fail("noise \"" + source.name + "\" has no factor of at least one column");
}
}  // namespace phri_control
