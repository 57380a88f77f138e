#pragma once
#include <memory>
#include <optional>

#include "phri_control/force_sensor.hpp"
#include "phri_control/whole_body.hpp"
#include "phri_sim/carrying_partner.hpp"
#include "phri_sim/lab.hpp"
#include "phri_sim/simulated_robot.hpp"
#include "phri_sim/stage.hpp"
#include "phri_sim/world.hpp"

namespace phri_sim
{
/// What a transport's tick looks like from outside; nothing that the robot could know but `observation`.
struct TransportSample
{
  /// [x, y, yaw] in the world [m, m, rad], yaw from the model, within a turn.
  Eigen::Vector3d grasp{ 0, 0, 0 }, far_grasp{ 0, 0, 0 }, base{ 0, 0, 0 };
  /// As printed in 5.1.2, of the robot's grasp in the axes of `odom`: position [m], angular velocity [rad/s], wrench by
  /// the human [N, Nm].
  Eigen::Matrix<double, 12, 1> observation = Eigen::Matrix<double, 12, 1>::Zero();
};

/// Joint transport of 5.1.2: the mobile manipulator holds one end of the bumper, a simulated person the other, and they
/// carry it through the lab. The loop's coordinates are [x, y, yaw] of the robot's grasp in the frame `odom`, in which
/// the admittance lives (figure 5.4); height and level are held. `odom` drifts away from the world.
///
/// The wrist's F/T sensor is tared before the person touches the bumper; the weight of all that lies beyond it is taken
/// off, its inertia is not: it is felt as a part of the human wrench, as in a real robot.
class TransportStage : public Stage
{
public:
  /// Throws std::invalid_argument, std::out_of_range or DescriptionError: what the experiment names does not fit.
  TransportStage(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec);

  phri_core::VectorDof start() const override { return start_; }
  phri_core::Measurement read(std::int64_t now_ns, const phri_core::VectorDof& assistance) noexcept override;
  void write(const phri_core::Command& command) noexcept override;
  bool arrived() const noexcept override { return arrived_; }

  /// What the person exerts on the far grasp, world axes [N, Nm].
  const Vector6& humanWrench() const { return human_wrench_; }
  /// Last reading of the wrist sensor without payload, about the robot's grasp in axes of `odom` [N, Nm].
  const Vector6& sensedWrench() const { return sensed_; }
  const World& world() const { return world_; }
  World& world() { return world_; }
  const SimulatedRobot& robot() const { return robot_; }
  const CarryingPartner& partner() const { return partner_; }
  const LabRoute& route() const { return *route_; }
  /// Of the state after the last write; the wrench is the last one read.
  TransportSample sample() const noexcept;
  /// How far the end-effector is from where it was commanded to be [m, rad], of the last tick.
  const phri_control::Twist& trackingError() const { return tracking_error_; }

private:
  struct Setup;
  TransportStage(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec, Setup setup);
  void settle();
  Eigen::Isometry3d believedTip() const noexcept;

  std::shared_ptr<const Experiment> experiment_;
  const LabRoute* route_;
  phri_control::WholeBody body_;
  World world_;
  SimulatedRobot robot_;
  phri_control::ForceSensor force_sensor_;
  CarryingPartner partner_;
  Eigen::Matrix3d level_;     // orientation of the tip at yaw 0
  Eigen::Isometry3d sensor_;  // its frame in the tip's
  int tip_link_, far_link_;
  double height_, yaw_;  // [m]; [rad] believed, without jumps
  phri_core::VectorDof start_;
  Vector6 human_wrench_ = Vector6::Zero(), sensed_ = Vector6::Zero();
  phri_control::Twist tracking_error_ = phri_control::Twist::Zero();
  std::uint64_t sequence_ = 0;
  bool arrived_ = false;
};
}  // namespace phri_sim
