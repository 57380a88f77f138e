#include "phri_sim/tree_dynamics.hpp"

#include <cmath>
#include <utility>

namespace phri_sim
{
namespace
{
using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Inertia about a point from which the old one lies at `arm`, of a lump with `mass` and first moment `moment` about
/// the old point: added to `sum`.
void addShifted(const Matrix3d& inertia, double mass, const Vector3d& moment, const Vector3d& arm, Matrix3d& sum)
{
  const Vector3d half = moment + 0.5 * mass * arm;  // symmetric split of moment arm^T + arm moment^T + mass arm arm^T
  const double trace = 2.0 * half.dot(arm);
  for (int c = 0; c < 3; ++c)
  {
    for (int r = 0; r < 3; ++r)
      sum(r, c) += inertia(r, c) - half[r] * arm[c] - arm[r] * half[c];
    sum(c, c) += trace;
  }
}

/// R I R^T of a symmetric I.
void rotateInertia(const Matrix3d& rotation, const Matrix3d& inertia, Matrix3d& rotated)
{
  Matrix3d half;
  half.noalias() = rotation.lazyProduct(inertia);
  for (int c = 0; c < 3; ++c)
  {
    for (int r = 0; r <= c; ++r)
      rotated(r, c) = rotated(c, r) =
          half(r, 0) * rotation(c, 0) + half(r, 1) * rotation(c, 1) + half(r, 2) * rotation(c, 2);
  }
}
}  // namespace

TreeDynamics::TreeDynamics(std::shared_ptr<const TreeModel> model, int max_rows)
  : model_(std::move(model)),
    bodies_(model_->bodies().size() + 1),
    wrenches_(model_->links().size()),
    drives_(model_->bodies().size()),
    row_(std::size_t(max_rows))
{
  const int dofs = model_->dofs();
  for (Eigen::VectorXd* vector : { &q_, &qd_, &qdd_, &scratch_, &start_q_, &start_qd_, &sum_q_, &sum_qd_,
                                   &inverse_pivot_, &implicit_, &joint_force_ })
    vector->setZero(dofs);
  for (int i = 0; i < dofs; ++i)
  {
    begin_.push_back(int(ancestors_.size()));
    const int parent = model_->bodies()[std::size_t(i)].parent;
    if (parent >= 0)
    {
      const std::size_t first = std::size_t(begin_[std::size_t(parent)]);
      for (int d = 0; d <= depth_[std::size_t(parent)]; ++d)
        ancestors_.push_back(ancestors_[first + std::size_t(d)]);
    }
    ancestors_.push_back(i);
    depth_.push_back(int(ancestors_.size()) - 1 - begin_.back());
  }
  mass_.setZero(Eigen::Index(ancestors_.size()));
  factor_.setZero(Eigen::Index(ancestors_.size()));
  row_jacobian_.setZero(dofs, max_rows);
  row_factor_.setZero(dofs, max_rows);
  delassus_.setZero(max_rows, max_rows);

  Body& world = bodies_.front();
  world.rotation.setIdentity();
  for (Vector3d* vector : { &world.origin, &world.arm, &world.velocity, &world.spin, &world.bias, &world.bias_spin,
                            &world.acceleration, &world.spin_acceleration, &world.moment })
    vector->setZero();
  world.inertia.setZero();
  clearWrenches();
  updateKinematics();
}

void TreeDynamics::setState(const VectorRef& q, const VectorRef& qd) noexcept
{
  q_ = q;
  qd_ = qd;
  updateKinematics();
}

void TreeDynamics::updateKinematics() noexcept
{
  accelerated_ = false;
  for (int i = 0; i < dofs(); ++i)
  {
    const TreeBody& fixed = model_->bodies()[std::size_t(i)];
    const Body& parent = bodies_[std::size_t(fixed.parent + 1)];
    Body& body = bodies_[std::size_t(i + 1)];
    body.rotation.noalias() = parent.rotation.lazyProduct(fixed.rotation);
    body.arm.noalias() = parent.rotation.lazyProduct(fixed.origin);
    const Vector3d axis = body.rotation.col(2);
    if (fixed.revolute)
    {
      double sine, cosine;
      ::sincos(q_[i], &sine, &cosine);
      const Vector3d x = body.rotation.col(0), y = body.rotation.col(1);
      body.rotation.col(0) = cosine * x + sine * y;
      body.rotation.col(1) = cosine * y - sine * x;
      body.velocity = parent.velocity + parent.spin.cross(body.arm);
      body.spin = parent.spin + axis * qd_[i];
      body.bias = parent.spin.cross(parent.spin.cross(body.arm));
      body.bias_spin = parent.spin.cross(axis) * qd_[i];
    }
    else
    {
      body.arm += axis * q_[i];
      const Vector3d slide = axis * qd_[i];
      body.velocity = parent.velocity + parent.spin.cross(body.arm) + slide;
      body.spin = parent.spin;
      body.bias = parent.spin.cross(parent.spin.cross(body.arm) + 2.0 * slide);
      body.bias_spin.setZero();
    }
    body.origin = parent.origin + body.arm;
    body.moment.noalias() = body.rotation.lazyProduct(fixed.inertia.moment);
    rotateInertia(body.rotation, fixed.inertia.inertia, body.inertia);
  }
}

void TreeDynamics::accelerate(const double* qdd, const Vector3d& root) noexcept
{
  bodies_.front().acceleration = root;
  for (std::size_t i = 1; i < bodies_.size(); ++i)
  {
    const TreeBody& fixed = model_->bodies()[i - 1];
    const Body& parent = bodies_[std::size_t(fixed.parent + 1)];
    Body& body = bodies_[i];
    body.acceleration = parent.acceleration + parent.spin_acceleration.cross(body.arm) + body.bias;
    body.spin_acceleration = parent.spin_acceleration + body.bias_spin;
    if (qdd != nullptr)
      (fixed.revolute ? body.spin_acceleration : body.acceleration) += body.rotation.col(2) * qdd[i - 1];
  }
}

/// Newton and Euler for every body about its origin, then what its joint has to carry; the second half of RNEA.
void TreeDynamics::gatherForces(double* tau) noexcept
{
  for (std::size_t i = 1; i < bodies_.size(); ++i)
  {
    Body& body = bodies_[i];
    body.force = model_->bodies()[i - 1].inertia.mass * body.acceleration + body.spin_acceleration.cross(body.moment) +
                 body.spin.cross(body.spin.cross(body.moment)) - body.applied_force;
    body.torque = body.inertia.lazyProduct(body.spin_acceleration) +
                  body.spin.cross(body.inertia.lazyProduct(body.spin).eval()) + body.moment.cross(body.acceleration) -
                  body.applied_torque;
  }
  bodies_.front().force.setZero();  // the world gathers, too: nobody reads it
  bodies_.front().torque.setZero();
  for (std::size_t i = bodies_.size() - 1; i > 0; --i)
  {
    const TreeBody& fixed = model_->bodies()[i - 1];
    const Body& body = bodies_[i];
    Body& parent = bodies_[std::size_t(fixed.parent + 1)];
    tau[i - 1] = body.rotation.col(2).dot(fixed.revolute ? body.torque : body.force);
    parent.force += body.force;
    parent.torque += body.torque + body.arm.cross(body.force);
  }
}

void TreeDynamics::inverseDynamics(const VectorRef& qdd, Eigen::Ref<Eigen::VectorXd> tau) noexcept
{
  stale_ = true;
  accelerate(qdd.data(), -model_->options().gravity);
  gatherForces(tau.data());
  for (int i = 0; i < dofs(); ++i)
    tau[i] += model_->joints()[std::size_t(i)].armature * qdd[i];
}

void TreeDynamics::buildMassMatrix() noexcept
{
  for (std::size_t i = 1; i < bodies_.size(); ++i)
  {
    Body& body = bodies_[i];
    body.composite_mass = model_->bodies()[i - 1].inertia.mass;
    body.composite_moment = body.moment;
    body.composite_inertia = body.inertia;
  }
  for (std::size_t i = bodies_.size() - 1; i > 0; --i)
  {
    const TreeBody& fixed = model_->bodies()[i - 1];
    const Body& body = bodies_[i];
    const Vector3d axis = body.rotation.col(2);
    if (fixed.parent >= 0)
    {
      Body& parent = bodies_[std::size_t(fixed.parent + 1)];
      parent.composite_mass += body.composite_mass;
      parent.composite_moment += body.composite_moment + body.composite_mass * body.arm;
      addShifted(body.composite_inertia, body.composite_mass, body.composite_moment, body.arm,
                 parent.composite_inertia);
    }
    // momentum of what the joint carries at its unit speed, seen by all joints before it
    Vector3d force, torque;
    if (fixed.revolute)
    {
      force = axis.cross(body.composite_moment);
      torque.noalias() = body.composite_inertia.lazyProduct(axis);
    }
    else
    {
      force = body.composite_mass * axis;
      torque = body.composite_moment.cross(axis);
    }
    double* row = mass_.data() + begin_[i - 1];
    const int depth = depth_[i - 1];
    row[depth] = axis.dot(fixed.revolute ? torque : force) + model_->joints()[i - 1].armature;
    const Body* carried = &body;
    for (int d = depth - 1; d >= 0; --d)
    {
      const std::size_t j = std::size_t(ancestors_[std::size_t(begin_[i - 1] + d)]);
      torque += carried->arm.cross(force);
      carried = &bodies_[j + 1];
      row[d] = carried->rotation.col(2).dot(model_->bodies()[j].revolute ? torque : force);
    }
  }
}

void TreeDynamics::massMatrix(Eigen::Ref<Eigen::MatrixXd> mass) const noexcept
{
  mass.setZero();
  for (int i = 0; i < dofs(); ++i)
  {
    for (int d = 0; d <= depth_[std::size_t(i)]; ++d)
    {
      const int j = ancestors_[std::size_t(begin_[std::size_t(i)] + d)];
      mass(i, j) = mass(j, i) = mass_[begin_[std::size_t(i)] + d];
    }
  }
}
}  // namespace phri_sim
