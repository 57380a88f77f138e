#include "phri_learning/behavior_models.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "fixtures.hpp"
#include "phri_learning/hmm_training.hpp"

namespace phri_learning
{
namespace
{
using testing::kDt;

/// Trials of a 2-DoF object whose partner pushes along the velocity, u = 200 xdot.
std::vector<std::vector<phri_core::Observation>> trials(std::uint64_t seed, int count)
{
  std::vector<std::vector<phri_core::Observation>> all;
  for (const Eigen::MatrixXd& x : testing::movements(seed, count))
  {
    std::vector<phri_core::Observation> trial;
    for (Eigen::Index t = 0; t < x.rows(); ++t)
    {
      phri_core::Observation o;
      o.t = static_cast<double>(t) * kDt;
      o.state = x.row(t).transpose();
      o.human_wrench = 200.0 * x.row(t).tail(2).transpose();
      trial.push_back(o);
    }
    all.push_back(trial);
  }
  return all;
}

std::shared_ptr<const TimeHmm> learned()
{
  std::vector<Eigen::MatrixXd> demonstrations;
  for (const auto& trial : trials(1, 3))
    demonstrations.push_back(demonstration(trial, 2));
  TrainingOptions o;
  o.states = 20;
  o.dt = kDt;
  return std::make_shared<const TimeHmm>(train(demonstrations, o).model);
}

TEST(TimeHmmModel, predictsAFullHorizonOfProperGaussians)
{
  TimeHmmModel model(learned());
  EXPECT_FALSE(model.predict(0.2, kDt).has_value());  // cannot tell before the first observation
  const auto trial = trials(2, 1)[0];
  for (std::size_t t = 0; t < trial.size(); ++t)
  {
    model.observe(trial[t]);
    const auto prediction = model.predict(0.2, kDt);
    ASSERT_TRUE(prediction.has_value());
    EXPECT_EQ(prediction->model, "time_hmm");
    EXPECT_EQ(prediction->t0, trial[t].t);
    ASSERT_EQ(prediction->desired_state.size(), 11u);
    ASSERT_EQ(prediction->human_wrench.size(), 11u);
    for (std::size_t k = 0; k < 11; ++k)
    {
      for (const phri_core::Gaussian* g : { &prediction->desired_state[k], &prediction->human_wrench[k] })
      {
        ASSERT_TRUE(g->mean.allFinite());
        ASSERT_EQ(g->covariance, g->covariance.transpose());
        ASSERT_EQ(g->covariance.llt().info(), Eigen::Success);
      }
      ASSERT_EQ(prediction->desired_state[k].mean.size(), 4);
      ASSERT_EQ(prediction->human_wrench[k].mean.size(), 2);
    }
  }
}

TEST(TimeHmmModel, predictsTheWrenchThatBelongsToTheMotion)
{
  // u = 200 xdot holds in every demonstration, so it must hold in what is predicted from them
  TimeHmmModelSettings settings;
  const auto trial = trials(2, 1)[0];
  for (const Reference reference : { Reference::kPath, Reference::kDisplacement })
  {
    settings.reference = reference;
    settings.adapt_pace = false;
    TimeHmmModel model(learned(), settings);
    for (const auto& observation : trial)
    {
      model.observe(observation);
      const auto prediction = model.predict(0.2, 0.1);
      for (std::size_t k = 0; k < 3; ++k)
        ASSERT_LT((prediction->human_wrench[k].mean - 200.0 * prediction->desired_state[k].mean.tail(2)).norm(), 1e-6);
    }
  }
}

TEST(TimeHmmModel, resetForgetsTheTrialAndKeepsTheModel)
{
  TimeHmmModel model(learned());
  const auto trial = trials(2, 1)[0];
  const auto run = [&] {
    for (std::size_t t = 0; t < 50; ++t)
      model.observe(trial[t]);
    return model.predict(0.1, kDt)->desired_state.back().mean;
  };
  const Eigen::VectorXd first = run();
  model.reset();
  EXPECT_FALSE(model.predict(0.1, kDt).has_value());
  EXPECT_EQ(run(), first);
}

TEST(TimeHmmModel, refusesWhatDoesNotFit)
{
  const auto hmm = learned();
  TimeHmmModelSettings settings;
  settings.dof = 1;
  EXPECT_THROW(TimeHmmModel(hmm, settings), std::invalid_argument);
  EXPECT_THROW(TimeHmmModel(nullptr), std::invalid_argument);
  TimeHmmModel model(hmm);
  phri_core::Observation bad = trials(2, 1)[0][0];
  bad.human_wrench(0) = std::nan("");
  EXPECT_THROW(model.observe(bad), std::invalid_argument);
  bad.human_wrench.resize(1);
  EXPECT_THROW(model.observe(bad), std::invalid_argument);
  EXPECT_FALSE(model.predict(0.1, kDt).has_value());  // refused observations leave no trace
  EXPECT_THROW(model.predict(0.1, 0.0), std::invalid_argument);
}
}  // namespace
}  // namespace phri_learning
