#include "robot_tick.hpp"

#include <cmath>
#include <limits>

#include "phri_control/force_sensor.hpp"
#include "phri_core/check.hpp"

namespace phri_control
{
using phri_core::LoopState;
using phri_core::VectorDof;

namespace
{
constexpr double kNanosecond = 1e-9;

/// Where the base is `dt` [s] after its odometry was read.
BaseState carryOn(const BaseState& state, double dt) noexcept
{
  BaseState result = state;
  const double middle = state.pose.z() + 0.5 * dt * state.twist.z(), c = std::cos(middle), s = std::sin(middle);
  result.pose.x() += dt * (c * state.twist.x() - s * state.twist.y());
  result.pose.y() += dt * (s * state.twist.x() + c * state.twist.y());
  result.pose.z() += dt * state.twist.z();
  return result;
}

bool resting(LoopState state) noexcept
{
  return state == LoopState::Idle || state == LoopState::Init;
}
}  // namespace

RobotTick::RobotTick(const RobotTickSettings& settings, const LoopSettings& loop, const ArmKinematics& arm,
                     const WholeBodySettings& body, const Eigen::Isometry3d& sensor)
  : settings_(settings), loop_settings_(loop), loop_(loop), body_(arm, body), sensor_(sensor)
{
  phri_core::requireRange("number of coordinates", double(loop.mass.size()), 3, 3, "");
  phri_core::requireRange("watchdog/joint_age", settings.joint_age, 1e-3, 1.0, "s");
  phri_core::requireRange("watchdog/odometry_age", settings.odometry_age, 1e-3, 1.0, "s");
  phri_core::requireRange("watchdog/following_error", settings.following_error, 1e-3, 1.0, "m");
  phri_core::requireRange("stop_time", settings.stop_time, 1e-3, 1.0, "s");
  joints_.position = joints_.velocity = last_rates_ = output_.rates = VectorJoints::Zero(arm.joints());
  output_.record = loop_.record();
  output_.joint_age = output_.odometry_age = -1.0;
  output_.origin = settings.origin;
}

void RobotTick::take() noexcept
{
  const JointSample* joints = joint_box_.take();
  if (joints && joints->position.size() == joints_.position.size())
    joints_ = *joints;
  if (const WrenchSample* newer = wrench_box_.take())
    wrench_ = *newer;
  if (const OdometrySample* newer = odometry_box_.take())
    odometry_ = *newer;
  output_.wrench_seen = wrench_.sequence > 0;
  output_.right_frame = wrench_.right_frame;
  output_.stamp_age = (wrench_.receive_ns - wrench_.stamp_ns) * kNanosecond;
}

Hindrance RobotTick::locate(std::int64_t now_ns) noexcept
{
  const bool joints_seen = joints_.receive_ns != 0, odometry_seen = odometry_.receive_ns != 0;
  output_.joint_age = joints_seen ? (now_ns - joints_.receive_ns) * kNanosecond : -1.0;
  output_.odometry_age = odometry_seen ? (now_ns - odometry_.receive_ns) * kNanosecond : -1.0;
  if (!joints_seen || !joints_.position.allFinite())
    return Hindrance::NoJoints;
  if (output_.joint_age > settings_.joint_age)
    return Hindrance::JointsStale;
  if (settings_.mobile)
  {
    if (!odometry_seen || !odometry_.state.pose.allFinite() || !odometry_.state.twist.allFinite())
      return Hindrance::NoOdometry;
    if (output_.odometry_age > settings_.odometry_age)
      return Hindrance::OdometryStale;
    base_ = carryOn(odometry_.state, output_.odometry_age);
  }
  ArmJacobian jacobian;
  const Eigen::Isometry3d tip = body_.inverse().arm().forward(joints_.position, jacobian), frame = base_.transform();
  output_.tip = frame * tip;
  Twist twist = Twist::Zero();
  if (joints_.velocity.size() == joints_.position.size() && joints_.velocity.allFinite())
    twist = jacobian.lazyProduct(joints_.velocity);
  const BaseTwist& b = base_.twist;
  twist.head<3>() += Eigen::Vector3d(b.x() - b.z() * tip.translation().y(), b.y() + b.z() * tip.translation().x(), 0.0);
  twist(5) += b.z();
  output_.measured.head<3>() = frame.linear() * twist.head<3>();
  output_.measured.tail<3>() = frame.linear() * twist.tail<3>();
  return Hindrance::None;
}

VectorDof RobotTick::coordinates() noexcept
{
  VectorDof x(3);
  x = output_.tip.translation() - output_.origin;
  if (settings_.planar)
  {
    const Eigen::Matrix3d turned = output_.tip.linear() * level_.transpose();
    yaw_ += std::remainder(std::atan2(turned(1, 0), turned(0, 0)) - yaw_, 2.0 * M_PI);
    x(2) = yaw_;
  }
  return x;
}

phri_core::Measurement RobotTick::measurement(bool located) noexcept
{
  Eigen::Isometry3d sensor = Eigen::Isometry3d::Identity();  // in inertial axes, from the tip's origin
  sensor.linear() = output_.tip.linear() * sensor_.linear();
  sensor.translation() = output_.tip.linear() * sensor_.translation();
  const Vector6d at_tip = transformWrench(sensor, wrench_.wrench);
  phri_core::Measurement m;
  m.receive_ns = wrench_.receive_ns;
  m.stamp_ns = wrench_.stamp_ns;
  m.sequence = wrench_.sequence;
  m.frame = wrench_.right_frame ? 0 : 1;
  m.human_wrench.resize(3);
  m.human_wrench << at_tip(0), at_tip(1), at_tip(settings_.planar ? 5 : 2);
  m.environment_wrench = VectorDof::Zero(3);
  m.position = located ? coordinates() : VectorDof(VectorDof::Constant(3, std::numeric_limits<double>::quiet_NaN()));
  return m;
}

void RobotTick::drive(const phri_core::Command& command, bool located) noexcept
{
  const LoopState state = output_.record.state;
  const double dt = loop_settings_.dt;
  faulty_for_ = state == LoopState::Fault ? faulty_for_ + dt : 0.0;
  const bool coasting = faulty_for_ <= kFaultStop && output_.record.fault != phri_core::FaultCode::PositionInvalid;
  output_.rates.setZero();
  output_.base.setZero();
  output_.commanded.setZero();
  output_.error = 0.0;
  if (located && (state == LoopState::Fault ? coasting : !resting(state)))
  {
    VectorDof position = command.position;
    position.head(settings_.planar ? 2 : 3) += output_.origin.head(settings_.planar ? 2 : 3);
    const EndEffectorCommand wanted = settings_.planar ? planarCommand(position, command.velocity, height_, level_)
                                                       : pointCommand(position, command.velocity, level_);
    const WholeBodyCommand motion = body_.update(joints_.position, base_, wanted);
    const double length = body_.inverse().settings().length;
    output_.error = std::hypot(motion.error.head<3>().norm(), length * motion.error.tail<3>().norm());
    output_.commanded = wanted.twist;
    output_.rates = motion.arm.velocity;
    output_.base = motion.base;
    stopping_ = settings_.stop_time;
  }
  else if (located && resting(state) && stopping_ > dt)
  {
    const double share = (stopping_ - dt) / stopping_;
    output_.rates = share * last_rates_;
    output_.base = share * last_base_;
    stopping_ -= dt;
  }
  else
  {
    stopping_ = 0.0;
    body_.reset();
  }
  if (settings_.dry_run)
  {
    output_.rates.setZero();
    output_.base.setZero();
  }
  last_rates_ = output_.rates;
  last_base_ = output_.base;
  ArmJacobian jacobian;
  body_.inverse().arm().forward(joints_.position, jacobian);
  output_.tool = jacobian.lazyProduct(output_.rates);
}

const RobotOutput& RobotTick::step(std::int64_t now_ns, double lateness) noexcept
{
  take();
  const bool strayed = output_.hindrance == Hindrance::None && !settings_.dry_run &&
                       output_.record.state != LoopState::Fault && output_.error > settings_.following_error;
  output_.hindrance = locate(now_ns);
  const bool located = output_.hindrance == Hindrance::None;
  if (!located)
    output_.measured.setZero();
  if (located && resting(output_.record.state))
  {
    level_ = output_.tip.linear();
    height_ = output_.tip.translation().z();
    yaw_ = 0.0;
    if (!settings_.origin_fixed)
      output_.origin = output_.tip.translation();
    loop_.place(coordinates());
  }
  if (located && strayed)
    output_.hindrance = Hindrance::NotFollowing;
  const phri_core::Command command = loop_.tick(measurement(located && !strayed), now_ns, lateness);
  output_.record = loop_.record();
  if (output_.record.fault != phri_core::FaultCode::PositionInvalid)
    output_.cause = Hindrance::None;
  else if (output_.cause == Hindrance::None)
    output_.cause = output_.hindrance;
  drive(command, located);
  return output_;
}
}  // namespace phri_control
