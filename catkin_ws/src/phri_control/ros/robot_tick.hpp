#pragma once
#include <cstdint>

#include "phri_control/interaction_loop.hpp"
#include "phri_control/payload.hpp"
#include "phri_control/whole_body.hpp"
#include "phri_core/mailbox.hpp"

namespace phri_control
{
/// Newest readings of a robot. Times are of the clock that RobotTick::step is given [ns].
struct JointSample
{
  VectorJoints position, velocity;  ///< in the chain's order [rad, rad/s]
  std::int64_t receive_ns = 0;
};
struct WrenchSample
{
  Vector6d wrench = Vector6d::Zero();  ///< bias and payload removed, in the sensor's frame [N, Nm]
  std::int64_t receive_ns = 0;
  std::int64_t stamp_ns = 0;   ///< when it was measured
  std::uint64_t sequence = 0;  ///< counts from 1; 0: nothing came yet
  bool right_frame = true;     ///< false: it came in another frame than the sensor's; its numbers mean nothing
};
struct OdometrySample
{
  BaseState state;
  std::int64_t receive_ns = 0;
};

/// What stands in the way of motion. What comes first in this order counts.
enum class Hindrance : std::uint8_t
{
  None,
  NoJoints,     ///< none yet, or not finite
  JointsStale,  ///< older than `joint_age`
  NoOdometry,
  OdometryStale,
  NotFollowing  ///< the tool was farther than `following_error` from where it was told to be
};

struct RobotTickSettings
{
  bool planar = true;  ///< coordinates [x, y, yaw] at constant height, else [x, y, z] at constant orientation
  bool mobile = false;
  bool dry_run = false;               ///< everything but motion: the velocities given out are zero
  double joint_age = 0.02;            ///< [s] largest
  double odometry_age = 0.1;          ///< [s]
  double following_error = 0.05;      ///< [m] largest; 1 rad counts as `WholeBodySettings::inverse.length`
  double stop_time = 0.1;             ///< [s] in which an ordered stop brings the velocities to zero
  bool origin_fixed = false;          ///< false: the origin is where the tool stands when the interaction starts
  Eigen::Vector3d origin{ 0, 0, 0 };  ///< of the coordinates and of the workspace, in the inertial frame [m]
};

/// What a cycle gives out. Plain data of fixed size.
struct RobotOutput
{
  TickRecord record;
  VectorJoints rates;                  ///< for the arm [rad/s]
  BaseTwist base = BaseTwist::Zero();  ///< for the base, in its axes [m/s, rad/s]
  Twist tool = Twist::Zero();          ///< motion of the tip that `rates` make, in axes of the chain's base link
  Twist commanded = Twist::Zero();     ///< of the tip in inertial axes, as the admittance wants it
  Twist measured = Twist::Zero();      ///< likewise, from encoders and odometry; zero while not located
  Eigen::Isometry3d tip = Eigen::Isometry3d::Identity();  ///< in the inertial frame, as last measured
  Eigen::Vector3d origin{ 0, 0, 0 };                      ///< of the coordinates, in the inertial frame [m]
  Hindrance hindrance = Hindrance::NoJoints;
  Hindrance cause = Hindrance::None;           ///< of the present E_POSITION_INVALID
  double joint_age = 0.0, odometry_age = 0.0;  ///< [s] of the newest samples; negative: none yet
  double error = 0.0;                          ///< [m] of following, rotations weighted
  bool wrench_seen = false, right_frame = true;
  double stamp_age = 0.0;  ///< [s] of the newest wrench on arrival
};

/// Turns the InteractionLoop into something that a robot can be driven with by velocities: readings in, joint rates (or
/// the tool's twist) and the base's twist out, once per `loop.dt`.
///
/// Frames: the inertial frame is that of the odometry, or the chain's base link for a robot that stands. Coordinates
/// are those of the tip in inertial axes, relative to `origin`; yaw is counted from the orientation that the tip has
/// when the interaction starts, and the height (planar) or orientation (point) of that moment is kept. While IDLE the
/// coordinates follow the tool, so that a start never makes it jump, wherever somebody drove it meanwhile.
///
/// Velocities out are zero in INIT and IDLE (after an ordered stop: by a ramp of `stop_time`) and, at once, as soon as
/// the robot cannot be located; that is E_POSITION_INVALID where the interaction runs. In any other FAULT the loop's
/// own damped stop is followed for kFaultStop, then they are zero.
///
/// `step` is noexcept and allocates nothing. Each `post` may be called from one other thread.
class RobotTick
{
public:
  static constexpr double kFaultStop = 0.5;  ///< [s]

  /// `sensor`: pose of the force sensor's frame in the tip's. Throws std::invalid_argument like InteractionLoop and
  /// WholeBody, or if the loop's number of coordinates is not 3.
  RobotTick(const RobotTickSettings& settings, const LoopSettings& loop, const ArmKinematics& arm,
            const WholeBodySettings& body, const Eigen::Isometry3d& sensor);

  void post(const JointSample& sample) { joint_box_.post(sample); }
  void post(const WrenchSample& sample) { wrench_box_.post(sample); }
  void post(const OdometrySample& sample) { odometry_box_.post(sample); }

  const RobotOutput& step(std::int64_t now_ns, double lateness = 0.0) noexcept;
  InteractionLoop& loop() { return loop_; }

private:
  void take() noexcept;
  Hindrance locate(std::int64_t now_ns) noexcept;
  phri_core::VectorDof coordinates() noexcept;
  phri_core::Measurement measurement(bool located) noexcept;
  void drive(const phri_core::Command& command, bool located) noexcept;

  RobotTickSettings settings_;
  LoopSettings loop_settings_;
  InteractionLoop loop_;
  WholeBody body_;
  Eigen::Isometry3d sensor_;
  phri_core::Mailbox<JointSample> joint_box_;
  phri_core::Mailbox<WrenchSample> wrench_box_;
  phri_core::Mailbox<OdometrySample> odometry_box_;
  JointSample joints_;
  WrenchSample wrench_;
  OdometrySample odometry_;
  BaseState base_;  // odometry, carried on to the present

  Eigen::Matrix3d level_ = Eigen::Matrix3d::Identity();
  double height_ = 0.0, yaw_ = 0.0;
  double stopping_ = 0.0, faulty_for_ = 0.0;  // [s] left of the ramp; since the fault
  VectorJoints last_rates_;
  BaseTwist last_base_ = BaseTwist::Zero();
  RobotOutput output_;
};
}  // namespace phri_control
