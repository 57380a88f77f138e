// From LQR to risk-averse obstacle avoidance, in four steps. Its twin is risk_averse.py, line for line.
#include <cstdio>

#include "phri_control/iterative_solver.hpp"

using namespace phri_control;
using Eigen::Vector2d;
using Eigen::VectorXd;

const int kHorizon = 40;
const double kDt = 0.05;  // [s]
const Vector2d kGoal(1.0, 0.0), kObstacle(0.5, 0.1);
double bump_height = 0.0;

// 1. A mass of 1 kg with 1 Ns/m of damping in the plane: x = [position; velocity], u = force [N].
struct Mass : Dynamics<>
{
  Eigen::Index stateSize() const override { return 4; }
  Eigen::Index controlSize() const override { return 2; }
  void step(int, const VectorXd& x, const VectorXd& u, VectorXd& next) const override
  {
    next.head(2) = x.head(2) + kDt * x.tail(2);
    next.tail(2) = x.tail(2) + kDt * (u - x.tail(2));
  }
};

// 2. It walks to the goal and pays for coming near the obstacle. Derivatives are not given: central differences.
struct Walk : CostFunction<>
{
  double running(int, const VectorXd& x, const VectorXd& u) const override
  {
    const double bump = bump_height * std::exp(-0.5 * (x.head(2) - kObstacle).squaredNorm() / 0.09);
    return kDt * (0.5 * (x.head(2) - kGoal).squaredNorm() + 0.005 * u.squaredNorm() + bump);
  }
  double terminal(const VectorXd& x) const override
  {
    return 2.0 * (x.head(2) - kGoal).squaredNorm() + 0.2 * x.tail(2).squaredNorm();
  }
};

void show(const char* name, const IterativeResult<>& result)
{
  double nearest = 1e9;
  for (const VectorXd& x : result.nominal.states)
    nearest = std::min(nearest, (x.head(2) - kObstacle).norm());
  std::printf("%-12s %-10s share %.2f  cost %.4f  criterion %.4f  nearest %.4f m  gain %.2f N/m\n", name,
              toString(result.status), result.share, result.nominal.cost, result.criterion, nearest,
              result.policy.gains[0](0, 0));
}

int main()
{
  // 3. Every step moves the position by 2 cm (standard deviation) at random.
  OptimalControlProblem<> problem;
  problem.dynamics = std::make_shared<Mass>();
  problem.cost = std::make_shared<Walk>();
  problem.horizon = kHorizon;
  problem.noise = { NoiseModel<>::constant("position", 0.02 * Eigen::MatrixXd::Identity(4, 2)) };
  const VectorXd x0 = VectorXd::Zero(4);

  // 4. Without the obstacle this is LQR. With it, theta > 0 makes the walker averse to a spread of the cost, theta < 0
  //    fond of it. Past a limit there is no policy: the solver says so and falls back to what exists.
  show("LQR", solveIterative(problem, x0, RiskSensitive{ { 0.0 } }));
  bump_height = 0.3;
  show("neutral", solveIterative(problem, x0, RiskSensitive{ { 0.0 } }));
  show("averse", solveIterative(problem, x0, RiskSensitive{ { 100.0 } }));
  show("seeking", solveIterative(problem, x0, RiskSensitive{ { -50.0 } }));
  show("mean-var.", solveIterative(problem, x0, CostCumulants{ Eigen::MatrixXd::Constant(1, 1, 50.0) }));
  show("too averse", solveIterative(problem, x0, RiskSensitive{ { 1000.0 } }));
  return 0;
}
