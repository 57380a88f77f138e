#pragma once
// What bench_scenes.cpp measures and what its peer (scripts/bench/peer_crocoddyl_cpp.cpp) solves: one definition, so
// that it is one problem. Sources of noise: goal, obstacle.
#include <string>
#include <utility>

#include "phri_control/attitude.hpp"
#include "phri_control/lq_problem.hpp"
#include "phri_control/thesis_scenes.hpp"

namespace phri_control_bench
{
using namespace phri_control;

/// A scene with the attitudes to solve it for: risk-sensitive, and the cumulants 2 to 4 of both sources.
template <int N>
struct SceneCase
{
  std::string name;
  OptimalControlProblem<N, 2> problem;
  Eigen::Matrix<double, N, 1> start;
  Attitude risk, cumulants;
};

/// Seeking towards the goal, averse to the obstacle, as figure 4.6 c times `share`: where the noise of the figures (G =
/// I) leaves no policy for the whole attitude, a tenth of it is solved.
template <int N>
SceneCase<N> sceneCase(const std::string& name, OptimalControlProblem<N, 2> problem, const Eigen::VectorXd& start,
                       double share)
{
  const double base = 2.0 * share;
  Eigen::MatrixXd gamma(2, 3);
  double weight = base;
  for (int r = 2; r <= 4; ++r)
  {
    weight *= base / r;  // base^r / r!
    gamma(1, r - 2) = weight;
    gamma(0, r - 2) = r % 2 == 0 ? -weight : weight;  // as theta < 0
  }
  return { name, std::move(problem), start, RiskSensitive{ { -50.0 * share, 4.0 * share } }, CostCumulants{ gamma } };
}

/// visit(SceneCase<N>) for the point mass in its error state (T = 50), figure 4.7 (T = 200), the arm (T = 50), the car
/// (T = 200).
template <typename Visit>
void forEachScene(Visit&& visit)
{
  const PlanarScene point = thesisScene("4.6").scene, driven = thesisScene("4.7").scene, arm = thesisScene("4.9").scene,
                    car = thesisScene("4.10").scene;
  visit(sceneCase<8>("point_mass", errorProblemOf<8, 2>(point), errorStart(point), 1.0));
  visit(sceneCase<12>("figure_4_7", problemOf<12, 2>(driven), driven.start(), 0.1));
  visit(sceneCase<12>("arm", problemOf<12, 2>(arm), arm.start(), 0.1));
  visit(sceneCase<14>("car", problemOf<14, 2>(car), car.start(), 0.1));
}

/// A mass-damper in the plane, [position; velocity] and force, tracking. `full` noise has factors of four columns,
/// force noise of two.
inline LinearQuadraticProblem<4, 2> massDamper(int horizon, int sources, bool full = false)
{
  constexpr double kDt = 0.01;
  LqStage<4, 2> stage = LqStage<4, 2>::zero();
  stage.A.setIdentity();
  stage.A.topRightCorner<2, 2>().diagonal().setConstant(kDt);
  stage.A.bottomRightCorner<2, 2>().diagonal().setConstant(1.0 - kDt);
  stage.B.bottomRows<2>().diagonal().setConstant(kDt);
  stage.Q.diagonal() << 1.0, 1.0, 0.1, 0.1;
  stage.q << -0.1, 0.2, 0.0, 0.0;
  stage.R.diagonal().setConstant(0.01);
  LinearQuadraticProblem<4, 2> problem;
  problem.stages.assign(horizon, stage);
  problem.terminal = LqTerminal<4>::zero();
  problem.terminal.Q = stage.Q;
  for (int s = 0; s < sources; ++s)
  {
    Eigen::MatrixXd factor = 0.1 * stage.B;
    if (full)
      factor = 0.001 * Eigen::MatrixXd::Identity(4, 4);
    problem.noise.push_back(NoiseSource::fromFactor(std::to_string(s), factor));
  }
  return problem;
}
}  // namespace phri_control_bench
