#pragma once
/// A tool of 10 kg in the interaction loop above a compliant wall (its normal is +z), with twelve hand-made
/// demonstrations: down onto the wall, press with 3 N, retreat and point somewhere else.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "phri_control/contact_control.hpp"
#include "phri_control/interaction_loop.hpp"
#include "phri_core/random.hpp"

namespace phri_control::wall
{
using phri_core::VectorDof;

constexpr double kTick = 1e-3;                   // [s]
constexpr double kStiffness = 1e4;               // [N/m]
constexpr double kPress = 3.0;                   // [N]
constexpr double kPressStart = 2.0;              // [s]
constexpr double kPressEnd = 6.0;                // [s]
constexpr double kMoveEnd = 8.0;                 // [s]
constexpr double kEnd = 10.0;                    // [s]
constexpr double kNode = 0.02;                   // [s]
const Eigen::Vector3d kStart(0.0, 0.0, 0.15);    // [m]
const Eigen::Vector3d kPoint(0.15, 0.05, 0.10);  // [m]

/// Minimum-jerk position and velocity share at s = t / duration.
inline double share(double s)
{
  s = std::clamp(s, 0.0, 1.0);
  return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
}

/// Mean and covariance over the demonstrations at every 20 ms; the wall at z = 0.
inline ContactReference demonstrate(Eigen::Index dof, std::uint64_t seed)
{
  constexpr int kDemonstrations = 12;
  const int count = static_cast<int>(std::lround(kEnd / kNode)) + 1;
  std::vector<Eigen::MatrixXd> motion(count, Eigen::MatrixXd(kDemonstrations, 2 * dof));
  std::vector<Eigen::MatrixXd> force(count, Eigen::MatrixXd::Zero(kDemonstrations, dof));
  for (int demo = 0; demo < kDemonstrations; ++demo)
  {
    phri_core::Random random = phri_core::Random::stream(seed, "demonstration", demo);
    const auto scatter = [&](double deviation) {
      Eigen::Vector3d value;
      for (int i = 0; i < 3; ++i)
        value(i) = random.normal(0.0, deviation);
      return value;
    };
    const Eigen::Vector3d start = kStart + scatter(0.01), point = kPoint + scatter(0.002);
    Eigen::Vector3d pressed = scatter(0.002);
    pressed.z() = -random.normal(kPress, 0.3) / kStiffness;
    const double late = random.normal(0.0, 0.05);
    const auto position = [&](double t) -> Eigen::Vector3d {
      return start + (pressed - start) * share(t / (kPressStart + late)) +
             (point - pressed) * share((t - kPressEnd - late) / (kMoveEnd - kPressEnd));
    };
    for (int k = 0; k < count; ++k)
    {
      const double t = k * kNode;
      const Eigen::Vector3d x = position(t), v = (position(t + kTick) - position(t - kTick)) / (2.0 * kTick);
      motion[k].row(demo) << x.tail(dof).transpose(), v.tail(dof).transpose();
      force[k](demo, dof - 1) = kStiffness * std::max(0.0, -x.z());
    }
  }
  const auto gaussian = [](const Eigen::MatrixXd& samples) -> phri_core::Gaussian {
    const Eigen::RowVectorXd mean = samples.colwise().mean();
    const Eigen::MatrixXd deviations = samples.rowwise() - mean;
    return { mean.transpose(), deviations.transpose() * deviations / (samples.rows() - 1.0) };
  };
  ContactReference task{ 0.0, kNode, {}, {} };
  for (int k = 0; k < count; ++k)
  {
    task.motion.push_back(gaussian(motion[k]));
    task.environment_wrench.push_back(gaussian(force[k]));
  }
  return task;
}

/// What happened; the last axis is normal to the wall.
struct Outcome
{
  double first_contact = -1.0;             ///< [s], -1: never
  double deepest = 0.0;                    ///< [m] lowest height of the tool, counted from the taught wall
  double mean_force = 0.0;                 ///< [N] of contact while 3 N were to be pressed
  double late_force = 0.0;                 ///< [N] mean over the last half second of that
  double peak_force = 0.0;                 ///< [N]
  double press_stiffness = 0.0;            ///< [N/m] along the normal, by a plan half a second before the end
  double press_height = 0.0;               ///< [m] of the tool above its reference then
  double press_input = 0.0;                ///< [N] u_f then
  double end_error = 0.0;                  ///< [m] of the position at the end
  double half_error = 0.0;                 ///< [m] when the retreat is just over
  double largest_step = 0.0;               ///< [N] of u_r between two ticks, before the limits
  double plan_step = 0.0;                  ///< [N] the same, at ticks that adopted a plan
  double limited = 0.0;                    ///< [-] share of ticks in which the assistance was limited
  double fallback = 0.0;                   ///< [-] share of plans
  bool active = true;                      ///< the loop did not leave ACTIVE once it was there
  std::vector<Eigen::VectorXd> positions;  ///< every 20 ms
};

inline LoopSettings loopSettings(const ContactController& controller)
{
  LoopSettings loop;
  loop.mass = controller.loopMass();
  loop.damping = controller.loopDamping();
  loop.safety.autonomous_completion = true;
  loop.safety.workspace = 0.5;
  loop.safety.tank_initial = loop.safety.tank_max;
  return loop;
}

/// One trial with the wall lower by `displacement` [m] than at the demonstrations.
inline Outcome reproduce(const std::string& name, const ContactSettings& settings, double displacement,
                         std::uint64_t seed = 1)
{
  const Eigen::Index dof = settings.mass.size();
  const ContactReference task = demonstrate(dof, seed);
  ContactController controller(name, settings);
  controller.follow(task);
  InteractionLoop loop(loopSettings(controller));
  VectorDof x = task.motion.front().mean.head(dof), wrench = VectorDof::Zero(dof), before = VectorDof::Zero(dof);
  loop.place(x);
  loop.start();
  Outcome outcome;
  const int ticks = static_cast<int>(std::lround(kEnd / kTick));
  int pressing = 0, late = 0, plans = 0;
  bool seen_active = false;
  for (int k = 0; k <= ticks; ++k)
  {
    const double t = k * kTick;
    const std::int64_t now = k * std::int64_t{ 1000000 };
    wrench(dof - 1) = kStiffness * std::max(0.0, -displacement - x(dof - 1));
    controller.observe(t, wrench);
    const bool planning = k % 20 == 0;
    if (planning)
    {
      phri_core::Observation seen = loop.observation();
      seen.t = t;
      seen.environment_wrench = wrench;
      if (auto policy = controller.plan(seen))
        loop.adopt(std::move(*policy));
      outcome.fallback += controller.last().fallback != RiskFallback::None;
      if (t < kPressEnd - 0.5)  // the shortest demonstration still presses
      {
        outcome.press_stiffness = controller.last().stiffness(dof - 1);
        outcome.press_height = x(dof - 1) - controller.last().reference(dof - 1);
        outcome.press_input = controller.forceInput(t, wrench)(dof - 1);
      }
      outcome.positions.push_back(x);
      ++plans;
    }
    phri_core::Measurement measurement;
    measurement.receive_ns = measurement.stamp_ns = now;
    measurement.sequence = k + 1;
    measurement.position = x;
    measurement.human_wrench = VectorDof::Zero(dof);
    measurement.environment_wrench = wrench;
    x = loop.tick(measurement, now).position;

    const TickRecord& record = loop.record();
    const bool active = record.state == phri_core::LoopState::Active;
    outcome.active = outcome.active && (active || !seen_active);
    seen_active = seen_active || active;
    outcome.limited += (record.limits & phri_core::kAssistanceLimits) != 0;
    const double step = (record.requested_wrench - before).norm();
    before = record.requested_wrench;
    (planning ? outcome.plan_step : outcome.largest_step) =
        std::max(planning ? outcome.plan_step : outcome.largest_step, step);
    const double force = wrench(dof - 1);
    outcome.peak_force = std::max(outcome.peak_force, force);
    outcome.deepest = std::min(outcome.deepest, x(dof - 1));
    if (force > 0.0 && outcome.first_contact < 0.0)
      outcome.first_contact = t;
    if (t >= kPressStart && t < kPressEnd)
      outcome.mean_force += force, ++pressing;
    if (t >= kPressEnd - 0.5 && t < kPressEnd)
      outcome.late_force += force, ++late;
    if (k == static_cast<int>(std::lround(kMoveEnd / kTick)))
      outcome.half_error = (x - task.motion.back().mean.head(dof)).norm();
  }
  outcome.mean_force /= pressing;
  outcome.late_force /= late;
  outcome.limited /= ticks + 1;
  outcome.fallback /= plans;
  outcome.end_error = (x - task.motion.back().mean.head(dof)).norm();
  return outcome;
}
}  // namespace phri_control::wall
