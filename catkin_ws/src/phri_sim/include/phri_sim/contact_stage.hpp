#pragma once
#include <memory>
#include <optional>

#include "phri_control/whole_body.hpp"
#include "phri_sim/button.hpp"
#include "phri_sim/contact_task.hpp"
#include "phri_sim/simulated_robot.hpp"
#include "phri_sim/stage.hpp"
#include "phri_sim/world.hpp"

namespace phri_sim
{
struct ContactTrial
{
  std::uint64_t seed = 0;     ///< of noise, and of the demonstrations
  double displacement = 0.0;  ///< [m] of what is pressed on, along the press direction
  int demonstration = -1;     ///< number of the demonstration that a teacher guides; -1: nobody holds the tool
};

/// Contact tasks of 5.4: an LWR on a stand presses a button and points at a place on a board, or wipes a text off it
/// with an eraser in the gripper. The loop's coordinates are [x, y, z] of the tool's tip in the world, at a fixed
/// orientation. The wrist sensor, tared in the air, measures environment_wrench; the tool's weight is taken off, its
/// inertia is not: it is felt as a part of that wrench, in demonstrations as well as in reproductions.
///
/// A teacher holds the arm before the sensor, which feels the environment alone; the hand's own force is taken to be
/// known from the joint torques, without error, and is human_wrench. What happened is judged by the world alone.
class ContactStage : public Stage
{
public:
  /// Throws std::invalid_argument, std::out_of_range or DescriptionError: what the task names does not fit.
  ContactStage(std::shared_ptr<const ContactTask> task, const ContactTrial& trial);

  phri_core::VectorDof start() const override { return start_; }
  /// `assistance` acts on the rendered object alone: it is not needed here.
  phri_core::Measurement read(std::int64_t now_ns, const phri_core::VectorDof& assistance) noexcept override;
  void write(const phri_core::Command& command) noexcept override;
  /// The button has clicked and the tip rests at the point, or the text is wiped off and the tool has left the board.
  bool arrived() const noexcept override;

  Eigen::Vector3d tip() const noexcept;                          ///< where it really is [m]
  Eigen::Vector3d contactForce() const noexcept;                 ///< by the environment on the tool, last step [N]
  const Button* button() const { return button_.get(); }         ///< null where there is none
  const Whiteboard* whiteboard() const { return board_.get(); }  ///< null where nothing is to be wiped
  const Teacher* teacher() const { return teacher_ ? &*teacher_ : nullptr; }
  /// Of the tip from the point that is to be shown [m].
  double pointingError() const noexcept { return (tip() - task_->scene.point).norm(); }
  const World& world() const { return world_; }
  const phri_control::Twist& trackingError() const { return tracking_error_; }  ///< of the last tick [m, rad]

private:
  struct Setup;
  ContactStage(std::shared_ptr<const ContactTask> task, const ContactTrial& trial, Setup setup);
  void settle();
  Eigen::Vector3d believedTip(const Eigen::Isometry3d& tcp) const noexcept;

  std::shared_ptr<const ContactTask> task_;
  phri_control::WholeBody body_;
  World world_;
  SimulatedRobot robot_;
  phri_control::ForceSensor force_sensor_;
  std::unique_ptr<Button> button_;
  std::unique_ptr<Whiteboard> board_;
  std::optional<Teacher> teacher_;
  Eigen::Matrix3d orientation_;  // of the tool
  Eigen::Vector3d offset_;       // of the tip from the tcp, world axes
  Eigen::Isometry3d sensor_;     // its frame in the tcp's
  int tcp_link_, hand_link_;
  std::vector<int> tool_links_;  // that can touch something
  phri_core::VectorDof start_;
  phri_control::Twist tracking_error_ = phri_control::Twist::Zero();
  std::uint64_t sequence_ = 0;
};
}  // namespace phri_sim
