#pragma once
/// A robot among goals and obstacles in the plane, as a value, and the control problem (4.1)-(4.3), (4.38) it poses.
///
/// The state of the problem is the joint state z = [robot, mover 0, mover 1, ...]. The error state (4.4), (4.45) of the
/// thesis is not Markov unless all bodies share one linear dynamics and no term depends on an absolute position (a
/// driven goal, a static obstacle, the arm and the car all break that); where both exist, the gains on the goal and
/// obstacle blocks of z are those on the errors. Noise: one source per mover with a diffusion (in the order of
/// `movers`), the robot's last; the factor is sqrt(dt) G in that body's block.
///
/// With y the outputs of the bodies (benchmark_plants.hpp), per sample
///   h(z, u) = dt (sum_goals 1/2 (y_r - y_g)'Q(y_r - y_g) + sum_obstacles a exp(-1/2 (p_r - p_o)'Q(p_r - p_o))
///                 + static goals(y_r) + static obstacles(p_r) + 1/2 u'Ru)
/// and at the end the goals alone, not times dt. Gradients and Hessians are exact, obstacles' indefinite ones too.
///
/// Validity: the solvers see the obstacle to second order. That says little once it has diffused further than its own
/// width: see `obstacleSpread`.

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "phri_control/benchmark_plants.hpp"
#include "phri_control/optimal_control_problem.hpp"
#include "phri_control/uncertain_costs.hpp"

namespace phri_control
{
/// A goal or an obstacle that moves by itself: dx = f(x, 0) dt + G dB.
struct Mover
{
  std::string name;
  std::shared_ptr<const Plant> plant;
  Eigen::VectorXd start;
  Eigen::MatrixXd diffusion;  ///< G (n, p) [state / s^1/2]; empty: it moves as predicted, no source of noise
};

struct TrackedGoal
{
  std::size_t mover = 0;
  Eigen::Matrix4d weight;  ///< on [position; velocity] [1/m^2; s^2/m^2], symmetric positive semi-definite
};

struct AvoidedObstacle
{
  std::size_t mover = 0;
  Eigen::Matrix2d weight;  ///< on the position [1/m^2]
  double amplitude = 0.0;
};

/// Of size 2 (position) or 4 (position and velocity).
struct StaticGoal
{
  UncertainGoal belief;
  double theta = 0.0;  ///< attitude to its uncertainty: its theta^-1 log E exp(theta h) is the cost
};

/// Of size 2.
struct StaticObstacle
{
  UncertainObstacle belief;
  std::vector<double> gamma;  ///< weights of its cumulants from the second on; empty: its expected cost
};

struct PlanarScene
{
  std::string name;
  std::shared_ptr<const Plant> robot;
  Eigen::VectorXd robot_start;
  Eigen::MatrixXd robot_diffusion;  ///< as a mover's
  std::vector<Mover> movers;
  std::vector<TrackedGoal> goals;
  std::vector<AvoidedObstacle> obstacles;
  std::vector<StaticGoal> static_goals;
  std::vector<StaticObstacle> static_obstacles;
  Eigen::Matrix2d control_weight = Eigen::Matrix2d::Identity();  ///< R > 0 [1/N^2]
  double dt = 0.01;                                              ///< [s]
  int horizon = 50;                                              ///< number of controls
  Integrator integrator = Integrator::Euler;

  /// Size of z.
  Eigen::Index stateSize() const;
  /// z at the start.
  Eigen::VectorXd start() const;
  /// Where a mover's block begins in z.
  Eigen::Index offset(std::size_t mover) const;
};

/// Throws std::invalid_argument naming the field, its value and what was expected.
void validate(const PlanarScene& scene);

/// The control problem of a scene: shapes, derivatives and noise as in optimal_control_problem.hpp. Sizes known at
/// compile time (<8, 2> robot and goal, <12, 2> also an obstacle, <14, 2> the car's) solve several times faster and
/// must be those of the scene. Throws as `validate`, and RiskBreakdown if a static goal's theta is beyond its limit.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
OptimalControlProblem<N, M> problemOf(const PlanarScene& scene);

extern template OptimalControlProblem<> problemOf(const PlanarScene&);
extern template OptimalControlProblem<8, 2> problemOf(const PlanarScene&);
extern template OptimalControlProblem<12, 2> problemOf(const PlanarScene&);
extern template OptimalControlProblem<14, 2> problemOf(const PlanarScene&);

/// The same in the error state (4.4), (4.45), xi = [x_mover - x_robot, ...] in the order of the movers, for scenes
/// where that is Markov: undriven point masses of equal mass and damping, no static goals or obstacles. Throws
/// std::invalid_argument otherwise. N: 4 or 8 (one or two movers), or Eigen::Dynamic.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
OptimalControlProblem<N, M> errorProblemOf(const PlanarScene& scene);

extern template OptimalControlProblem<> errorProblemOf(const PlanarScene&);
extern template OptimalControlProblem<4, 2> errorProblemOf(const PlanarScene&);
extern template OptimalControlProblem<8, 2> errorProblemOf(const PlanarScene&);

/// The error state at the start.
Eigen::VectorXd errorStart(const PlanarScene& scene);

/// Spread sqrt(tr Sigma_position) of a mover's position after the horizon, over the width 1/sqrt(lam_max(Q)) of the
/// obstacle it is; linearised about its undisturbed motion. Above about 1 the quadratic model of the obstacle's cost,
/// and every criterion computed from it, is not to be believed (figure 4.5 with G = I: 14.5).
double obstacleSpread(const PlanarScene& scene, const AvoidedObstacle& obstacle);
}  // namespace phri_control
