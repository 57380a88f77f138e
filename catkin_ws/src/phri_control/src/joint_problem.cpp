#include "phri_control/planar_scene.hpp"

#include <cmath>

#include "pair_cost.hpp"

namespace phri_control
{
namespace
{
using detail::PairCost;

/// One body's block of z.
struct Body
{
  std::shared_ptr<const Plant> plant;
  Eigen::Index offset = 0, size = 0;
};

std::vector<Body> bodiesOf(const PlanarScene& scene)
{
  std::vector<Body> bodies{ { scene.robot, 0, scene.robot->stateSize() } };
  for (const Mover& mover : scene.movers)
    bodies.push_back({ mover.plant, bodies.back().offset + bodies.back().size, mover.plant->stateSize() });
  return bodies;
}

template <int N, int M>
class JointDynamics : public Dynamics<N, M>
{
public:
  using typename Dynamics<N, M>::State;
  using typename Dynamics<N, M>::Control;
  using typename Dynamics<N, M>::StateMatrix;
  using typename Dynamics<N, M>::InputMatrix;

  explicit JointDynamics(const PlanarScene& scene)
    : bodies_(bodiesOf(scene)), size_(scene.stateSize()), dt_(scene.dt), integrator_(scene.integrator)
  {
  }
  Eigen::Index stateSize() const override { return size_; }
  Eigen::Index controlSize() const override { return 2; }

  void step(int, const State& z, const Control& u, State& next) const override
  {
    Eigen::Vector2d effort = u;
    PlantState x, stepped;
    for (const Body& body : bodies_)
    {
      x = z.segment(body.offset, body.size);
      phri_control::step(*body.plant, integrator_, dt_, x, effort, stepped);
      next.segment(body.offset, body.size) = stepped;
      effort.setZero();  // only the robot, the first body, is driven
    }
  }

  void linearise(int, const State& z, const Control& u, StateMatrix& A, InputMatrix& B) const override
  {
    A.setZero();
    B.setZero();
    Eigen::Vector2d effort = u;
    PlantState x;
    PlantMatrix block;
    PlantInput input;
    for (const Body& body : bodies_)
    {
      x = z.segment(body.offset, body.size);
      phri_control::linearise(*body.plant, integrator_, dt_, x, effort, block, input);
      A.block(body.offset, body.offset, body.size, body.size) = block;
      if (body.offset == 0)
        B.topRows(body.size) = input;
      effort.setZero();
    }
  }

private:
  std::vector<Body> bodies_;
  Eigen::Index size_;
  double dt_;
  Integrator integrator_;
};

template <int N, int M>
class JointCost : public detail::SceneCost<JointCost<N, M>, N, M>
{
public:
  using typename CostFunction<N, M>::State;

  explicit JointCost(const PlanarScene& scene)
    : detail::SceneCost<JointCost<N, M>, N, M>(scene), bodies_(bodiesOf(scene))
  {
    for (const StaticGoal& goal : scene.static_goals)
      goals_.push_back(goal.belief.riskSensitive(goal.theta));
    for (const StaticObstacle& obstacle : scene.static_obstacles)
      for (const Bump& bump : obstacle.belief.cumulants(obstacle.gamma))
        bumps_.push_back(bump);
  }

private:
  friend detail::SceneCost<JointCost<N, M>, N, M>;
  using detail::SceneCost<JointCost<N, M>, N, M>::pairs_;

  Eigen::Vector4d motionOf(const Body& body, const State& z) const
  {
    const PlantState x = z.segment(body.offset, body.size);
    return body.plant->motion(x);
  }

  double stateValue(const State& z, bool running) const
  {
    const Eigen::Vector4d robot = motionOf(bodies_[0], z);
    double sum = 0.0;
    for (std::size_t i = 0; i < pairs_.size(); ++i)
      sum += pairs_[i].value(robot - motionOf(bodies_[i + 1], z), running);
    for (const Quadratic& goal : goals_)
      sum += goal.value(robot.head(goal.centre.size()));
    if (running)
      for (const Bump& bump : bumps_)
        sum += bump.value(robot.head<2>());
    return sum;
  }

  /// Value, gradient and Hessian in z: every term in the outputs first, then through each body's output once.
  template <typename Gradient, typename Hessian>
  double expandState(const State& z, bool running, Gradient& gradient, Hessian& hessian) const
  {
    const Body& robot = bodies_[0];
    const PlantState x = z.segment(0, robot.size);
    const Eigen::Vector4d y = robot.plant->motion(x);
    MotionJacobian robot_jacobian, jacobian;
    robot.plant->motionJacobian(x, robot_jacobian);
    Eigen::Vector4d total_gradient = Eigen::Vector4d::Zero(), pair_gradient;
    Eigen::Matrix4d total_hessian = Eigen::Matrix4d::Zero(), pair_hessian;
    double sum = 0.0;
    gradient.setZero();
    hessian.setZero();
    for (std::size_t i = 0; i < pairs_.size(); ++i)
    {
      const Body& body = bodies_[i + 1];
      const PlantState mover = z.segment(body.offset, body.size);
      sum += pairs_[i].expand(y - body.plant->motion(mover), running, pair_gradient, pair_hessian);
      total_gradient += pair_gradient;
      total_hessian += pair_hessian;
      body.plant->motionJacobian(mover, jacobian);
      addBlock(body, mover, jacobian, -pair_gradient, pair_hessian, gradient, hessian);
      auto cross = hessian.block(0, body.offset, robot.size, body.size);
      if (robot.plant->motionIsState() && body.plant->motionIsState())
        cross = -pair_hessian;
      else
        cross = -(robot_jacobian.transpose() * pair_hessian * jacobian);
      hessian.block(body.offset, 0, body.size, robot.size) = cross.transpose();
    }
    sum += addStatic(y, running, total_gradient, total_hessian);
    addBlock(robot, x, robot_jacobian, total_gradient, total_hessian, gradient, hessian);
    return sum;
  }

  double addStatic(const Eigen::Vector4d& y, bool running, Eigen::Vector4d& gradient, Eigen::Matrix4d& hessian) const
  {
    double sum = 0.0;
    CostVector slope;
    CostMatrix curvature;
    const auto add = [&](const auto& term) {
      const Eigen::Index size = term.centre.size();
      slope.setZero(size);
      curvature.setZero(size, size);
      sum += term.expand(y.head(size), slope, curvature);
      gradient.head(size) += slope;
      hessian.topLeftCorner(size, size) += curvature;
    };
    for (const Quadratic& goal : goals_)
      add(goal);
    if (running)
      for (const Bump& bump : bumps_)
        add(bump);
    return sum;
  }

  template <typename Gradient, typename Hessian>
  static void addBlock(const Body& body, const PlantState& x, const MotionJacobian& jacobian,
                       const Eigen::Vector4d& slope, const Eigen::Matrix4d& curvature, Gradient& gradient,
                       Hessian& hessian)
  {
    if (body.plant->motionIsState())
    {
      gradient.segment(body.offset, 4) = slope;
      hessian.block(body.offset, body.offset, 4, 4) = curvature;
      return;
    }
    PlantMatrix block = jacobian.transpose() * curvature * jacobian;
    body.plant->addMotionCurvature(x, slope, block);
    gradient.segment(body.offset, body.size) = jacobian.transpose() * slope;
    hessian.block(body.offset, body.offset, body.size, body.size) = block;
  }

  std::vector<Body> bodies_;
  std::vector<Quadratic> goals_;
  std::vector<Bump> bumps_;
};

}  // namespace

template <int N, int M>
OptimalControlProblem<N, M> problemOf(const PlanarScene& scene)
{
  validate(scene);
  detail::requireSize<N, M>(scene, scene.stateSize());
  OptimalControlProblem<N, M> problem;
  problem.dynamics = std::make_shared<JointDynamics<N, M>>(scene);
  problem.cost = std::make_shared<JointCost<N, M>>(scene);
  problem.horizon = scene.horizon;
  problem.dt = scene.dt;
  const auto add = [&](const std::string& name, const Eigen::MatrixXd& diffusion, Eigen::Index offset) {
    if (diffusion.cols() == 0)
      return;
    Eigen::MatrixXd factor = Eigen::MatrixXd::Zero(scene.stateSize(), diffusion.cols());
    factor.middleRows(offset, diffusion.rows()) = std::sqrt(scene.dt) * diffusion;
    problem.noise.push_back(NoiseModel<N, M>::constant(name, factor));
  };
  for (std::size_t i = 0; i < scene.movers.size(); ++i)
    add(scene.movers[i].name, scene.movers[i].diffusion, scene.offset(i));
  add("robot", scene.robot_diffusion, 0);
  return problem;
}

template OptimalControlProblem<> problemOf(const PlanarScene&);
template OptimalControlProblem<8, 2> problemOf(const PlanarScene&);
template OptimalControlProblem<12, 2> problemOf(const PlanarScene&);
template OptimalControlProblem<14, 2> problemOf(const PlanarScene&);
}  // namespace phri_control
