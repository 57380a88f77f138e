#include "phri_control/thesis_scenes.hpp"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
using Eigen::MatrixXd;

// Section 4.6.2: M = I kg, D = I Ns/m, R = 1e-2 I, Q_g = diag(1 1 0.1 0.1), Delta = 1e-2 s; Q_o = 200 I, w = 0.1
constexpr double kObstacleWeight = 200.0, kAmplitude = 0.1;
// Section 4.6.2, static obstacles: Q = I, w = 0.1
constexpr double kStaticWeight = 1.0;
// thetas of the author's published scripts; the thesis prints none
constexpr double kAverseTheta = 4.0, kSeekingTheta = -50.0;

const char* const kThetaAssumed = "theta of the risk-sensitive panels: 4 (averse) and -50 (seeking)";
const char* const kWeightsAssumed =
    "weights of the cumulants from the captions' gamma: +-gamma^r / r! for kappa_r alone";
const char* const kPairWeightsAssumed =
    "weights of the variances from the captions' gamma: -gamma_n^2 (goal), +gamma_p^2 (obstacle)";
const char* const kTerminalAssumed = "final cost: the goal's, weighted as the running one";

Eigen::VectorXd vector(std::initializer_list<double> values)
{
  return Eigen::Map<const Eigen::VectorXd>(values.begin(), static_cast<Eigen::Index>(values.size()));
}

PlanarScene pointMasses(const std::string& figure)
{
  PlanarScene scene;
  scene.name = "figure " + figure;
  scene.robot = std::make_shared<PointMass>();
  scene.robot_start = Eigen::VectorXd::Zero(4);
  scene.control_weight = 1e-2 * Eigen::Matrix2d::Identity();
  scene.dt = 1e-2;
  scene.horizon = 50;
  return scene;
}

void addGoal(PlanarScene& scene, std::shared_ptr<const Plant> plant, Eigen::VectorXd start, MatrixXd diffusion,
             const Eigen::Vector4d& weight = { 1.0, 1.0, 0.1, 0.1 })
{
  scene.goals.push_back({ scene.movers.size(), weight.asDiagonal() });
  scene.movers.push_back({ "goal", std::move(plant), std::move(start), std::move(diffusion) });
}

void addObstacle(PlanarScene& scene, std::shared_ptr<const Plant> plant, Eigen::VectorXd start, MatrixXd diffusion)
{
  scene.obstacles.push_back({ scene.movers.size(), kObstacleWeight * Eigen::Matrix2d::Identity(), kAmplitude });
  scene.movers.push_back({ "obstacle", std::move(plant), std::move(start), std::move(diffusion) });
}

void addStatic(PlanarScene& scene, double x, double y, double variance)
{
  const Eigen::Matrix2d unit = Eigen::Matrix2d::Identity();
  scene.static_obstacles.push_back(
      { UncertainObstacle(Eigen::Vector2d(x, y), variance * unit, kStaticWeight * unit, kAmplitude), {} });
}

Attitude expected(Eigen::Index sources)
{
  return CostCumulants{ MatrixXd(sources, 0) };
}

/// gamma_r kappa_r alone, one source.
Attitude single(int r, double gamma)
{
  CostCumulants attitude{ MatrixXd::Zero(1, r - 1) };
  attitude.gamma(0, r - 2) = std::copysign(std::pow(std::abs(gamma), r) / std::tgamma(r + 1.0), gamma);
  return attitude;
}

/// The variances of two sources, goal and obstacle.
Attitude seekingAverse(double gamma_n, double gamma_p)
{
  return CostCumulants{ (MatrixXd(2, 1) << -gamma_n * gamma_n, gamma_p * gamma_p).finished() };
}

/// The nine panels of figures 4.4 and 4.5.
std::vector<FigurePanel> ninePanels(double gamma_n, double gamma_p)
{
  return { { "a", "expected cost", expected(1) },
           { "b", "seeking, second cumulant", single(2, -gamma_n) },
           { "c", "seeking, third cumulant", single(3, -gamma_n) },
           { "d", "seeking, fourth cumulant", single(4, -gamma_n) },
           { "e", "risk-sensitive, seeking", RiskSensitive{ { kSeekingTheta } } },
           { "f", "averse, second cumulant", single(2, gamma_p) },
           { "g", "averse, third cumulant", single(3, gamma_p) },
           { "h", "averse, fourth cumulant", single(4, gamma_p) },
           { "i", "risk-sensitive, averse", RiskSensitive{ { kAverseTheta } } } };
}

std::vector<FigurePanel> neutralAndPair(double gamma_n, double gamma_p)
{
  return { { "a", "expected cost", expected(2) },
           { "b", "mean-variance, goal seeking and obstacle averse", seekingAverse(gamma_n, gamma_p) } };
}

ThesisScene figure4()
{
  PlanarScene scene = pointMasses("4.4");
  addGoal(scene, std::make_shared<PointMass>(), vector({ 0.1, 0.1, 1.0, -0.5 }), MatrixXd::Identity(4, 4));
  return { "4.4", scene, ninePanels(2.0, 7.0), { kWeightsAssumed, kThetaAssumed, kTerminalAssumed } };
}

/// Figures 4.5 (the obstacle's variability alone) and 4.6 (both).
ThesisScene figure5(const std::string& figure, bool both)
{
  PlanarScene scene = pointMasses(figure);
  addGoal(scene, std::make_shared<PointMass>(), vector({ 0.1, 0.1, 1.0, -0.5 }),
          both ? MatrixXd::Identity(4, 4) : MatrixXd());
  addObstacle(scene, std::make_shared<PointMass>(), vector({ 0.15, 0.15, 1.0, -0.5 }), MatrixXd::Identity(4, 4));
  if (!both)
    return { figure, scene, ninePanels(1.9, 3.0), { kWeightsAssumed, kThetaAssumed, kTerminalAssumed } };
  std::vector<FigurePanel> panels = neutralAndPair(3.5, 3.0);
  panels.push_back(
      { "c", "risk-sensitive, goal seeking and obstacle averse", RiskSensitive{ { kSeekingTheta, kAverseTheta } } });
  return { figure, scene, panels, { kPairWeightsAssumed, kThetaAssumed, kTerminalAssumed } };
}

/// Figures 4.7 and, with other infinitesimal variances, 4.8.
ThesisScene figure7(const std::string& figure, double goal_diffusion, double obstacle_diffusion)
{
  PlanarScene scene = pointMasses(figure);
  scene.horizon = 200;
  const Eigen::Vector2d ones = Eigen::Vector2d::Ones();
  addGoal(scene, std::make_shared<PointMass>(ones, ones, DrivingForce{ 2.0 }), vector({ 0.1, 0.1, 1.0, -0.5 }),
          goal_diffusion * MatrixXd::Identity(4, 4));
  addObstacle(scene, std::make_shared<PointMass>(ones, ones, DrivingForce{ 10.0 }), vector({ 0.15, 0.15, 1.0, -0.5 }),
              obstacle_diffusion * MatrixXd::Identity(4, 4));
  addStatic(scene, -0.3, 0.8, 0.1);
  addStatic(scene, -0.6, 0.8, 0.5);
  std::vector<FigurePanel> panels = neutralAndPair(2.0, 4.0);
  std::vector<std::string> assumed = { kPairWeightsAssumed, kTerminalAssumed };
  if (figure != "4.7")
  {
    panels = { { figure.substr(3), panels[1].name, panels[1].attitude } };
    assumed.push_back("gamma_n = 2, gamma_p = 4 and the horizon of 2 s as in figure 4.7");
  }
  return { figure, scene, panels, assumed };
}

ThesisScene figure9()
{
  PlanarScene scene = pointMasses("4.9");
  const auto arm = std::make_shared<TwoLinkArm>(ArmParameters(), ArmInput::WorkspaceForce);
  scene.robot = arm;
  scene.robot_start = arm->stateAt({ 0.3, 0.4, 0.0, 0.0 });
  addGoal(scene, std::make_shared<PointMass>(), vector({ 0.3, 0.4, 0.0, -0.7 }), MatrixXd::Identity(4, 4));
  addObstacle(scene, std::make_shared<PointMass>(), vector({ 0.42, 0.4, 0.3, -0.6 }), MatrixXd::Identity(4, 4));
  addStatic(scene, -0.1, 0.45, 0.3);
  return { "4.9",
           scene,
           neutralAndPair(6.0, 3.0),
           { "horizon of 0.5 s", "infinitesimal variances G = I of goal and obstacle", "elbow with q2 > 0",
             "the control is the force at the end-effector, tau = J'u (\"joint torques in workspace coordinates\")",
             "the goal and the obstacle are not driven (the text calls them passive)", kPairWeightsAssumed,
             kTerminalAssumed } };
}

ThesisScene figure10()
{
  PlanarScene scene = pointMasses("4.10");
  scene.robot = std::make_shared<CarLikeRobot>();
  scene.robot_start = vector({ 0.0, 0.0, 0.0, 0.01, 0.01 });
  scene.horizon = 200;
  scene.control_weight = 1e-5 * Eigen::Matrix2d::Identity();
  addGoal(scene, std::make_shared<CarLikeRobot>(), vector({ 0.01, 0.01, 0.1, 0.4, 0.8 }),
          vector({ 1.0, 1.0, 1.0, 0.0, 0.0 }).asDiagonal(), { 1.0, 1.0, 0.0, 0.0 });
  addObstacle(scene, std::make_shared<PointMass>(), vector({ 0.05, 0.15, 0.2, 0.3 }), MatrixXd::Identity(4, 4));
  addStatic(scene, 0.4, 0.3, 0.1);
  return { "4.10",
           scene,
           neutralAndPair(0.35, 0.35),
           { "Delta = 1e-2 s, Q_o = 200 I, w = 0.1 and the static obstacle's Q = I as in figure 4.7",
             kPairWeightsAssumed, kTerminalAssumed } };
}
}  // namespace

const std::vector<std::string>& thesisSceneNames()
{
  static const std::vector<std::string> names = { "4.4",  "4.5",  "4.6",  "4.7", "4.8a",
                                                  "4.8b", "4.8c", "4.8d", "4.9", "4.10" };
  return names;
}

ThesisScene thesisScene(const std::string& figure)
{
  if (figure == "4.4")
    return figure4();
  if (figure == "4.5" || figure == "4.6")
    return figure5(figure, figure == "4.6");
  if (figure == "4.7")
    return figure7(figure, 1.0, 1.0);
  if (figure == "4.8a")
    return figure7(figure, 0.8, 0.8);
  if (figure == "4.8b")
    return figure7(figure, 0.5, 0.5);
  if (figure == "4.8c")
    return figure7(figure, 0.2, 0.1);
  if (figure == "4.8d")
    return figure7(figure, 0.01, 0.01);
  if (figure == "4.9")
    return figure9();
  if (figure == "4.10")
    return figure10();
  std::string known;
  for (const std::string& name : thesisSceneNames())
    known += (known.empty() ? "" : ", ") + name;
  throw std::invalid_argument("thesisScene: no scene of figure \"" + figure + "\", expected one of " + known);
}
}  // namespace phri_control
