#pragma once
/// Small tasks and settings for the tests of the contact controller.

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "phri_control/contact_control.hpp"

namespace phri_control::contact
{
using phri_core::Gaussian;
using phri_core::Observation;
using phri_core::VectorDof;
using phri_core::VectorState;

constexpr double kRounding = 1e-9;  // relative, of a few hundred well-conditioned operations

inline VectorDof constant(Eigen::Index dof, double value)
{
  return VectorDof::Constant(dof, value);
}

/// A task of `dof` axes: a slow sine per axis, with variances that differ per axis and time.
inline ContactReference wavyTask(Eigen::Index dof, double force)
{
  ContactReference task{ 0.0, 0.02, {}, {} };
  for (int k = 0; k <= 200; ++k)
  {
    const double t = k * task.dt;
    Gaussian motion{ Eigen::VectorXd(2 * dof), Eigen::MatrixXd::Zero(2 * dof, 2 * dof) };
    for (Eigen::Index i = 0; i < dof; ++i)
    {
      motion.mean(i) = 0.05 * std::sin(t + i);
      motion.mean(dof + i) = 0.05 * std::cos(t + i);
      motion.covariance(i, i) = 1e-4 * (1.5 + std::sin(3.0 * t + i));
      motion.covariance(dof + i, dof + i) = 1e-2;
    }
    task.motion.push_back(motion);
    task.environment_wrench.push_back({ Eigen::VectorXd::Constant(dof, force), Eigen::MatrixXd::Zero(dof, dof) });
  }
  return task;
}

/// A task that rests at the origin, presses with `force`, and varies as told.
inline ContactReference restingTask(Eigen::Index dof, double force, double force_variance)
{
  ContactReference task{ 0.0, 1.0, {}, {} };
  const Gaussian motion{ Eigen::VectorXd::Zero(2 * dof), 1e-4 * Eigen::MatrixXd::Identity(2 * dof, 2 * dof) };
  const Gaussian wrench{ Eigen::VectorXd::Constant(dof, force), force_variance * Eigen::MatrixXd::Identity(dof, dof) };
  task.motion.assign(2, motion);
  task.environment_wrench.assign(2, wrench);
  return task;
}

inline Observation observationAt(double t, const VectorDof& environment_wrench)
{
  const VectorDof none = VectorDof::Zero(environment_wrench.size());
  return { t, VectorState::Zero(2 * environment_wrench.size()), none, environment_wrench, {} };
}

inline ContactSettings settingsOf(Eigen::Index dof)
{
  ContactSettings settings;
  settings.mass = constant(dof, 10.0);
  settings.damping = constant(dof, 80.0);
  settings.force_gain = constant(dof, 1.0);
  return settings;
}

/// First-stage report of the controller on a resting task, when u_f has been `u` and `-u` in turns.
inline ContactPlan planUnder(const std::string& name, const ContactSettings& settings, double u,
                             double expected_variance)
{
  const Eigen::Index dof = settings.mass.size();
  ContactController controller(name, settings);
  controller.follow(restingTask(dof, 0.0, expected_variance));
  for (int k = 0; k < 300; ++k)
    controller.observe(k * 1e-3, constant(dof, k % 2 ? u : -u));
  EXPECT_TRUE(controller.plan(observationAt(0.299, constant(dof, u)))) << controller.failure();
  return controller.last();
}
}  // namespace phri_control::contact
