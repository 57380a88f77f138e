// The contact controller of 5.4: gains against the dense solver and the steady state's closed form, the adaptation
// against its dynamics, the plant's scaling, what it refuses.
#include "phri_control/contact_control.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <functional>

#include "contact_tasks.hpp"
#include "phri_control/lq_solver.hpp"
#include "phri_core/testing.hpp"

namespace phri_control
{
using namespace contact;

TEST(ContactControl, FastPathAllocatesNothing)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "allocations are not counted under this sanitizer";
  ContactController controller("seeking_adapted", settingsOf(3));
  controller.follow(restingTask(3, 1.0, 0.1));
  const VectorDof force = constant(3, 2.0);
  MatrixDof larger;
  const long count = phri_core::testing::countAllocations([&] {
    for (int k = 0; k < 1000; ++k)
      controller.observe(k * 1e-3, force);
    larger = covarianceMax(MatrixDof::Identity(6, 6), MatrixDof::Constant(6, 6, 1.0));
  });
  EXPECT_EQ(count, 0);
  EXPECT_GT(larger.norm(), 0.0);
}

// Without risk the axes' solutions are that of the whole problem, solved densely by the solver for the expected cost.
TEST(ContactControl, NeutralPolicyIsTheLqSolversOfAllAxesAtOnce)
{
  constexpr Eigen::Index kDof = 3;
  for (const char* law : { "error_feedback", "preview" })
  {
    ContactSettings settings = settingsOf(kDof);
    settings.mass << 10.0, 5.0, 20.0;
    settings.damping << 80.0, 20.0, 100.0;
    settings.law = law;
    settings.validity = settings.horizon;
    settings.covariance_weights = { 25.0, 3.0 };
    const ContactReference task = wavyTask(kDof, 2.0);
    ContactController controller("neutral_learned", settings);
    controller.follow(task);
    constexpr int kStart = 50;  // the 0.02 s elements of the task
    const auto policy = controller.plan(observationAt(kStart * task.dt, constant(kDof, 5.0)));
    ASSERT_TRUE(policy);

    const int horizon = static_cast<int>(policy->stages().size());
    const auto at = [&](int k, const std::function<double(int)>& value) {
      const int node = kStart + k / 20;
      return value(node) + (k % 20) / 20.0 * (value(node + 1) - value(node));
    };
    LinearQuadraticProblem<> problem;
    problem.terminal = LqTerminal<>::zero(2 * kDof);
    std::vector<Eigen::VectorXd> mean(horizon + 1, Eigen::VectorXd(2 * kDof));
    for (int k = 0; k <= horizon; ++k)
    {
      LqStage<> stage = LqStage<>::zero(2 * kDof, kDof);
      stage.A.setIdentity();
      stage.R.setIdentity();
      for (Eigen::Index i = 0; i < 2 * kDof; ++i)
      {
        mean[k](i) = at(k, [&](int node) { return task.motion[node].mean(i); });
        const double variance = at(k, [&](int node) { return task.motion[node].covariance(i, i); });
        stage.Q(i, i) = (i < kDof ? 25.0 : 3.0) / (variance + settings.covariance_floor);
      }
      for (Eigen::Index i = 0; i < kDof; ++i)
      {
        stage.A(i, kDof + i) = settings.dt;
        stage.A(kDof + i, kDof + i) -= settings.dt * settings.damping(i) / settings.mass(i);
        stage.B(kDof + i, i) = settings.dt / settings.mass(i);
      }
      if (k < horizon)
        problem.stages.push_back(stage);
      else
        problem.terminal.Q = stage.Q;
    }
    if (settings.law == "preview")
      for (int k = 0; k < horizon; ++k)
        problem.stages[k].d = problem.stages[k].A * mean[k] - mean[k + 1];
    const LqSolution<> solution = solve(problem);
    ASSERT_TRUE(solution.status);
    for (int k = 0; k < horizon; ++k)
    {
      const FeedbackPolicy::Stage& stage = policy->stages()[k];
      ASSERT_LT((stage.gain - solution.gains[k]).norm(), 1e-7 * solution.gains[0].norm()) << k;
      ASSERT_LT((stage.reference - mean[k]).norm(), kRounding);
      const Eigen::VectorXd feedforward = solution.feedforward[k] - Eigen::VectorXd::Constant(kDof, 2.0);
      ASSERT_LT((stage.feedforward - feedforward).norm(), 1e-7 * feedforward.norm()) << k;
    }
  }
}

TEST(ContactControl, SeekingYieldsAndAverseStiffensWithTheForceInput)
{
  ContactSettings settings = settingsOf(1);
  settings.averse = 0.02;
  const double neutral = planUnder("neutral_learned", settings, 0.0, 0.0).stiffness(0);
  double seeking = neutral * (1.0 + kRounding), averse = neutral * (1.0 - kRounding);
  for (const double u : { 0.1, 0.5, 1.0, 3.0, 5.0 })
  {
    const double next_seeking = planUnder("seeking_learned", settings, u, 0.0).stiffness(0);
    const double next_averse = planUnder("averse_learned", settings, u, 0.0).stiffness(0);
    EXPECT_LT(next_seeking, seeking) << u;
    EXPECT_GT(next_averse, averse) << u;
    seeking = next_seeking;
    averse = next_averse;
    EXPECT_NEAR(planUnder("neutral_learned", settings, u, 0.0).stiffness(0), neutral, kRounding * neutral) << u;
  }
}

// Continuous time, stationary: 0 = Q - (1/R - theta Su) (P_12 / M)^2, K = P_12 / (M R): K = K_0 / sqrt(1 - theta R Su).
TEST(ContactControl, StationaryStiffnessHasTheClosedForm)
{
  constexpr double kSampling =
      0.03;  // relative: 1 ms steps and a horizon of 2 s stand for continuous and infinite time
  ContactSettings settings = settingsOf(1);
  settings.horizon = 2.0;
  settings.weighting = "identity";
  settings.identity_weights = { 2.5e5, 0.0 };
  EXPECT_NEAR(planUnder("neutral_learned", settings, 0.0, 0.0).stiffness(0), 500.0, kSampling * 500.0);
  settings.seeking = 1.0;
  EXPECT_NEAR(planUnder("seeking_learned", settings, 2.0, 0.0).stiffness(0), 500.0 / std::sqrt(5.0),
              kSampling * 500.0 / std::sqrt(5.0));
  // the model's expectation counts as much as what is observed, and the larger of the two counts
  EXPECT_NEAR(planUnder("seeking_learned", settings, 1.0, 4.0).stiffness(0),
              planUnder("seeking_learned", settings, 2.0, 0.0).stiffness(0), kRounding * 500.0);
}

TEST(ContactControl, TheThesisThetaIsNeutralInNewtons)
{
  ContactSettings settings = settingsOf(1);
  settings.seeking = 1e-5;
  const double neutral = planUnder("neutral_learned", settings, 0.0, 0.0).stiffness(0);
  EXPECT_NEAR(planUnder("seeking_learned", settings, 3.0, 0.0).stiffness(0), neutral, 1e-4 * neutral);
}

TEST(ContactControl, OnlyAReferenceThatAccountsForTheBiasTakesItOutOfTheNoise)
{
  for (const char* name : { "seeking_learned", "seeking_adapted", "seeking_forgetting" })
  {
    ContactController controller(name, settingsOf(1));
    controller.follow(restingTask(1, 3.0, 0.0));
    for (int k = 0; k < 300; ++k)
      controller.observe(k * 1e-3, constant(1, 1.0));  // u_f = 1 - 3
    ASSERT_TRUE(controller.plan(observationAt(0.299, constant(1, 1.0))));
    EXPECT_NEAR(controller.last().bias(0), -2.0, kRounding);
    const bool about_zero = std::string(name) != "seeking_adapted";
    EXPECT_NEAR(controller.last().noise_variance(0), about_zero ? 4.0 : 0.0, kRounding) << name;
  }
}

TEST(ContactControl, AdaptationFollowsItsDynamics)
{
  constexpr double kBias = -3.0, kDt = 1e-3;
  constexpr int kPlans = 500, kSteps = 20;
  for (const bool forgets : { false, true })
  {
    ContactSettings settings = settingsOf(2);
    settings.forgetting_time = 0.5;
    ContactController controller(forgets ? "neutral_forgetting" : "neutral_adapted", settings);
    controller.follow(restingTask(2, 0.0, 0.0));
    const double lambda = forgets ? std::exp(-kDt / 0.5) : 1.0;
    Eigen::Matrix2d A;
    A << 1.0, kDt, 0.0, 1.0 - kDt * 8.0;
    const Eigen::Vector2d B(0.0, kDt / 10.0);
    Eigen::Vector2d expected = Eigen::Vector2d::Zero();
    std::optional<FeedbackPolicy> before;
    for (int plan = 0; plan <= kPlans; ++plan)
    {
      const double t = plan * kSteps * kDt;
      VectorDof force(2);
      force << kBias, 0.0;
      const auto policy = controller.plan(observationAt(t, force));
      ASSERT_TRUE(policy);
      const VectorState& adapted = controller.last().adaptation;
      ASSERT_LT((Eigen::Vector2d(adapted(0), adapted(2)) - expected).norm(), 1e-9) << t;
      EXPECT_EQ(adapted(1), 0.0) << "the axis without bias stays";
      if (before)  // a plan takes over where the one before had foreseen it: no step of the reference
      {
        ASSERT_LT((before->stageAt(t).reference - policy->stages().front().reference).norm(), 1e-12);
      }
      before = policy;
      for (int k = 0; k < kSteps; ++k)
        expected = lambda * (A * expected) + B * kBias;
    }
    const VectorState end = controller.last().adaptation;
    if (forgets)
    {
      const Eigen::Vector2d limit = (Eigen::Matrix2d::Identity() - lambda * A).inverse() * B * kBias;
      EXPECT_NEAR(end(0), limit(0), 1e-6 * std::abs(limit(0)));
      EXPECT_NEAR(end(2), limit(1), 1e-6 * std::abs(limit(1)));
    }
    else  // A has the eigenvalue 1: a drift of u_0 / D
    {
      EXPECT_NEAR(end(2), kBias / 80.0, 1e-9);
      EXPECT_NEAR(end(0), kBias / 80.0 * (kPlans * kSteps * kDt - 10.0 / 80.0), 1e-3 * 0.375);
    }
    for (int plan = kPlans + 1; plan <= 2 * kPlans; ++plan)
      ASSERT_TRUE(controller.plan(observationAt(plan * kSteps * kDt, constant(2, 0.0))));
    const double left = controller.last().adaptation(0);
    if (forgets)
      EXPECT_LT(std::abs(left), 1e-6) << "ten seconds are twenty time constants";
    else
      EXPECT_LT(left, end(0)) << "what was adapted is never given back";
    controller.reset();
    ASSERT_TRUE(controller.plan(observationAt(0.0, constant(2, 0.0))));
    EXPECT_EQ(controller.last().adaptation.norm(), 0.0);
  }
}

// With preview and the bias taken into the reference, a free tool under a constant u_f needs no motion control: it
// moves exactly as the reference does.
TEST(ContactControl, AdaptedReferenceIsTheMotionThatTheBiasProduces)
{
  ContactSettings settings = settingsOf(1);
  settings.law = "preview";
  ContactController controller("neutral_adapted", settings);
  controller.follow(restingTask(1, 0.0, 0.0));
  Observation observation = observationAt(0.0, constant(1, -3.0));
  for (int plan = 0; plan < 100; ++plan)
  {
    observation.t = plan * 0.02;
    const auto policy = controller.plan(observation);
    ASSERT_TRUE(policy);
    for (int k = 0; k < 20; ++k)
    {
      VectorDof u;
      ASSERT_TRUE(policy->act(observation.t + k * 1e-3, observation.state, u));
      EXPECT_LT(std::abs(u(0)), 1e-6);
      const double v = observation.state(1);
      observation.state(0) += 1e-3 * v;
      observation.state(1) += 1e-3 / 10.0 * (u(0) - 3.0 - 80.0 * v);
    }
  }
  EXPECT_LT(observation.state(0), -0.05);
}

TEST(ContactControl, ClampLeavesTheStiffness)
{
  ContactSettings settings = settingsOf(3);
  const ContactPlan free = planUnder("seeking_learned", settings, 1.0, 0.1);
  settings.clamp_velocity_gain = true;
  const ContactPlan clamped = planUnder("seeking_learned", settings, 1.0, 0.1);
  EXPECT_GT(free.velocity_gain.minCoeff(), 1.0);
  EXPECT_EQ(clamped.velocity_gain.norm(), 0.0);
  EXPECT_EQ(clamped.stiffness, free.stiffness);
  ContactController controller("neutral_learned", settings);
  controller.follow(restingTask(3, 0.0, 0.0));
  const auto policy = controller.plan(observationAt(0.0, constant(3, 0.0)));
  ASSERT_TRUE(policy);
  for (const FeedbackPolicy::Stage& stage : policy->stages())
    EXPECT_EQ(stage.gain.rightCols(3).norm(), 0.0);
}

TEST(ContactControl, AverseBeyondItsLimitFallsBackAndSaysSo)
{
  ContactSettings settings = settingsOf(1);
  settings.averse = 1.0;
  const double neutral = planUnder("neutral_learned", settings, 0.0, 0.0).stiffness(0);
  const ContactPlan within = planUnder("averse_learned", settings, 0.5, 0.0);
  EXPECT_EQ(within.fallback, RiskFallback::None);
  EXPECT_EQ(within.scale, 1.0);
  const ContactPlan beyond = planUnder("averse_learned", settings, 5.0, 0.0);  // theta R Su = 25
  EXPECT_EQ(beyond.fallback, RiskFallback::Reduced);
  EXPECT_LT(beyond.scale, 0.2);
  EXPECT_GT(beyond.stiffness(0), neutral);
  EXPECT_TRUE(beyond.stiffness.allFinite());
}

// (5.45) with K_f is (5.45) without it and M_r' = K_f^-1 M_r, D_r' = K_f^-1 D_r, u_p' = K_f^-1 u_p.
TEST(ContactControl, ForceGainScalesTheRenderedPlantFromTheLeft)
{
  for (const char* law : { "error_feedback", "preview" })
  {
    ContactSettings settings = settingsOf(2);
    settings.law = law;
    const ContactReference task = wavyTask(2, 2.0);
    ContactController plain("neutral_learned", settings);
    settings.force_gain << 2.0, 0.5;
    ContactController scaled("neutral_learned", settings);
    EXPECT_EQ(scaled.loopMass(), VectorDof(Eigen::Vector2d(5.0, 20.0)));
    EXPECT_EQ(scaled.loopDamping(), VectorDof(Eigen::Vector2d(40.0, 160.0)));
    plain.follow(task);
    scaled.follow(task);
    const VectorDof force = constant(2, 7.0);
    VectorState xi(4);
    xi << 0.01, -0.02, 0.1, 0.05;
    VectorDof u_plain, u_scaled;
    plain.plan(observationAt(1.0, force))->act(1.005, xi, u_plain);
    scaled.plan(observationAt(1.0, force))->act(1.005, xi, u_scaled);
    const VectorDof u_p = u_plain + constant(2, 2.0);  // without -mu_f
    const VectorDof right_side = u_p + scaled.forceInput(1.005, force);
    EXPECT_LT((right_side - settings.force_gain.cwiseProduct(u_scaled + force)).norm(), kRounding * right_side.norm());
    EXPECT_LT((scaled.forceInput(1.005, force) - VectorDof(Eigen::Vector2d(10.0, 2.5))).norm(), kRounding);
  }
}

TEST(ContactControl, TheLastElementHoldsAtRest)
{
  ContactController controller("neutral_learned", settingsOf(1));
  const ContactReference task = wavyTask(1, 2.0);
  controller.follow(task);
  const auto policy = controller.plan(observationAt(10.0, constant(1, 0.0)));
  ASSERT_TRUE(policy);
  EXPECT_NEAR(policy->stages().front().reference(0), task.motion.back().mean(0), kRounding);
  EXPECT_EQ(policy->stages().front().reference(1), 0.0);
}

TEST(ContactControl, RefusesWhatItCannotUse)
{
  const auto message = [](const std::function<void()>& act) -> std::string {
    try
    {
      act();
    }
    catch (const std::invalid_argument& error)
    {
      return error.what();
    }
    return "";
  };
  const auto with = [&](const std::function<void(ContactSettings&)>& change) {
    ContactSettings settings;
    change(settings);
    return message([&] { ContactController("neutral_learned", settings); });
  };
  EXPECT_NE(message([] { ContactController("seeking_lerned", {}); }).find("did you mean seeking_learned?"),
            std::string::npos);
  EXPECT_NE(with([](auto& s) { s.mass = constant(2, 1.0); }).find("expected the same number"), std::string::npos);
  EXPECT_NE(with([](auto& s) { s.mass(1) = -1.0; }).find("mass = -1"), std::string::npos);
  EXPECT_NE(with([](auto& s) { s.force_gain(0) = 0.0; }).find("force_gain"), std::string::npos);
  EXPECT_NE(with([](auto& s) { s.seeking = -1.0; }).find("seeking = -1"), std::string::npos);
  EXPECT_NE(with([](auto& s) { s.validity = 1.0; }).find("validity"), std::string::npos);
  EXPECT_NE(with([](auto& s) { s.law = "none"; }).find("error_feedback or preview"), std::string::npos);
  EXPECT_NE(with([](auto& s) { s.window = std::nan(""); }).find("window"), std::string::npos);
  EXPECT_EQ(with([](auto&) {}), "");
  ContactSettings settings;
  EXPECT_NE(message([&] {
              parameterTable(settings).assign("contact", { { "seeking", -1.0 }, { "averze", 1.0 } });
            }).find("averze"),
            std::string::npos);
  parameterTable(settings).assign("contact", { { "seeking", 20.0 }, { "clamp_velocity_gain", true } });
  EXPECT_EQ(settings.seeking, 20.0);
  EXPECT_TRUE(settings.clamp_velocity_gain);

  ContactController controller("neutral_learned", settingsOf(1));
  EXPECT_FALSE(controller.plan(observationAt(0.0, constant(1, 0.0))));
  EXPECT_EQ(controller.failure(), "there is no task to follow");
  ContactReference task = restingTask(1, 0.0, 0.1);
  task.motion[1].mean(0) = std::nan("");
  EXPECT_NE(message([&] { controller.follow(task); }).find("motion[1].mean"), std::string::npos);
  task = restingTask(1, 0.0, -0.1);
  EXPECT_NE(message([&] { controller.follow(task); }).find("environment_wrench[0].covariance"), std::string::npos);
  task = restingTask(1, 0.0, 0.1);
  task.environment_wrench.pop_back();
  EXPECT_NE(message([&] { controller.follow(task); }).find("2 motions and 1 wrenches"), std::string::npos);
  controller.follow(restingTask(1, 0.0, 0.1));
  EXPECT_TRUE(controller.plan(observationAt(1.0, constant(1, 0.0))));
  EXPECT_FALSE(controller.plan(observationAt(0.5, constant(1, 0.0))));
  EXPECT_NE(controller.failure().find("before the last plan"), std::string::npos);
  EXPECT_FALSE(controller.plan(observationAt(2.0, constant(1, std::nan("")))));
  EXPECT_FALSE(controller.plan(observationAt(2.0, constant(3, 0.0))));
  EXPECT_NE(controller.failure().find("expected 2"), std::string::npos);
}
}  // namespace phri_control
