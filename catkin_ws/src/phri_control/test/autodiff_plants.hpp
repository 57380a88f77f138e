#pragma once
// The two-link arm, the car-like robot and a task for them, written once for any scalar: apart from
// benchmark_plants.cpp, so that each is an oracle for the other.
#include <Eigen/Core>
#include <cmath>

#include "phri_control/benchmark_plants.hpp"

namespace autodiff_plants
{
using namespace phri_control;
using Eigen::Vector4d;

template <typename T>
using Vector2 = Eigen::Matrix<T, 2, 1>;

/// The two-link arm of (4.6.3) from its Lagrangian's textbook form, joint torques, in plain scalars.
struct ArmRate
{
  static constexpr int kSize = 4;
  ArmParameters p;

  template <typename T>
  Eigen::Matrix<T, 4, 1> operator()(const Eigen::Matrix<T, 4, 1>& x, const Vector2<T>& u) const
  {
    using std::cos, std::sin;
    const double l1 = p.length(0), coupling = 0.5 * p.mass(1) * l1 * p.length(1);
    const T c2 = cos(x(1)), s2 = sin(x(1));
    const T m11 = p.inertia(0) + p.inertia(1) + p.mass(1) * l1 * l1 + 2.0 * coupling * c2;
    const T m12 = p.inertia(1) + coupling * c2;
    const double m22 = p.inertia(1);
    const T t1 = u(0) + coupling * s2 * x(3) * (2.0 * x(2) + x(3)) - p.friction(0, 0) * x(2) - p.friction(0, 1) * x(3);
    const T t2 = u(1) - coupling * s2 * x(2) * x(2) - p.friction(1, 0) * x(2) - p.friction(1, 1) * x(3);
    const T determinant = m22 * m11 - m12 * m12;
    Eigen::Matrix<T, 4, 1> rate;
    rate(0) = x(2);
    rate(1) = x(3);
    rate(2) = (m22 * t1 - m12 * t2) / determinant;
    rate(3) = (m11 * t2 - m12 * t1) / determinant;
    return rate;
  }
  template <typename T>
  Eigen::Matrix<T, 4, 1> motion(const Eigen::Matrix<T, 4, 1>& x) const
  {
    using std::cos, std::sin;
    const double l1 = p.length(0), l2 = p.length(1);
    const T both = x(0) + x(1), turn = x(2) + x(3);
    Eigen::Matrix<T, 4, 1> y;
    y(0) = l1 * cos(x(0)) + l2 * cos(both);
    y(1) = l1 * sin(x(0)) + l2 * sin(both);
    y(2) = -l1 * sin(x(0)) * x(2) - l2 * sin(both) * turn;
    y(3) = l1 * cos(x(0)) * x(2) + l2 * cos(both) * turn;
    return y;
  }
};

struct CarRate
{
  static constexpr int kSize = 5;

  template <typename T>
  Eigen::Matrix<T, 5, 1> operator()(const Eigen::Matrix<T, 5, 1>& x, const Vector2<T>& u) const
  {
    using std::cos, std::sin;
    Eigen::Matrix<T, 5, 1> rate;
    rate(0) = x(3) * cos(x(2));
    rate(1) = x(3) * sin(x(2));
    rate(2) = x(3) * x(4);
    rate(3) = u(0);
    rate(4) = u(1);
    return rate;
  }
  template <typename T>
  Eigen::Matrix<T, 4, 1> motion(const Eigen::Matrix<T, 5, 1>& x) const
  {
    const Eigen::Matrix<T, 5, 1> rate = (*this)(x, Vector2<T>(T(0.0), T(0.0)));
    Eigen::Matrix<T, 4, 1> y;
    y << x(0), x(1), rate(0), rate(1);
    return y;
  }
};

/// Euler or the classical Runge-Kutta scheme around a rate.
template <typename Rate>
struct Stepped
{
  static constexpr int N = Rate::kSize;
  Rate rate;
  Integrator integrator = Integrator::Euler;
  double dt = 0.02;

  template <typename T>
  Eigen::Matrix<T, N, 1> operator()(const Eigen::Matrix<T, N, 1>& x, const Vector2<T>& u) const
  {
    using State = Eigen::Matrix<T, N, 1>;
    const T h(dt), half(0.5 * dt), sixth(dt / 6.0), third(dt / 3.0);
    const State k1 = rate(x, u);
    if (integrator == Integrator::Euler)
      return State(x + h * k1);
    const State k2 = rate(State(x + half * k1), u);
    const State k3 = rate(State(x + half * k2), u);
    const State k4 = rate(State(x + h * k3), u);
    return State(x + sixth * k1 + third * k2 + third * k3 + sixth * k4);
  }
};

/// 1/2 |y(x) - target|^2 weighted, plus an effort and a term that mixes state and control.
template <typename Rate>
struct Task
{
  static constexpr int N = Rate::kSize;
  Rate rate;
  Vector4d target{ 0.2, 0.3, -0.1, 0.4 }, weight{ 3.0, 2.0, 0.5, 0.7 };

  template <typename T>
  T operator()(const Eigen::Matrix<T, N, 1>& x) const
  {
    const Eigen::Matrix<T, 4, 1> y = rate.motion(x);
    T sum(0.0);
    for (int i = 0; i < 4; ++i)
      sum += 0.5 * weight(i) * (y(i) - target(i)) * (y(i) - target(i));
    return sum;
  }
  template <typename T>
  T operator()(const Eigen::Matrix<T, N, 1>& x, const Vector2<T>& u, int k) const
  {
    T sum = (*this)(x);
    sum += 0.1 * (1.0 + k) * (u(0) * u(0) + 2.0 * u(1) * u(1) + u(0) * u(1)) + 0.05 * u(1) * x(2) * x(2);
    return sum;
  }
};
}  // namespace autodiff_plants
