#include "phri_control/kinematics.hpp"

#include <urdf_parser/urdf_parser.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <kdl/segment.hpp>
#include <stdexcept>

#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
using Matrix6 = Eigen::Matrix<double, 6, 6>;

KDL::Frame toKdl(const urdf::Pose& pose)
{
  double x, y, z, w;
  pose.rotation.getQuaternion(x, y, z, w);
  return { KDL::Rotation::Quaternion(x, y, z, w), KDL::Vector(pose.position.x, pose.position.y, pose.position.z) };
}

Eigen::Vector3d toEigen(const KDL::Vector& v)
{
  return { v.x(), v.y(), v.z() };
}

[[noreturn]] void refuse(const std::string& message)
{
  throw std::invalid_argument("arm kinematics: " + message);
}

/// Joints from `tip` up to `base`, in order from base to tip.
std::vector<urdf::JointConstSharedPtr> path(const urdf::ModelInterface& model, const std::string& base,
                                            const std::string& tip)
{
  for (const std::string& name : { base, tip })
  {
    if (!model.getLink(name))
    {
      std::vector<std::string> known;
      for (const auto& link : model.links_)
        known.push_back(link.first);
      const std::string candidate = phri_core::closest(name, known);
      refuse("no link '" + name + "' in '" + model.getName() + "'" +
             (candidate.empty() ? "" : ", did you mean '" + candidate + "'?"));
    }
  }
  std::vector<urdf::JointConstSharedPtr> joints;
  for (urdf::LinkConstSharedPtr link = model.getLink(tip); link->name != base; link = link->getParent())
  {
    if (!link->parent_joint)
      refuse("link '" + tip + "' is not below '" + base + "'");
    joints.insert(joints.begin(), link->parent_joint);
  }
  return joints;
}

}  // namespace

ArmKinematics::ArmKinematics(const std::string& urdf, const std::string& base_link, const std::string& tip_link)
{
  const urdf::ModelInterfaceSharedPtr model = urdf::parseURDF(urdf);
  if (!model)
    refuse("the text is no valid URDF (" + std::to_string(urdf.size()) + " characters)");
  std::vector<double> lower, upper, velocity;
  KDL::Frame fixed = KDL::Frame::Identity();
  for (const urdf::JointConstSharedPtr& joint : path(*model, base_link, tip_link))
  {
    fixed = fixed * toKdl(joint->parent_to_joint_origin_transform);
    if (joint->type == urdf::Joint::FIXED)
      continue;
    const bool endless = joint->type == urdf::Joint::CONTINUOUS;
    if (!endless && joint->type != urdf::Joint::REVOLUTE)
      refuse("joint '" + joint->name + "' neither turns nor is fixed");
    if (!joint->limits || !(joint->limits->velocity > 0.0))
      refuse("joint '" + joint->name + "' has no largest velocity above 0 rad/s");
    const double low = endless ? -HUGE_VAL : joint->limits->lower, high = endless ? HUGE_VAL : joint->limits->upper;
    if (!(low < high))
      refuse("limits of joint '" + joint->name + "' are not in order: " + std::to_string(low) + " rad to " +
             std::to_string(high) + " rad");
    const KDL::Vector axis(joint->axis.x, joint->axis.y, joint->axis.z);
    if (!(axis.Norm() > 1e-6))
      refuse("axis of joint '" + joint->name + "' has no direction");
    chain_.addSegment(KDL::Segment(joint->child_link_name,
                                   KDL::Joint(joint->name, fixed.p, fixed.M * axis, KDL::Joint::RotAxis), fixed));
    names_.push_back(joint->name);
    lower.push_back(low);
    upper.push_back(high);
    velocity.push_back(joint->limits->velocity);
    fixed = KDL::Frame::Identity();
  }
  chain_.addSegment(KDL::Segment(tip_link, KDL::Joint(tip_link + "_fixed", KDL::Joint::Fixed), fixed));
  if (names_.empty() || names_.size() > kMaxArmJoints)
    refuse("from '" + base_link + "' to '" + tip_link + "' there are " + std::to_string(names_.size()) +
           " joints, expected 1 to " + std::to_string(kMaxArmJoints));
  lower_ = Eigen::Map<Eigen::VectorXd>(lower.data(), joints());
  upper_ = Eigen::Map<Eigen::VectorXd>(upper.data(), joints());
  velocity_ = Eigen::Map<Eigen::VectorXd>(velocity.data(), joints());
}

Eigen::Isometry3d ArmKinematics::forward(const VectorJoints& q) const noexcept
{
  ArmJacobian unused;
  return forward(q, unused);
}

Eigen::Isometry3d ArmKinematics::forward(const VectorJoints& q, ArmJacobian& jacobian) const noexcept
{
  jacobian.resize(6, joints());
  KDL::Frame frame = KDL::Frame::Identity();
  for (int i = 0; i < joints(); ++i)
  {
    const KDL::Segment& segment = chain_.segments[static_cast<std::size_t>(i)];
    jacobian.col(i) << toEigen(frame * segment.getJoint().JointOrigin()),
        toEigen(frame.M * segment.getJoint().JointAxis());
    frame = frame * segment.pose(q(i));
  }
  frame = frame * chain_.segments.back().pose(0.0);
  Eigen::Isometry3d tip = Eigen::Isometry3d::Identity();
  tip.linear() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(frame.M.data);
  tip.translation() = toEigen(frame.p);
  for (int i = 0; i < joints(); ++i)
  {
    const Eigen::Vector3d arm = tip.translation() - jacobian.col(i).head<3>();
    jacobian.col(i).head<3>() = Eigen::Vector3d(jacobian.col(i).tail<3>()).cross(arm);
  }
  return tip;
}

double manipulability(const ArmJacobian& jacobian) noexcept
{
  const Matrix6 square = jacobian.lazyProduct(jacobian.transpose());
  return std::sqrt(std::max(0.0, square.determinant()));
}

VectorJoints manipulabilityGradient(const ArmJacobian& jacobian) noexcept
{
  const Eigen::Index n = jacobian.cols();
  VectorJoints gradient = VectorJoints::Zero(n);
  const Matrix6 square = jacobian.lazyProduct(jacobian.transpose());
  const Eigen::LDLT<Matrix6> factor(square);
  const double measure = std::sqrt(std::max(0.0, square.determinant()));
  if (!(measure > 0.0) || factor.info() != Eigen::Success || !factor.isPositive())
    return gradient;
  const ArmJacobian dual = factor.solve(jacobian);  // (J J')^-1 J
  // w' = w tr(J^+ J'): column i of the Jacobian turns with every joint before it, and its lever changes with those
  // after
  for (Eigen::Index k = 0; k < n; ++k)
  {
    const Eigen::Vector3d axis = jacobian.col(k).tail<3>(), motion = jacobian.col(k).head<3>();
    for (Eigen::Index i = 0; i < n; ++i)
    {
      const Eigen::Vector3d axis_i = jacobian.col(i).tail<3>(), motion_i = jacobian.col(i).head<3>();
      const Eigen::Vector3d change = k <= i ? axis.cross(motion_i) : axis_i.cross(motion);
      gradient(k) += dual.col(i).head<3>().dot(change);
      if (k < i)
        gradient(k) += dual.col(i).tail<3>().dot(axis.cross(axis_i));
    }
  }
  return measure * gradient;
}

Twist poseError(const Eigen::Isometry3d& desired, const Eigen::Isometry3d& actual) noexcept
{
  Twist error;
  error.head<3>() = desired.translation() - actual.translation();
  const Eigen::Quaterniond turn(Eigen::Matrix3d(desired.linear().lazyProduct(actual.linear().transpose())));
  const double sine = turn.vec().norm(), sign = turn.w() < 0.0 ? -1.0 : 1.0;
  // for small angles 2 atan2(s, c) / s tends to 2
  error.tail<3>() = (sine > 1e-12 ? sign * 2.0 * std::atan2(sine, std::abs(turn.w())) / sine : 2.0 * sign) * turn.vec();
  return error;
}

VelocityBounds jointFunnel(const ArmKinematics& arm, const VectorJoints& q, double acceleration, double margin,
                           double dt) noexcept
{
  const auto bound = [&](double distance, double velocity) {
    if (!(distance > 0.0))
      return 0.0;
    return std::min(velocity, acceleration * (std::sqrt(dt * dt + 2.0 * distance / acceleration) - dt));
  };
  VelocityBounds bounds{ VectorJoints(arm.joints()), VectorJoints(arm.joints()) };
  for (int i = 0; i < arm.joints(); ++i)
  {
    bounds.lower(i) = -bound(q(i) - arm.lower()(i) - margin, arm.velocity()(i));
    bounds.upper(i) = bound(arm.upper()(i) - margin - q(i), arm.velocity()(i));
  }
  return bounds;
}

}  // namespace phri_control
