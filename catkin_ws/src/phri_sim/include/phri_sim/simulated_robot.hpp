#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "phri_control/whole_body.hpp"
#include "phri_core/random.hpp"
#include "phri_sim/robot_settings.hpp"
#include "phri_sim/world.hpp"

namespace phri_sim
{
/// Everything beyond a fixed joint, as a sensor there feels it at rest.
phri_control::Payload payloadBeyond(const World& world, int fixed_joint);

/// The motors and sensors of a robot in a World: position servos in the arm with gravity and Coriolis compensation, a
/// velocity loop in the omnidirectional base (if the model has one), a force/torque sensor at the wrist, and odometry
/// that drifts. Nothing here allocates after construction.
///
///   robot.drive(base, rates);  world.step(robot.period(), robot.torques());  robot.sense();
class SimulatedRobot
{
public:
  /// The world must have `<arm>_ft_joint` as sensor number `sensor`, and stand in the robot's posture: that is what is
  /// held. Throws std::out_of_range for a model without the arm's joints, std::invalid_argument for settings.
  SimulatedRobot(World* world, const RobotSettings& settings, int sensor, double dt, std::uint64_t trial_seed);

  /// Velocities to follow until the next call: of the base in its own axes, of the arm's joints [rad/s]. What is not
  /// finite, or of another size, stops that part.
  void drive(const phri_control::BaseTwist& base, const phri_control::VectorJoints& rates) noexcept;
  /// Opens or closes the acting gripper: way of each jaw from the middle [m]. Ignored without a gripper.
  void grip(double opening) noexcept;
  /// Joint torques beside the servos, for World::step: what gravity and motion ask for.
  const Eigen::VectorXd& torques() noexcept;
  /// Reads encoders, odometry and the wrist sensor, after a step.
  void sense() noexcept;

  const phri_control::VectorJoints& joints() const { return q_; }        ///< of the arm [rad]
  const phri_control::BaseState& odometry() const { return odometry_; }  ///< believed
  Eigen::Vector3d base() const noexcept;                                 ///< where it really is [m, m, rad]
  const phri_control::Vector6d& wrenchRaw() const { return raw_; }       ///< in the sensor's frame [N, Nm]
  double period() const { return dt_; }
  bool mobile() const { return base_[0] >= 0; }

private:
  phri_control::BaseTwist baseTwist() const noexcept;

  World* world_;
  int sensor_;
  double dt_;
  std::vector<int> arm_, fingers_;
  std::array<int, 3> base_{ -1, -1, -1 };
  phri_control::VectorJoints q_, reference_;
  phri_control::BaseState odometry_;
  phri_control::BaseTwist scale_;  // what odometry reads of a unit motion
  double turning_ = 0.0;           // [rad/m] it believes to turn while driving straight
  FtSensor ft_;
  phri_control::Vector6d raw_;
  Eigen::VectorXd torque_, zero_;
};
}  // namespace phri_sim
