#pragma once
// Small problems for the tests of the iterative solver: a linear plant with random weights, a pendulum that swings up
// with exact derivatives, a planar point mass that passes a bump. Fixed sizes.
#include <Eigen/Core>
#include <cmath>
#include <memory>

#include "phri_control/optimal_control_problem.hpp"
#include "phri_core/random.hpp"

namespace fixtures
{
using namespace phri_control;

inline Eigen::MatrixXd gaussian(phri_core::Random& rng, Eigen::Index rows, Eigen::Index cols)
{
  Eigen::MatrixXd matrix(rows, cols);
  for (double& element : matrix.reshaped())
    element = rng.normal();
  return matrix;
}

/// x+ = A x + B u + d and a quadratic cost with a mixed term: what the solver must solve in one iteration.
struct Linear : Dynamics<3, 2>, CostFunction<3, 2>
{
  using State = Eigen::Vector3d;
  using Control = Eigen::Vector2d;
  Eigen::Matrix3d A;
  Eigen::Matrix<double, 3, 2> B;
  Eigen::Vector3d d;
  CostExpansion<3, 2> h = CostExpansion<3, 2>::zero();
  LqTerminal<3> end = LqTerminal<3>::zero();

  Linear(phri_core::Random& rng, bool cross)
  {
    A = Eigen::Matrix3d::Identity() + 0.2 * gaussian(rng, 3, 3);
    B = gaussian(rng, 3, 2);
    d = 0.3 * gaussian(rng, 3, 1);
    const Eigen::MatrixXd root = gaussian(rng, 5, 5);
    const Eigen::MatrixXd joint = 0.2 * root * root.transpose() + 0.2 * Eigen::MatrixXd::Identity(5, 5);
    h.Q = joint.topLeftCorner(3, 3);
    h.R = joint.bottomRightCorner(2, 2);
    h.has_cross = cross;
    if (cross)
      h.S = joint.bottomLeftCorner(2, 3);
    h.q = gaussian(rng, 3, 1);
    h.r = gaussian(rng, 2, 1);
    end.Q = h.Q;
    end.q = h.q;
  }
  Eigen::Index stateSize() const override { return 3; }
  Eigen::Index controlSize() const override { return 2; }
  void step(int, const State& x, const Control& u, State& next) const override { next = A * x + B * u + d; }
  void linearise(int, const State&, const Control&, StateMatrix& fx, InputMatrix& fu) const override
  {
    fx = A;
    fu = B;
  }
  double running(int, const State& x, const Control& u) const override
  {
    return 0.5 * x.dot(h.Q * x) + h.q.dot(x) + 0.5 * u.dot(h.R * u) + h.r.dot(u) + u.dot(h.S * x);
  }
  double terminal(const State& x) const override { return 0.5 * x.dot(end.Q * x) + end.q.dot(x); }
  void expand(int k, const State& x, const Control& u, CostExpansion<3, 2>& out) const override
  {
    out = h;
    out.q0 = running(k, x, u);
    out.q = h.q + h.Q * x + h.S.transpose() * u;
    out.r = h.r + h.R * u + h.S * x;
  }
  void expandTerminal(const State& x, LqTerminal<3>& out) const override
  {
    out.Q = end.Q;
    out.q = end.q + end.Q * x;
    out.q0 = terminal(x);
  }
};

/// x = [angle from hanging [rad], rate [rad/s]], u torque [Nm]; cost dt (1 + cos) brings it upright.
struct Pendulum : Dynamics<2, 1>
{
  static constexpr double kDt = 0.05;
  using Control = Eigen::Matrix<double, 1, 1>;
  Eigen::Index stateSize() const override { return 2; }
  Eigen::Index controlSize() const override { return 1; }
  void step(int, const State& x, const Control& u, State& next) const override
  {
    next << x(0) + kDt * x(1), x(1) + kDt * (u(0) - 0.1 * x(1) - 9.81 * std::sin(x(0)));
  }
};
struct ExactPendulum : Pendulum
{
  void linearise(int, const State& x, const Control&, StateMatrix& A, InputMatrix& B) const override
  {
    A << 1.0, kDt, -kDt * 9.81 * std::cos(x(0)), 1.0 - 0.1 * kDt;
    B << 0.0, kDt;
  }
};
struct Upright : CostFunction<2, 1>
{
  double running(int, const State& x, const Control& u) const override
  {
    return Pendulum::kDt * (1.0 + std::cos(x(0)) + 0.05 * x(1) * x(1) + 0.01 * u(0) * u(0));
  }
  double terminal(const State& x) const override { return 10.0 * (1.0 + std::cos(x(0))) + 0.5 * x(1) * x(1); }
};
struct ExactUpright : Upright
{
  void expand(int k, const State& x, const Control& u, CostExpansion<2, 1>& out) const override
  {
    const double dt = Pendulum::kDt;
    out.q0 = running(k, x, u);
    out.q << -dt * std::sin(x(0)), 0.1 * dt * x(1);
    out.Q << -dt * std::cos(x(0)), 0.0, 0.0, 0.1 * dt;
    out.r << 0.02 * dt * u(0);
    out.R << 0.02 * dt;
  }
  void expandTerminal(const State& x, LqTerminal<2>& out) const override
  {
    out.q0 = terminal(x);
    out.q << -10.0 * std::sin(x(0)), x(1);
    out.Q << -10.0 * std::cos(x(0)), 0.0, 0.0, 1.0;
  }
};

inline OptimalControlProblem<2, 1> pendulum(bool exact)
{
  OptimalControlProblem<2, 1> problem;
  problem.horizon = 40;
  problem.dt = Pendulum::kDt;
  problem.dynamics = exact ? std::make_shared<ExactPendulum>() : std::make_shared<Pendulum>();
  problem.cost = exact ? std::make_shared<ExactUpright>() : std::make_shared<Upright>();
  Eigen::MatrixXd noise(2, 1);
  noise << 0.0, 0.05;
  problem.noise = { NoiseModel<2, 1>::constant("torque", noise) };
  return problem;
}

/// [p (2) [m], v (2) [m/s]] of a mass of 1 kg that walks from x0 to `goal` past a bump of height `weight` about
/// `obstacle`; noise in the position makes the bump matter more to the averse.
struct PointMass : Dynamics<4, 2>
{
  static constexpr double kDt = 0.05;
  Eigen::Index stateSize() const override { return 4; }
  Eigen::Index controlSize() const override { return 2; }
  void step(int, const State& x, const Control& u, State& next) const override
  {
    next << x.head<2>() + kDt * x.tail<2>(), x.tail<2>() + kDt * (u - x.tail<2>());
  }
  void linearise(int, const State&, const Control&, StateMatrix& A, InputMatrix& B) const override
  {
    A.setIdentity();
    A.topRightCorner<2, 2>().diagonal().setConstant(kDt);
    A.bottomRightCorner<2, 2>().diagonal().setConstant(1.0 - kDt);
    B.setZero();
    B.bottomRows<2>().diagonal().setConstant(kDt);
  }
};
struct PassBy : CostFunction<4, 2>
{
  Eigen::Vector2d goal{ 1.0, 0.0 }, obstacle{ 0.5, 0.1 };
  double weight = 0.3, width = 0.3;

  double bump(const State& x) const
  {
    return weight * std::exp(-0.5 * (x.head<2>() - obstacle).squaredNorm() / (width * width));
  }
  double running(int, const State& x, const Control& u) const override
  {
    return PointMass::kDt * (0.5 * (x.head<2>() - goal).squaredNorm() + 0.005 * u.squaredNorm() + bump(x));
  }
  double terminal(const State& x) const override
  {
    return 2.0 * ((x.head<2>() - goal).squaredNorm() + 0.1 * x.tail<2>().squaredNorm());
  }
  void expand(int k, const State& x, const Control& u, CostExpansion<4, 2>& out) const override
  {
    const Eigen::Vector2d d = (x.head<2>() - obstacle) / (width * width);
    const double h = bump(x), dt = PointMass::kDt;
    out.q0 = running(k, x, u);
    out.q.setZero();
    out.q.head<2>() = dt * (x.head<2>() - goal - h * d);
    out.Q.setZero();
    out.Q.topLeftCorner<2, 2>() =
        dt * ((1.0 - h / (width * width)) * Eigen::Matrix2d::Identity() + h * d * d.transpose());
    out.r = 0.01 * dt * u;
    out.R = 0.01 * dt * Eigen::Matrix2d::Identity();
  }
  void expandTerminal(const State& x, LqTerminal<4>& out) const override
  {
    out.q0 = terminal(x);
    out.q << 4.0 * (x.head<2>() - goal), 0.4 * x.tail<2>();
    out.Q.setZero();
    out.Q.diagonal() << 4.0, 4.0, 0.4, 0.4;
  }
};

inline OptimalControlProblem<4, 2> passBy(double noise = 0.02,
                                          std::shared_ptr<PassBy> cost = std::make_shared<PassBy>())
{
  OptimalControlProblem<4, 2> problem;
  problem.horizon = 40;
  problem.dt = PointMass::kDt;
  problem.dynamics = std::make_shared<PointMass>();
  problem.cost = cost;
  Eigen::MatrixXd factor = Eigen::MatrixXd::Zero(4, 2);
  factor.topRows(2).diagonal().setConstant(noise);
  problem.noise = { NoiseModel<4, 2>::constant("position", factor) };
  return problem;
}
}  // namespace fixtures
