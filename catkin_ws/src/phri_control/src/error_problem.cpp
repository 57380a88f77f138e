#include <cmath>

#include "pair_cost.hpp"

namespace phri_control
{
namespace
{
template <int N, int M>
class ErrorDynamics : public Dynamics<N, M>
{
public:
  using typename Dynamics<N, M>::State;
  using typename Dynamics<N, M>::Control;
  using typename Dynamics<N, M>::StateMatrix;
  using typename Dynamics<N, M>::InputMatrix;

  explicit ErrorDynamics(const PlanarScene& scene)
  {
    PlantMatrix block;
    PlantInput input;
    phri_control::linearise(*scene.robot, scene.integrator, scene.dt, PlantState::Zero(4), Eigen::Vector2d::Zero(),
                            block, input);
    const Eigen::Index n = 4 * static_cast<Eigen::Index>(scene.movers.size());
    A_.setZero(n, n);
    B_.setZero(n, 2);
    for (Eigen::Index i = 0; i < n; i += 4)
    {
      A_.block(i, i, 4, 4) = block;
      B_.middleRows(i, 4) = -input;
    }
  }
  Eigen::Index stateSize() const override { return A_.rows(); }
  Eigen::Index controlSize() const override { return 2; }
  void step(int, const State& x, const Control& u, State& next) const override
  {
    next = A_.lazyProduct(x) + B_.lazyProduct(u);
  }
  void linearise(int, const State&, const Control&, StateMatrix& A, InputMatrix& B) const override
  {
    A = A_;
    B = B_;
  }

private:
  StateMatrix A_;
  InputMatrix B_;
};

template <int N, int M>
class ErrorCost : public detail::SceneCost<ErrorCost<N, M>, N, M>
{
public:
  using typename CostFunction<N, M>::State;
  using detail::SceneCost<ErrorCost<N, M>, N, M>::SceneCost;

private:
  friend detail::SceneCost<ErrorCost<N, M>, N, M>;
  using detail::SceneCost<ErrorCost<N, M>, N, M>::pairs_;

  double stateValue(const State& x, bool running) const
  {
    double sum = 0.0;
    for (std::size_t i = 0; i < pairs_.size(); ++i)
      sum += pairs_[i].value(x.template segment<4>(4 * i), running);
    return sum;
  }
  template <typename Gradient, typename Hessian>
  double expandState(const State& x, bool running, Gradient& gradient, Hessian& hessian) const
  {
    Eigen::Vector4d slope;
    Eigen::Matrix4d curvature;
    double sum = 0.0;
    hessian.setZero();
    for (std::size_t i = 0; i < pairs_.size(); ++i)
    {
      sum += pairs_[i].expand(x.template segment<4>(4 * i), running, slope, curvature);
      gradient.template segment<4>(4 * i) = slope;
      hessian.template block<4, 4>(4 * i, 4 * i) = curvature;
    }
    return sum;
  }
};

[[noreturn]] void notMarkov(const PlanarScene& scene, const std::string& why)
{
  throw std::invalid_argument("scene \"" + scene.name + "\" has no error state of its own: " + why +
                              "; use the joint state (problemOf)");
}

void requireErrorState(const PlanarScene& scene)
{
  const auto* robot = dynamic_cast<const PointMass*>(scene.robot.get());
  if (!robot || robot->drive())
    notMarkov(scene, "the robot is not an undriven point mass");
  if (scene.movers.empty())
    notMarkov(scene, "nothing moves");
  for (const Mover& mover : scene.movers)
  {
    const auto* plant = dynamic_cast<const PointMass*>(mover.plant.get());
    if (!plant || plant->drive() || plant->mass() != robot->mass() || plant->damping() != robot->damping())
      notMarkov(scene, "mover \"" + mover.name + "\" is not an undriven point mass with the robot's mass and damping");
  }
  if (!scene.static_goals.empty() || !scene.static_obstacles.empty())
    notMarkov(scene, "it has static goals or obstacles");
}
}  // namespace

Eigen::VectorXd errorStart(const PlanarScene& scene)
{
  validate(scene);
  requireErrorState(scene);
  Eigen::VectorXd xi(4 * scene.movers.size());
  for (std::size_t i = 0; i < scene.movers.size(); ++i)
    xi.segment<4>(4 * i) = scene.movers[i].start - scene.robot_start;
  return xi;
}

template <int N, int M>
OptimalControlProblem<N, M> errorProblemOf(const PlanarScene& scene)
{
  const Eigen::Index n = errorStart(scene).size();
  detail::requireSize<N, M>(scene, n);
  OptimalControlProblem<N, M> problem;
  problem.dynamics = std::make_shared<ErrorDynamics<N, M>>(scene);
  problem.cost = std::make_shared<ErrorCost<N, M>>(scene);
  problem.horizon = scene.horizon;
  problem.dt = scene.dt;
  for (std::size_t i = 0; i < scene.movers.size(); ++i)
    if (const Eigen::MatrixXd& diffusion = scene.movers[i].diffusion; diffusion.cols() > 0)
    {
      Eigen::MatrixXd factor = Eigen::MatrixXd::Zero(n, diffusion.cols());
      factor.middleRows(4 * i, 4) = std::sqrt(scene.dt) * diffusion;
      problem.noise.push_back(NoiseModel<N, M>::constant(scene.movers[i].name, factor));
    }
  if (scene.robot_diffusion.cols() > 0)
    problem.noise.push_back(NoiseModel<N, M>::constant(
        "robot", -std::sqrt(scene.dt) * scene.robot_diffusion.replicate(static_cast<Eigen::Index>(n / 4), 1)));
  return problem;
}

template OptimalControlProblem<> errorProblemOf(const PlanarScene&);
template OptimalControlProblem<4, 2> errorProblemOf(const PlanarScene&);
template OptimalControlProblem<8, 2> errorProblemOf(const PlanarScene&);
}  // namespace phri_control
