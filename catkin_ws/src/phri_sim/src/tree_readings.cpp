// What can be read of a TreeDynamics: poses, velocities, Jacobians, accelerations, wrenches, energy and momentum.
#include <limits>

#include "phri_sim/tree_dynamics.hpp"

namespace phri_sim
{
using Eigen::Matrix3d;
using Eigen::Vector3d;

Eigen::Isometry3d TreeDynamics::bodyPose(int body) const noexcept
{
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = bodies_[std::size_t(body + 1)].rotation;
  pose.translation() = bodies_[std::size_t(body + 1)].origin;
  return pose;
}

Eigen::Isometry3d TreeDynamics::linkPose(int link) const noexcept
{
  const TreeLink& fixed = model_->links()[std::size_t(link)];
  const Body& body = bodyOf(link);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear().noalias() = body.rotation.lazyProduct(fixed.pose.linear());
  pose.translation() = body.origin + body.rotation * fixed.pose.translation();
  return pose;
}

Vector6 TreeDynamics::linkVelocity(int link) const noexcept
{
  const Body& body = bodyOf(link);
  const Vector3d arm = body.rotation * model_->links()[std::size_t(link)].pose.translation();
  Vector6 velocity;
  velocity << body.velocity + body.spin.cross(arm), body.spin;
  return velocity;
}

Vector3d TreeDynamics::pointVelocity(int link, const Vector3d& point) const noexcept
{
  const Body& body = bodyOf(link);
  return body.velocity + body.spin.cross(point - body.origin);
}

void TreeDynamics::jacobian(int link, const Vector3d& point, Eigen::Ref<Jacobian> jacobian) const noexcept
{
  jacobian.setZero();
  for (int i = model_->links()[std::size_t(link)].body; i >= 0; i = model_->bodies()[std::size_t(i)].parent)
  {
    const Body& body = bodies_[std::size_t(i + 1)];
    const Vector3d axis = body.rotation.col(2);
    if (model_->bodies()[std::size_t(i)].revolute)
      jacobian.col(i) << axis.cross(point - body.origin), axis;
    else
      jacobian.col(i).head<3>() = axis;
  }
}

void TreeDynamics::requireAccelerations() noexcept
{
  if (!stale_)
    return;
  accelerate(qdd_.data(), Vector3d::Zero());
  stale_ = false;
}

Vector6 TreeDynamics::jointWrench(int fixed_joint) noexcept
{
  if (!accelerated_)
    return Vector6::Constant(std::numeric_limits<double>::quiet_NaN());
  requireAccelerations();
  const TreeFixedJoint& joint = model_->fixedJoints()[std::size_t(fixed_joint)];
  const Eigen::Isometry3d frame = linkPose(joint.link);
  const Vector3d gravity = model_->options().gravity;
  Vector3d force = Vector3d::Zero(), torque = Vector3d::Zero();  // about the frame's origin
  const auto addLump = [&](const Body& body, double mass, const Vector3d& moment, const Matrix3d& inertia) {
    const Vector3d fall = body.acceleration - gravity;
    const Vector3d lump_force =
        mass * fall + body.spin_acceleration.cross(moment) + body.spin.cross(body.spin.cross(moment));
    force += lump_force;
    torque += inertia * body.spin_acceleration + body.spin.cross(inertia * body.spin) + moment.cross(fall) +
              (body.origin - frame.translation()).cross(lump_force);
  };
  const Body& own = bodyOf(joint.link);
  addLump(own, joint.beyond.mass, own.rotation * joint.beyond.moment,
          own.rotation * joint.beyond.inertia * own.rotation.transpose());
  for (const int i : joint.bodies_beyond)
  {
    const Body& body = bodies_[std::size_t(i + 1)];
    addLump(body, model_->bodies()[std::size_t(i)].inertia.mass, body.moment, body.inertia);
  }
  for (std::size_t l = std::size_t(joint.link); l < wrenches_.size(); ++l)
  {
    if (!joint.links_beyond[l])
      continue;
    force -= wrenches_[l].force;
    torque -= wrenches_[l].torque + (bodyOf(int(l)).origin - frame.translation()).cross(wrenches_[l].force);
  }
  Vector6 wrench;
  wrench << frame.linear().transpose() * force, frame.linear().transpose() * torque;
  return wrench;
}

Vector6 TreeDynamics::linkAcceleration(int link) noexcept
{
  if (!accelerated_)
    return Vector6::Constant(std::numeric_limits<double>::quiet_NaN());
  requireAccelerations();
  const Body& body = bodyOf(link);
  const Vector3d arm = body.rotation * model_->links()[std::size_t(link)].pose.translation();
  Vector6 acceleration;
  acceleration << body.acceleration + body.spin_acceleration.cross(arm) + body.spin.cross(body.spin.cross(arm)),
      body.spin_acceleration;
  return acceleration;
}

double TreeDynamics::kineticEnergy() const noexcept
{
  double twice = 0.0;
  for (std::size_t i = 1; i < bodies_.size(); ++i)
  {
    const Body& body = bodies_[i];
    twice += model_->bodies()[i - 1].inertia.mass * body.velocity.squaredNorm() +
             2.0 * body.velocity.dot(body.spin.cross(body.moment)) + body.spin.dot(body.inertia * body.spin) +
             model_->joints()[i - 1].armature * qd_[Eigen::Index(i) - 1] * qd_[Eigen::Index(i) - 1];
  }
  return 0.5 * twice;
}

double TreeDynamics::potentialEnergy() const noexcept
{
  double energy = 0.0;
  for (std::size_t i = 1; i < bodies_.size(); ++i)
    energy -=
        model_->options().gravity.dot(model_->bodies()[i - 1].inertia.mass * bodies_[i].origin + bodies_[i].moment);
  return energy;
}

Vector6 TreeDynamics::momentum(const Vector3d& point) const noexcept
{
  Vector6 sum = Vector6::Zero();
  for (std::size_t i = 1; i < bodies_.size(); ++i)
  {
    const Body& body = bodies_[i];
    const Vector3d linear = model_->bodies()[i - 1].inertia.mass * body.velocity + body.spin.cross(body.moment);
    sum.head<3>() += linear;
    sum.tail<3>() += body.inertia * body.spin + body.moment.cross(body.velocity) + (body.origin - point).cross(linear);
  }
  return sum;
}
}  // namespace phri_sim
