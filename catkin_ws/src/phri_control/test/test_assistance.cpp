// The assistive controllers of 5.1 and 5.3 against what must hold of them: scaling and rotation of the weights, figures
// that the thesis and the safety analysis state, exact tracking in the limit, and refusal of unusable inputs.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <unsupported/Eigen/MatrixFunctions>

#include "phri_control/assistance.hpp"
#include "phri_control/lq_solver.hpp"

using namespace phri_control;
using phri_core::Observation;
using phri_core::Prediction;
using phri_core::VectorDof;
using phri_core::VectorState;

namespace
{
constexpr double kT0 = 2.0;
const Eigen::MatrixXd kStudyCovariance = Eigen::Vector4d(1e-5, 1e-5, 1e-6, 1e-6).asDiagonal();

using Path = std::function<Eigen::VectorXd(double)>;

Prediction predict(const Path& path, const Eigen::MatrixXd& covariance, double dt = 0.02, int count = 16)
{
  Prediction prediction;
  prediction.t0 = kT0;
  prediction.dt = dt;
  for (int k = 0; k < count; ++k)
    prediction.desired_state.push_back({ path(kT0 + k * dt), covariance });
  return prediction;
}

Eigen::VectorXd wave(double t)
{
  return Eigen::Vector4d(0.1 * std::sin(2 * t), 0.05 * t, 0.2 * std::cos(2 * t), 0.05);
}

Observation observe(const VectorState& state, double t = kT0)
{
  Observation observation;
  observation.t = t;
  observation.state = state;
  observation.human_wrench = VectorDof::Zero(state.size() / 2);
  return observation;
}

const VectorState kRest = VectorState::Zero(4);

FeedbackPolicy planned(const std::string& name, const AssistanceSettings& settings, const Prediction& prediction)
{
  const auto controller = makeAssistance(name, settings);
  const auto policy = controller->plan(observe(VectorState::Zero(2 * settings.mass.size())), prediction);
  EXPECT_TRUE(policy.has_value()) << controller->failure();
  return policy.value_or(FeedbackPolicy());
}

/// (5.36) at 1 kHz for the default settings' object, R = 1, no state weights.
LqStage<4, 2> studyObject()
{
  LqStage<4, 2> stage = LqStage<4, 2>::zero();
  stage.A.setIdentity();
  stage.A.topRightCorner(2, 2).diagonal().setConstant(1e-3);
  stage.A.bottomRightCorner(2, 2).diagonal().setConstant(1.0 - 1e-3 * 200.0 / 90.0);
  stage.B.bottomRows(2).diagonal().setConstant(1e-3 / 90.0);
  stage.R.setIdentity();
  return stage;
}

double largestDifference(const FeedbackPolicy& a, const FeedbackPolicy& b)
{
  double difference = a.stages().size() == b.stages().size() ? 0.0 : 1.0, scale = 0.0;
  for (std::size_t k = 0; k < std::min(a.stages().size(), b.stages().size()); ++k)
  {
    difference = std::max(difference, (a.stages()[k].gain - b.stages()[k].gain).cwiseAbs().maxCoeff());
    scale = std::max(scale, a.stages()[k].gain.cwiseAbs().maxCoeff());
  }
  return difference / scale;
}
}  // namespace

TEST(Assistance, unknownNameIsAnErrorThatHelps)
{
  EXPECT_EQ(assistanceNames(), (std::vector<std::string>{ "none", "lqr", "mahalanobis", "pd" }));
  try
  {
    makeAssistance("mahalanobs", {});
    FAIL() << "no error";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ(error.what(),
                 "unknown assistance controller \"mahalanobs\": expected one of none lqr mahalanobis pd; "
                 "did you mean mahalanobis?");
  }
}

TEST(Assistance, policiesCarryTheirControllersIndex)
{
  for (std::size_t i = 0; i < assistanceNames().size(); ++i)
    EXPECT_EQ(planned(assistanceNames()[i], {}, predict(wave, kStudyCovariance)).source(), static_cast<int>(i));
}

TEST(Assistance, noneIsPassiveWhateverThePrediction)
{
  const auto policy = makeAssistance("none", {})->plan(observe(kRest), Prediction());
  ASSERT_TRUE(policy.has_value());
  VectorDof u;
  EXPECT_TRUE(policy->act(kT0 + 0.1, Eigen::Vector4d(1, 2, 3, 4), u));
  EXPECT_EQ(u, VectorDof::Zero(2));
}

// (5.2), with the mean interpolated linearly between the prediction's own times.
TEST(Assistance, pdPullsTowardsThePredictionAhead)
{
  AssistanceSettings settings;
  settings.pd_lookahead = 0.05;
  const FeedbackPolicy policy = planned("pd", settings, predict(wave, kStudyCovariance));
  const VectorState xi = Eigen::Vector4d(0.02, -0.01, 0.1, 0.3);
  VectorDof u;
  policy.act(kT0 + 0.120, xi, u);
  const Eigen::Vector4d mu = 0.5 * (wave(kT0 + 0.16) + wave(kT0 + 0.18));  // 0.17 s lies between two elements
  EXPECT_LT((u - (200.0 * (mu - xi).head(2) + 90.0 * (mu - xi).tail(2))).norm(), 1e-9);
}

// The safety analysis states 97 kN/m for (b) in the study's setting (M = 90 kg, D = 200 Ns/m, T = 0.2 s, R = 1).
TEST(Assistance, lqrHasTheStudysGain)
{
  const FeedbackPolicy policy = planned("lqr", {}, predict(wave, kStudyCovariance));
  ASSERT_EQ(policy.stages().size(), 200u);
  EXPECT_NEAR(-policy.stages()[0].gain(0, 0), 97e3, 0.5e3);
  for (const auto& stage : policy.stages())
    EXPECT_EQ(stage.feedforward, VectorDof::Zero(2));  // the thesis' law is error feedback only
}

// 1e5 / 1e-5 = 1e10 and 10 / 1e-6 = 1e7: at the study's variances (c) is (b). The floor takes 1 % of the velocity's
// weight.
TEST(Assistance, studyWeightsAgreeAtTheStudysVariances)
{
  const Prediction prediction = predict(wave, kStudyCovariance);
  const FeedbackPolicy lqr = planned("lqr", {}, prediction);
  AssistanceSettings settings;
  EXPECT_LT(largestDifference(lqr, planned("mahalanobis", settings, prediction)), 0.01);
  settings.covariance_floor = 1e-12;
  EXPECT_LT(largestDifference(lqr, planned("mahalanobis", settings, prediction)), 1e-5);
}

// Qhat for covariance c I is Q / (c + floor).
TEST(Assistance, mahalanobisDividesTheWeightsByAnIsotropicVariance)
{
  for (const double c : { 0.0, 1e-6, 1e-4, 1e-2 })
  {
    AssistanceSettings settings;
    settings.lqr = { settings.mahalanobis.position / (c + settings.covariance_floor),
                     settings.mahalanobis.velocity / (c + settings.covariance_floor) };
    const Prediction prediction = predict(wave, c * Eigen::MatrixXd::Identity(4, 4));
    EXPECT_LT(largestDifference(planned("lqr", settings, prediction), planned("mahalanobis", settings, prediction)),
              1e-8)
        << "c = " << c;
  }
}

// (5.29) written out for a covariance that changes along the horizon and couples positions with velocities (where the
// order of the factors matters): roots by Schur's method, linear interpolation between the prediction's times.
TEST(Assistance, mahalanobisFollowsTheCovarianceAlongTheHorizon)
{
  Prediction prediction = predict(wave, kStudyCovariance);
  std::vector<Eigen::Matrix4d> weights;
  for (std::size_t i = 0; i < prediction.desired_state.size(); ++i)
  {
    Eigen::MatrixXd& covariance = prediction.desired_state[i].covariance;
    covariance *= 1.0 + i;
    covariance(0, 2) = covariance(2, 0) = 2e-6;
    covariance(1, 0) = covariance(0, 1) = -4e-6;
    const Eigen::MatrixXd root = (covariance + 1e-8 * Eigen::MatrixXd::Identity(4, 4)).sqrt().inverse();
    weights.push_back(root * Eigen::Vector4d(1e5, 1e5, 10.0, 10.0).asDiagonal() * root);
  }
  LinearQuadraticProblem<4, 2> problem;
  problem.stages.assign(200, studyObject());
  problem.terminal = LqTerminal<4>::zero();
  problem.terminal.Q = weights[10];
  for (int k = 0; k < 200; ++k)
    problem.stages[k].Q = (1.0 - k % 20 / 20.0) * weights[k / 20] + k % 20 / 20.0 * weights[k / 20 + 1];
  const auto solution = solve(problem);
  ASSERT_TRUE(solution.status.ok);
  const FeedbackPolicy policy = planned("mahalanobis", {}, prediction);
  ASSERT_EQ(policy.stages().size(), 200u);
  for (int k = 0; k < 200; ++k)
    EXPECT_LT((policy.stages()[k].gain - solution.gains[k]).norm(), 1e-6 * solution.gains[k].norm()) << "stage " << k;
}

// The object is isotropic, so turning the predicted covariance turns the gains, and the stiff direction is the certain
// one.
TEST(Assistance, gainsTurnWithThePredictedCovariance)
{
  const Eigen::MatrixXd straight = Eigen::Vector4d(1e-6, 1e-4, 1e-6, 1e-5).asDiagonal();
  const Eigen::Matrix2d turn = Eigen::Rotation2Dd(0.6).toRotationMatrix();
  Eigen::MatrixXd turn4 = Eigen::MatrixXd::Zero(4, 4);
  turn4.topLeftCorner(2, 2) = turn4.bottomRightCorner(2, 2) = turn;
  const FeedbackPolicy a = planned("mahalanobis", {}, predict(wave, straight));
  const FeedbackPolicy b = planned("mahalanobis", {}, predict(wave, turn4 * straight * turn4.transpose()));
  for (const std::size_t k : { 0u, 100u, 199u })
  {
    const Eigen::MatrixXd expected = turn * a.stages()[k].gain * turn4.transpose();
    EXPECT_LT((b.stages()[k].gain - expected).norm(), 1e-6 * expected.norm());
  }
  EXPECT_GT(-a.stages()[0].gain(0, 0), 3.0 * -a.stages()[0].gain(1, 1));
}

// A quadratic tracking cost in absolute coordinates has q_k = -Q_k mu_k (equation 9); the controller solves it in the
// deviation from mu. Both must give the same force in every state.
TEST(Assistance, previewSolvesTheAbsoluteTrackingProblem)
{
  AssistanceSettings settings;
  settings.law = "preview";
  settings.lqr = { 1e6, 1e4 };
  const FeedbackPolicy policy = planned("lqr", settings, predict(wave, kStudyCovariance, 0.001, 201));
  LqStage<4, 2> stage = studyObject();
  stage.Q.diagonal() << 1e6, 1e6, 1e4, 1e4;
  LinearQuadraticProblem<4, 2> problem;
  problem.stages.assign(200, stage);
  problem.terminal = LqTerminal<4>::zero();
  for (int k = 0; k < 200; ++k)
    problem.stages[k].q = -stage.Q * wave(kT0 + 1e-3 * k);
  problem.terminal.Q = stage.Q;
  problem.terminal.q = -stage.Q * wave(kT0 + 0.2);
  const auto solution = solve(problem);
  for (const int k : { 0, 57, 199 })
  {
    const Eigen::Vector4d xi(0.01, 0.12, 0.3, -0.1);
    const Eigen::Vector2d expected = solution.gains[k] * xi + solution.feedforward[k];
    VectorDof u;
    policy.act(kT0 + 1e-3 * k, xi, u);
    EXPECT_LT((u - expected).norm(), 1e-6 * (1.0 + expected.norm())) << "stage " << k;
  }
}

// A path that the object can follow under forces u*: with cheap control the preview law follows it with vanishing
// error, in proportion to R, while error feedback must lag behind to produce any force at all.
TEST(Assistance, previewFollowsAReachablePathWithoutLag)
{
  std::vector<Eigen::Vector4d> path{ Eigen::Vector4d(0.05, -0.02, 0.1, 0.0) };
  const auto step = [](const Eigen::Vector4d& xi, const Eigen::Vector2d& u) {
    const Eigen::Vector2d v = xi.tail(2);
    Eigen::Vector4d next;
    next << xi.head(2) + 1e-3 * v, v + 1e-3 / 90.0 * (u - 200.0 * v);
    return next;
  };
  for (int k = 0; k < 200; ++k)
    path.push_back(step(path.back(), Eigen::Vector2d(20.0 * std::sin(0.05 * k), 10.0)));
  const Path reference = [&](double t) { return path[std::lround((t - kT0) / 1e-3)]; };
  const auto worstError = [&](const std::string& law, double control_weight) {
    AssistanceSettings settings;
    settings.law = law;
    settings.control_weight = control_weight;
    const FeedbackPolicy policy = planned("lqr", settings, predict(reference, kStudyCovariance, 0.001, 201));
    Eigen::Vector4d xi = path.front();
    double worst = 0.0;
    for (int k = 0; k < 200; ++k)
    {
      VectorDof u;
      policy.act(kT0 + 1e-3 * k, xi, u);
      xi = step(xi, u);
      worst = std::max(worst, (xi - path[k + 1]).head(2).norm());
    }
    return worst;
  };
  const double cheap = worstError("preview", 1e-4), cheaper = worstError("preview", 1e-5);
  EXPECT_LT(cheaper, 1e-8);  // of a path of 30 mm
  EXPECT_NEAR(cheap / cheaper, 10.0, 0.5);
  EXPECT_GT(worstError("error_feedback", 1e-4), 50.0 * cheap);
}

// A coasting object needs no force: the preview of its own free path is exactly passive.
TEST(Assistance, previewOfAFreePathIsNoForce)
{
  AssistanceSettings settings;
  settings.law = "preview";
  Eigen::Vector4d xi(0.0, 0.0, 0.2, -0.1);
  std::vector<Eigen::VectorXd> path;
  for (int k = 0; k <= 200; ++k)
  {
    path.push_back(xi);
    xi << xi.head(2) + 1e-3 * xi.tail(2), (1.0 - 1e-3 * 200.0 / 90.0) * xi.tail(2);
  }
  const auto free = [&](double t) { return path[std::lround((t - kT0) / 1e-3)]; };
  const FeedbackPolicy policy = planned("lqr", settings, predict(free, kStudyCovariance, 0.001, 201));
  for (const auto& stage : policy.stages())
    EXPECT_LT(stage.feedforward.norm(), 1e-6);  // rounding of mu times a gain of 1e5 N/m
}

// Axes of a diagonal problem do not see each other: three axes through the dynamic path equal two through the fixed
// one.
TEST(Assistance, otherDegreesOfFreedomGiveTheSameGains)
{
  AssistanceSettings spatial;
  spatial.mass = VectorDof::Constant(3, 90.0);
  spatial.damping = VectorDof::Constant(3, 200.0);
  const auto still = [](Eigen::Index n) { return [n](double) { return Eigen::VectorXd(Eigen::VectorXd::Zero(n)); }; };
  for (const char* name : { "lqr", "mahalanobis", "pd" })
  {
    const FeedbackPolicy a = planned(name, {}, predict(still(4), 1e-5 * Eigen::MatrixXd::Identity(4, 4)));
    const FeedbackPolicy b = planned(name, spatial, predict(still(6), 1e-5 * Eigen::MatrixXd::Identity(6, 6)));
    ASSERT_EQ(b.dof(), 3);
    for (const std::size_t k : { 0u, 150u })
    {
      EXPECT_NEAR(b.stages()[k].gain(1, 1), a.stages()[k].gain(1, 1), 1e-9 * std::abs(a.stages()[k].gain(1, 1)));
      EXPECT_NEAR(b.stages()[k].gain(1, 4), a.stages()[k].gain(1, 3), 1e-9 * std::abs(a.stages()[k].gain(1, 3)));
    }
  }
}

// A policy promises nothing beyond the prediction, and a remembered solve is never used for another horizon.
TEST(Assistance, shortPredictionsShortenThePolicy)
{
  const auto controller = makeAssistance("lqr", {});
  const Prediction prediction = predict(wave, kStudyCovariance, 0.02, 8);  // 0.14 s long
  const auto full = controller->plan(observe(kRest), predict(wave, kStudyCovariance));
  const auto brief = controller->plan(observe(kRest, kT0 + 0.02), prediction);
  const auto again = controller->plan(observe(kRest), predict(wave, kStudyCovariance));
  ASSERT_TRUE(full && brief && again);
  EXPECT_EQ(brief->stages().size(), 120u);
  EXPECT_NEAR(brief->horizonEnd(), kT0 + 0.14, 1e-9);
  EXPECT_EQ(largestDifference(*full, *again), 0.0);
  AssistanceSettings settings;
  settings.horizon = 0.12;
  EXPECT_EQ(largestDifference(*brief, planned("lqr", settings, predict(wave, kStudyCovariance))), 0.0);
}

TEST(Assistance, singularCovariancesAreFlooredIndefiniteOnesRefused)
{
  const auto controller = makeAssistance("mahalanobis", {});
  Eigen::MatrixXd singular = kStudyCovariance;
  singular(0, 1) = singular(1, 0) = 1e-5;  // perfectly correlated
  for (const Eigen::MatrixXd& covariance : { singular, Eigen::MatrixXd(Eigen::MatrixXd::Zero(4, 4)) })
  {
    const auto policy = controller->plan(observe(kRest), predict(wave, covariance));
    ASSERT_TRUE(policy.has_value()) << controller->failure();
    for (const auto& stage : policy->stages())
      EXPECT_TRUE(stage.gain.allFinite());
  }
  singular(0, 1) = singular(1, 0) = 2e-5;
  EXPECT_FALSE(controller->plan(observe(kRest), predict(wave, singular)).has_value());
  EXPECT_EQ(controller->failure(), "the covariance of the predicted state 0 is indefinite");
}

TEST(Assistance, unusableInputsGiveNoPolicyAndAReason)
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Prediction good = predict(wave, kStudyCovariance);
  Prediction mean = good, size = good, step = good, variance = good;
  mean.desired_state[5].mean(2) = nan;
  size.desired_state[5].mean.resize(3);
  step.dt = 0.0;
  variance.desired_state[5].covariance(1, 1) = std::numeric_limits<double>::infinity();
  for (const char* name : { "lqr", "mahalanobis", "pd" })
  {
    const auto controller = makeAssistance(name, {});
    for (const Prediction& bad : { mean, size, step, Prediction() })
    {
      EXPECT_FALSE(controller->plan(observe(kRest), bad).has_value());
      EXPECT_NE(controller->failure(), "");
    }
    EXPECT_FALSE(controller->plan(observe(Eigen::Vector4d(0, nan, 0, 0)), good).has_value());
    EXPECT_FALSE(controller->plan(observe(VectorState::Zero(6)), good).has_value());
    EXPECT_FALSE(controller->plan(observe(kRest, kT0 + 0.3), good).has_value());
    EXPECT_EQ(controller->failure(), "nothing of the prediction is left at the time of the observation");
    EXPECT_EQ(controller->plan(observe(kRest), variance).has_value(), std::string(name) != "mahalanobis");
    EXPECT_TRUE(controller->plan(observe(kRest), good).has_value());
    EXPECT_EQ(controller->failure(), "");
  }
}

TEST(Gate, ignoresPredictionsThatStartFarAway)
{
  phri_core::Observation observation;
  observation.state = Eigen::Vector4d(0.1, 0.0, 0.0, 0.0);
  phri_core::Prediction prediction;
  prediction.desired_state.push_back({ Eigen::Vector4d(0.1, 0.015, 5.0, 5.0), Eigen::Matrix4d::Identity() });
  EXPECT_TRUE(phri_control::withinGate(observation, prediction, 0.02)) << "velocities must not count";
  EXPECT_FALSE(phri_control::withinGate(observation, prediction, 0.01));
  EXPECT_TRUE(phri_control::withinGate(observation, prediction, 0.0)) << "0 is no gate";
}
