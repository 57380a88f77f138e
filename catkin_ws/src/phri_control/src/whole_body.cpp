#include "phri_control/whole_body.hpp"

#include <stdexcept>
#include <string>

namespace phri_control
{
Eigen::Isometry3d BaseState::transform() const noexcept
{
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.linear() = Eigen::AngleAxisd(pose.z(), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  result.translation() << pose.x(), pose.y(), 0.0;
  return result;
}

EndEffectorCommand planarCommand(const phri_core::VectorDof& position, const phri_core::VectorDof& velocity,
                                 double height, const Eigen::Matrix3d& level) noexcept
{
  EndEffectorCommand command;
  command.pose.linear() = Eigen::AngleAxisd(position(2), Eigen::Vector3d::UnitZ()).toRotationMatrix() * level;
  command.pose.translation() << position(0), position(1), height;
  command.twist << velocity(0), velocity(1), 0.0, 0.0, 0.0, velocity(2);
  return command;
}

EndEffectorCommand pointCommand(const phri_core::VectorDof& position, const phri_core::VectorDof& velocity,
                                const Eigen::Matrix3d& orientation) noexcept
{
  EndEffectorCommand command;
  command.pose.linear() = orientation;
  command.pose.translation() = position.head<3>();
  command.twist.head<3>() = velocity.head<3>();
  return command;
}

WholeBody::WholeBody(const ArmKinematics& arm, const WholeBodySettings& settings)
  : inverse_(arm, settings.inverse), coordination_(settings.coordination), base_moves_(settings.base_moves)
{
  if (settings.inverse.dt != settings.coordination.dt)
    throw std::invalid_argument("dt: inverse " + std::to_string(settings.inverse.dt) + " s, coordination " +
                                std::to_string(settings.coordination.dt) + " s, expected the same");
}

WholeBodyCommand WholeBody::update(const VectorJoints& q, const BaseState& base,
                                   const EndEffectorCommand& command) noexcept
{
  WholeBodyCommand result;
  result.arm.velocity = VectorJoints::Zero(inverse_.arm().joints());
  if (q.size() != inverse_.arm().joints() || !q.allFinite() || !base.pose.allFinite() || !base.twist.allFinite() ||
      !command.pose.matrix().allFinite() || !command.twist.allFinite())
  {
    result.base = coordination_.brake();
    return result;
  }
  ArmJacobian jacobian;
  const Eigen::Isometry3d tip = inverse_.arm().forward(q, jacobian), frame = base.transform();
  const Eigen::Matrix3d to_base = frame.linear().transpose();
  Eigen::Isometry3d goal = Eigen::Isometry3d::Identity();
  goal.linear() = to_base * command.pose.linear();
  goal.translation() = to_base * (command.pose.translation() - frame.translation());
  Twist twist;
  twist << to_base * command.twist.head<3>(), to_base * command.twist.tail<3>();
  const Eigen::Vector3d motion(twist(0), twist(1), twist(5));
  const double turn = base.twist.z();
  twist.head<3>() -= Eigen::Vector3d(base.twist.x() - turn * tip.translation().y(),
                                     base.twist.y() + turn * tip.translation().x(), 0.0);
  twist(5) -= turn;
  result.arm = inverse_.solve(q, tip, jacobian, goal, twist);
  result.end_effector = frame * tip;
  result.error = poseError(command.pose, result.end_effector);
  result.base = base_moves_ ? coordination_.update(tip, motion) : coordination_.brake();
  return result;
}
}  // namespace phri_control
