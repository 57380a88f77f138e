#pragma once
#include <memory>
#include <string>
#include <vector>

#include "phri_sim/contact_stage.hpp"

namespace phri_sim
{
/// What the world says about one trial.
struct ContactOutcome
{
  int touches = 0, clicks = 0;  ///< of the button
  double deepest = 0.0;         ///< [m] travel of its cap
  double pointing_error = 0.0;  ///< [m] of the tip from the point, at the end
  double wiped = 0.0;           ///< [-] share of the text
  double peak_force = 0.0;      ///< [N] of contact
  bool faulted = false;         ///< the loop was in FAULT
  double limited = 0.0;         ///< [-] share of the ticks in which the assistance was limited
};

/// "success", "partial" or "failure". Button: it clicked; it was touched; neither (5.4.3).
std::string pressingVerdict(const ContactOutcome& outcome);
/// The tip is within the tolerance of the point, or "failure": there is no half of it.
std::string pointingVerdict(const ContactTask& task, const ContactOutcome& outcome);
/// Share of the text wiped off: at least wiped_success, more than wiped_partial, or less.
std::string wipingVerdict(const ContactTask& task, const ContactOutcome& outcome);

/// A demonstration: what the robot recorded while a person guided it.
struct Demonstration
{
  Eigen::MatrixXd samples;  ///< (T, 9) every task.dt: position, velocity, force by the environment [m, m/s, N]
  ContactOutcome outcome;
};

/// Guides the tool once, in undisplaced surroundings.
Demonstration demonstrate(std::shared_ptr<const ContactTask> task, std::uint64_t seed, int index);

/// What is left of the demonstrations.
struct TaughtTask
{
  std::vector<Demonstration> demonstrations;
  int repeated = 0;  ///< demonstrations that did not do the task and were done again
  phri_control::ContactReference reference;
  double length = 0.0;  ///< [s] of the learned motion: mean of the demonstrations
};

/// task->demonstrations successful demonstrations -> time-based HMM -> its regression over time. Throws
/// std::runtime_error if the teacher fails as often as he succeeds.
TaughtTask teach(std::shared_ptr<const ContactTask> task, std::uint64_t seed);

/// A row of a reproduction's log, every task.dt; per axis.
struct ContactSample
{
  double t = 0.0;             ///< [s]
  Eigen::Vector3d position;   ///< measured, of the tip [m]
  Eigen::Vector3d learned;    ///< mean of the learned motion [m]
  Eigen::Vector3d reference;  ///< followed, adapted or not [m]
  Eigen::Vector3d stiffness;  ///< of the motion control [N/m]
  Eigen::Vector3d noise;      ///< standard deviation assumed of u_f [N]
  Eigen::Vector3d input;      ///< u_f [N]
  Eigen::Vector3d force;      ///< measured, by the environment [N]
  Eigen::Vector3d taught;     ///< its learned mean [N]
  double contact = 0.0;       ///< true contact force [N]
  double travel = 0.0;        ///< of the button [m]
  double wiped = 0.0;         ///< [-]
};

/// One reproduction under one controller, a millisecond at a time, without ROS: stage, interaction loop, contact
/// controller. Bit-identical for one task, controller and trial.
class ContactRun
{
public:
  /// Throws like ContactStage and ContactController.
  ContactRun(std::shared_ptr<const ContactTask> task, const std::string& controller,
             std::shared_ptr<const TaughtTask> taught, const ContactTrial& trial);

  void step();
  bool finished() const { return tick_ >= ticks_; }
  ContactOutcome outcome() const;

  double time() const { return tick_ * task_->loop.dt; }
  const std::vector<ContactSample>& log() const { return log_; }
  const ContactStage& stage() const { return stage_; }
  const phri_control::InteractionLoop& loop() const { return loop_; }
  const phri_control::ContactController& controller() const { return controller_; }

private:
  void plan(const phri_core::Measurement& measurement);

  std::shared_ptr<const ContactTask> task_;
  std::shared_ptr<const TaughtTask> taught_;
  ContactStage stage_;
  phri_control::InteractionLoop loop_;
  phri_control::ContactController controller_;
  int tick_ = 0, ticks_, plan_ticks_;
  double peak_force_ = 0.0;
  int limited_ = 0;
  bool faulted_ = false;
  std::vector<ContactSample> log_;
};
}  // namespace phri_sim
