#pragma once
/// The costs between the robot and one moving body, shared by the joint state and the error state.

#include <Eigen/Core>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "phri_control/planar_scene.hpp"

namespace phri_control
{
namespace detail
{
/// All costs of one moving goal or obstacle as functions of e = y_robot - y_mover; all are even in e.
struct PairCost
{
  Eigen::Matrix4d goal = Eigen::Matrix4d::Zero();  ///< sum of the goal weights
  std::vector<std::pair<Eigen::Matrix2d, double>> bumps;

  double value(const Eigen::Vector4d& e, bool with_obstacles) const
  {
    double sum = 0.5 * e.dot(goal * e);
    if (with_obstacles)
      for (const auto& [weight, amplitude] : bumps)
        sum += amplitude * std::exp(-0.5 * e.head<2>().dot(weight * e.head<2>()));
    return sum;
  }
  double expand(const Eigen::Vector4d& e, bool with_obstacles, Eigen::Vector4d& gradient,
                Eigen::Matrix4d& hessian) const
  {
    gradient = goal * e;
    hessian = goal;
    double sum = 0.5 * e.dot(gradient);
    if (with_obstacles)
      for (const auto& [weight, amplitude] : bumps)
      {
        const Eigen::Vector2d slope = weight * e.head<2>();
        const double h = amplitude * std::exp(-0.5 * e.head<2>().dot(slope));
        gradient.head<2>() -= h * slope;
        hessian.topLeftCorner<2, 2>() += h * (slope * slope.transpose() - weight);
        sum += h;
      }
    return sum;
  }
};

inline std::vector<PairCost> pairCosts(const PlanarScene& scene)
{
  std::vector<PairCost> pairs(scene.movers.size());
  for (const TrackedGoal& goal : scene.goals)
    pairs[goal.mover].goal += goal.weight;
  for (const AvoidedObstacle& obstacle : scene.obstacles)
    pairs[obstacle.mover].bumps.emplace_back(obstacle.weight, obstacle.amplitude);
  return pairs;
}

/// Running cost dt (state cost + 1/2 u'R u) and terminal cost of a scene. `Derived` has
///   double stateValue(state, running) const, double expandState(state, running, gradient, hessian) const.
template <typename Derived, int N, int M>
class SceneCost : public CostFunction<N, M>
{
public:
  using typename CostFunction<N, M>::State;
  using typename CostFunction<N, M>::Control;

  explicit SceneCost(const PlanarScene& scene)
    : pairs_(pairCosts(scene)), control_weight_(scene.control_weight), dt_(scene.dt)
  {
  }
  double running(int, const State& x, const Control& u) const override
  {
    return dt_ * (derived().stateValue(x, true) + 0.5 * u.dot(control_weight_ * u));
  }
  double terminal(const State& x) const override { return derived().stateValue(x, false); }
  void expand(int, const State& x, const Control& u, CostExpansion<N, M>& out) const override
  {
    out.q0 = dt_ * (derived().expandState(x, true, out.q, out.Q) + 0.5 * u.dot(control_weight_ * u));
    out.q *= dt_;
    out.Q *= dt_;
    out.r = dt_ * (control_weight_ * u);
    out.R = dt_ * control_weight_;
    out.S.setZero();
    out.has_cross = false;
  }
  void expandTerminal(const State& x, LqTerminal<N>& out) const override
  {
    out.q0 = derived().expandState(x, false, out.q, out.Q);
  }

protected:
  std::vector<PairCost> pairs_;

private:
  const Derived& derived() const { return static_cast<const Derived&>(*this); }
  Eigen::Matrix2d control_weight_;
  double dt_;
};

template <int N, int M>
void requireSize(const PlanarScene& scene, Eigen::Index size)
{
  if ((N != Eigen::Dynamic && N != size) || (M != Eigen::Dynamic && M != 2))
    throw std::invalid_argument("scene \"" + scene.name + "\" has " + std::to_string(size) +
                                " states and 2 controls, asked for as " + std::to_string(N) + " and " +
                                std::to_string(M));
}
}  // namespace detail
}  // namespace phri_control
