#pragma once
/// Monte Carlo of a policy: what it costs in the true problem, not in the quadratic approximation it was computed from.
/// A roll-out starts at the nominal's first state and follows
///
///   u_k = u_nominal,k + L_k (x_k - x_nominal,k), inside the limits,   x_{k+1} = f(k, x_k, u_k) + sum_s F_s n_{s,k}
///
/// with f and the cost as they are and F_s taken at (k, x_k, u_k). The l of the policy is not used: it is what is left
/// of the solver's last step, zero at a solution.
///
/// Things that stand still at an uncertain place (`StaticGoal`, `StaticObstacle`) are somewhere in the real world:
/// their centres are drawn once per roll-out, and `costs` counts the distance to those. `model_costs` are of the same
/// motion with the closed forms that the problem itself has in their place. They contain the attitude to the place
/// (theta, gamma); where it is neutral, both have one expectation. Without such things both are the same numbers.
///
/// Random numbers: roll-out i draws source s from a stream of its own, made of (seed, s, i), and the centres from
/// another. Hence the first roll-outs do not depend on `count`, all policies meet the same noise and the same centres
/// (compare them in pairs), and a source alone acts as it does among the others.
///
/// Collision: at some sample k = 0 .. T, the starting one included, the robot is within the width of an obstacle,
/// (p_r - p_o)'Q(p_r - p_o) < 1 with Q the weight of that obstacle's cost. The obstacle's body has no other size; a
/// soft one (a static obstacle with Q = I: 1 m) is entered by most roll-outs, so look at the obstacles one by one.
///
/// Nothing is allocated per roll-out or per sample, if the functions of the problem do not. What diverges costs an
/// infinity or a NaN, which is passed on.

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "phri_control/lq_approximation.hpp"
#include "phri_control/optimal_control_problem.hpp"
#include "phri_control/planar_scene.hpp"
#include "phri_core/check.hpp"
#include "phri_core/random.hpp"

namespace phri_control
{
struct RollOutOptions
{
  int count = 10000;
  std::uint64_t seed = 1;
  int source = -1;  ///< index of the only source of noise that acts; -1: all of them. Centres are drawn either way
};

/// One element or row per roll-out.
struct RollOuts
{
  Eigen::VectorXd costs;        ///< J, static things at the places drawn
  Eigen::VectorXd model_costs;  ///< J of the problem's own cost
  Eigen::MatrixXd distances;  ///< (count, obstacles) smallest sqrt((p_r - p_o)'Q(p_r - p_o)); moving ones, then static

  /// Smallest distance to any obstacle; infinite without obstacles.
  Eigen::VectorXd clearance() const;
  /// clearance < 1.
  Eigen::Array<bool, Eigen::Dynamic, 1> collided() const;
};

namespace detail
{
/// What a scene knows beyond its problem: where its obstacles are, and where static things may really be.
class SceneWorld
{
public:
  explicit SceneWorld(const PlanarScene& scene);
  Eigen::Index obstacleCount() const { return static_cast<Eigen::Index>(moving_.size() + obstacles_.size()); }
  /// Draws the places of all static things.
  void draw(phri_core::Random random);
  /// What the state costs at these places beyond the problem's own cost. Lowers the squared distances (obstacleCount).
  double excess(const Eigen::Ref<const Eigen::VectorXd>& z, bool running, double* squares) const;

private:
  struct Moving
  {
    std::shared_ptr<const Plant> plant;
    Eigen::Index offset = 0;
    Eigen::Matrix2d weight;
  };
  /// Centre ~ N(mean, root root').
  struct Place
  {
    CostVector mean, centre;
    CostMatrix root, weight;
    void draw(phri_core::Random& random);
    double square(const Eigen::Vector4d& y) const;
  };
  struct Goal : Place
  {
    Quadratic closed_form;
  };
  struct Obstacle : Place
  {
    double amplitude = 0.0;
    std::vector<Bump> closed_form;
  };

  std::shared_ptr<const Plant> robot_;
  std::vector<Moving> moving_;
  std::vector<Goal> goals_;
  std::vector<Obstacle> obstacles_;
  double dt_;
};

/// Throws std::invalid_argument naming what does not fit.
void requireRollOut(const RollOutOptions& options, std::size_t sources);

template <int N, int M>
void requirePolicy(const OptimalControlProblem<N, M>& problem, const Trajectory<N, M>& nominal,
                   const LqPolicy<N, M>& policy)
{
  const std::size_t horizon = problem.horizon;
  const Eigen::Index n = problem.stateSize(), m = problem.controlSize();
  const auto require_count = [](const char* name, std::size_t count, std::size_t expected) {
    if (count != expected)
      throw std::invalid_argument("rollOuts: " + std::to_string(count) + " " + name + ", expected " +
                                  std::to_string(expected));
  };
  require_count("nominal states", nominal.states.size(), horizon + 1);
  require_count("nominal controls", nominal.controls.size(), horizon);
  require_count("gains", policy.gains.size(), horizon);
  const auto require = [](const std::string& name, const Eigen::Ref<const Eigen::MatrixXd>& value, Eigen::Index rows,
                          Eigen::Index cols) {
    phri_core::requireShape(name, value, rows, cols);
    phri_core::requireFinite(name, value);
  };
  for (std::size_t k = 0; k <= horizon; ++k)
  {
    const std::string stage = " of stage " + std::to_string(k);
    require("rollOuts: nominal state" + stage, nominal.states[k], n, 1);
    if (k == horizon)
      break;
    require("rollOuts: nominal control" + stage, nominal.controls[k], m, 1);
    require("rollOuts: gain" + stage, policy.gains[k], m, n);
  }
}

/// `world` may be null.
template <int N, int M>
RollOuts rollOuts(const OptimalControlProblem<N, M>& problem, const Trajectory<N, M>& nominal,
                  const LqPolicy<N, M>& policy, const RollOutOptions& options, SceneWorld* world)
{
  validate(problem);
  requirePolicy(problem, nominal, policy);
  requireRollOut(options, problem.noise.size());
  struct Active
  {
    const NoiseModel<N, M>* model;
    std::string stream;
    Eigen::MatrixXd factor;
    Eigen::VectorXd normals;
    phri_core::Random random{ 0 };
  };
  std::vector<Active> sources;
  for (int s = 0; s < static_cast<int>(problem.noise.size()); ++s)
    if (const NoiseModel<N, M>& model = problem.noise[s]; options.source < 0 || options.source == s)
      sources.push_back({ &model, "noise of source " + std::to_string(s),
                          Eigen::MatrixXd(problem.stateSize(), model.width), Eigen::VectorXd(model.width) });

  RollOuts result;
  result.costs.resize(options.count);
  result.model_costs.resize(options.count);
  result.distances.resize(options.count, world ? world->obstacleCount() : 0);
  std::vector<double> squares(result.distances.cols());
  Eigen::Matrix<double, N, 1> x = nominal.states[0], next = x, deviation = x;
  Eigen::Matrix<double, M, 1> u = nominal.controls[0];
  for (int i = 0; i < options.count; ++i)
  {
    for (Active& source : sources)
      source.random = phri_core::Random::stream(options.seed, source.stream, i);
    if (world)
      world->draw(phri_core::Random::stream(options.seed, "places of static things", i));
    std::fill(squares.begin(), squares.end(), std::numeric_limits<double>::infinity());
    double cost = 0.0, excess = 0.0;
    x = nominal.states[0];
    for (int k = 0; k < problem.horizon; ++k)
    {
      deviation = x - nominal.states[k];
      u = nominal.controls[k];
      u.noalias() += policy.gains[k].lazyProduct(deviation);
      clampControl(problem, u);
      cost += problem.cost->running(k, x, u);
      if (world)
        excess += world->excess(x, true, squares.data());
      problem.dynamics->step(k, x, u, next);
      for (Active& source : sources)
      {
        source.model->factor(k, x, u, source.factor);
        for (double& normal : source.normals)
          normal = source.random.normal();
        next.noalias() += source.factor.lazyProduct(source.normals);
      }
      x.swap(next);
    }
    cost += problem.cost->terminal(x);
    if (world)
      excess += world->excess(x, false, squares.data());
    result.model_costs(i) = cost;
    result.costs(i) = cost + excess;
    for (Eigen::Index j = 0; j < result.distances.cols(); ++j)
      result.distances(i, j) = std::sqrt(squares[j]);
  }
  return result;
}
}  // namespace detail

/// Of a problem that is no scene: no distances, costs = model_costs. Throws std::invalid_argument for a policy that
/// does not fit the problem, a count below 1 or a source that is not there.
template <int N, int M>
RollOuts rollOuts(const OptimalControlProblem<N, M>& problem, const Trajectory<N, M>& nominal,
                  const LqPolicy<N, M>& policy, const RollOutOptions& options = {})
{
  return detail::rollOuts<N, M>(problem, nominal, policy, options, nullptr);
}

/// Of a scene in its joint state (`problemOf`, whose sizes N and M may be); throws as the one above and as `problemOf`.
template <int N, int M>
RollOuts rollOuts(const PlanarScene& scene, const Trajectory<N, M>& nominal, const LqPolicy<N, M>& policy,
                  const RollOutOptions& options = {})
{
  const OptimalControlProblem<N, M> problem = problemOf<N, M>(scene);
  detail::SceneWorld world(scene);
  return detail::rollOuts<N, M>(problem, nominal, policy, options, &world);
}
}  // namespace phri_control
