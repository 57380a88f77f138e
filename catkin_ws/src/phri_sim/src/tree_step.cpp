// Forces on links, rows of contacts, the factor of the mass matrix and the integrators of TreeDynamics.
#include <algorithm>
#include <cmath>

#include "phri_sim/tree_dynamics.hpp"

namespace phri_sim
{
using Eigen::Vector3d;

void TreeDynamics::addForceAlong(int body, const Vector3d& point, const Vector3d& force, const Vector3d& torque,
                                 double* tau) const noexcept
{
  for (int i = body; i >= 0; i = model_->bodies()[std::size_t(i)].parent)
  {
    const Body& moved = bodies_[std::size_t(i + 1)];
    if (model_->bodies()[std::size_t(i)].revolute)
      tau[i] += moved.rotation.col(2).dot(torque + (point - moved.origin).cross(force));
    else
      tau[i] += moved.rotation.col(2).dot(force);
  }
}

void TreeDynamics::jointForces(int link, const Vector3d& point, const Vector6& wrench,
                               Eigen::Ref<Eigen::VectorXd> tau) const noexcept
{
  tau.setZero();
  addForceAlong(model_->links()[std::size_t(link)].body, point, wrench.head<3>(), wrench.tail<3>(), tau.data());
}

void TreeDynamics::clearWrenches() noexcept
{
  for (Wrench& wrench : wrenches_)
    wrench = { Vector3d::Zero(), Vector3d::Zero() };
  for (Body& body : bodies_)
  {
    body.applied_force.setZero();
    body.applied_torque.setZero();
  }
}

void TreeDynamics::addForce(int link, const Vector3d& point, const Vector3d& force) noexcept
{
  Vector6 wrench;
  wrench << force, Vector3d::Zero();
  addWrench(link, point, wrench);
}

void TreeDynamics::addWrench(int link, const Vector3d& point, const Vector6& wrench) noexcept
{
  Body& body = bodies_[std::size_t(model_->links()[std::size_t(link)].body + 1)];
  const Vector3d force = wrench.head<3>();
  const Vector3d torque = wrench.tail<3>() + (point - body.origin).cross(force);
  wrenches_[std::size_t(link)].force += force;
  wrenches_[std::size_t(link)].torque += torque;
  body.applied_force += force;
  body.applied_torque += torque;
}

void TreeDynamics::prepare(double h) noexcept
{
  step_ = h;
  rows_ = 0;
  const double speed = model_->options().friction_speed;
  for (int i = 0; i < dofs(); ++i)
  {
    const JointDescription& joint = model_->joints()[std::size_t(i)].description;
    const JointDrive& drive = drives_[std::size_t(i)];
    // dry friction as damping with the present slope of its chord: never pushes, however light the body
    const double damping = joint.damping + joint.friction / std::sqrt(qd_[i] * qd_[i] + speed * speed);
    implicit_[i] = h * (damping + drive.damping + h * drive.stiffness);
    joint_force_[i] = -damping * qd_[i] + drive.damping * (drive.velocity - qd_[i]) +
                      drive.stiffness * (drive.position - q_[i] - h * qd_[i]);
  }
  buildMassMatrix();
  factor();
}

/// L^T D L of M + implicit terms, in place; no fill-in, as rows hold all ancestors (Featherstone 2008, table 6.3).
void TreeDynamics::factor() noexcept
{
  factor_ = mass_;
  for (int k = dofs() - 1; k >= 0; --k)
  {
    double* row = factor_.data() + begin_[std::size_t(k)];
    const int* ancestors = ancestors_.data() + begin_[std::size_t(k)];
    const int depth = depth_[std::size_t(k)];
    const double inverse = 1.0 / (row[depth] + implicit_[k]);
    inverse_pivot_[k] = inverse;
    for (int e = depth - 1; e >= 0; --e)
    {
      const double share = row[e] * inverse;
      double* target = factor_.data() + begin_[std::size_t(ancestors[e])];
      for (int f = 0; f <= e; ++f)
        target[f] -= share * row[f];
      row[e] = share;
    }
  }
}

/// x = L^-T x where only the first `support` entries differ from zero.
void TreeDynamics::solveTransposed(double* x, int support) const noexcept
{
  for (int k = support - 1; k > 0; --k)
  {
    const double value = x[k];
    if (value == 0.0)
      continue;
    const double* row = factor_.data() + begin_[std::size_t(k)];
    const int* ancestors = ancestors_.data() + begin_[std::size_t(k)];
    for (int e = 0; e < depth_[std::size_t(k)]; ++e)
      x[ancestors[e]] -= row[e] * value;
  }
}

void TreeDynamics::solve(Eigen::Ref<Eigen::VectorXd> x) const noexcept
{
  solveTransposed(x.data(), dofs());
  for (int k = 0; k < dofs(); ++k)
  {
    const double* row = factor_.data() + begin_[std::size_t(k)];
    const int* ancestors = ancestors_.data() + begin_[std::size_t(k)];
    double value = x[k] * inverse_pivot_[k];
    for (int e = 0; e < depth_[std::size_t(k)]; ++e)
      value -= row[e] * x[ancestors[e]];
    x[k] = value;
  }
}

void TreeDynamics::forwardDynamics(const VectorRef& tau) noexcept
{
  accelerate(nullptr, -model_->options().gravity);
  gatherForces(scratch_.data());
  qdd_ = tau + joint_force_ - scratch_;
  solve(qdd_);
  accelerated_ = stale_ = true;
}

void TreeDynamics::clearRows() noexcept
{
  rows_ = 0;
}

int TreeDynamics::finishRow(const Row& row) noexcept
{
  row_[std::size_t(rows_)] = row;
  row_factor_.col(rows_) = row_jacobian_.col(rows_);
  solveTransposed(row_factor_.col(rows_).data(), row.support);
  for (int k = 0; k < row.support; ++k)
    row_factor_(k, rows_) *= std::sqrt(inverse_pivot_[k]);
  return rows_++;
}

int TreeDynamics::addRow(int link_a, int link_b, const Vector3d& point, const Vector3d& direction) noexcept
{
  if (rows_ == maxRows())
    return -1;
  const int body_a = link_a < 0 ? -1 : model_->links()[std::size_t(link_a)].body;
  const int body_b = link_b < 0 ? -1 : model_->links()[std::size_t(link_b)].body;
  row_jacobian_.col(rows_).setZero();
  addForceAlong(body_a, point, direction, Vector3d::Zero(), row_jacobian_.col(rows_).data());
  addForceAlong(body_b, point, -direction, Vector3d::Zero(), row_jacobian_.col(rows_).data());
  return finishRow({ link_a, link_b, point, direction, std::max(body_a, body_b) + 1 });
}

int TreeDynamics::addJointRow(int joint, double sign) noexcept
{
  if (rows_ == maxRows())
    return -1;
  row_jacobian_.col(rows_).setZero();
  row_jacobian_(joint, rows_) = sign;
  return finishRow({ -1, -1, Vector3d::Zero(), Vector3d::Zero(), joint + 1 });
}

Eigen::Ref<const Eigen::MatrixXd> TreeDynamics::delassus() noexcept
{
  for (int i = 0; i < rows_; ++i)
  {
    for (int j = 0; j <= i; ++j)
    {
      const int support = std::min(row_[std::size_t(i)].support, row_[std::size_t(j)].support);
      delassus_(i, j) = delassus_(j, i) = row_factor_.col(i).head(support).dot(row_factor_.col(j).head(support));
    }
  }
  return delassus_.topLeftCorner(rows_, rows_);
}

void TreeDynamics::rowVelocities(Eigen::Ref<Eigen::VectorXd> now, Eigen::Ref<Eigen::VectorXd> after) const noexcept
{
  for (int i = 0; i < rows_; ++i)
  {
    const int support = row_[std::size_t(i)].support;
    const auto row = row_jacobian_.col(i).head(support);
    now[i] = row.dot(qd_.head(support));
    after[i] = now[i] + step_ * row.dot(qdd_.head(support));
  }
}

void TreeDynamics::applyImpulses(const VectorRef& impulses) noexcept
{
  scratch_.setZero();
  for (int i = 0; i < rows_; ++i)
  {
    const Row& row = row_[std::size_t(i)];
    const double force = impulses[i] / step_;
    scratch_.head(row.support) += force * row_jacobian_.col(i).head(row.support);
    if (row.link_a >= 0)
      addForce(row.link_a, row.point, force * row.direction);
    if (row.link_b >= 0)
      addForce(row.link_b, row.point, -force * row.direction);
  }
  solve(scratch_);
  qdd_ += scratch_;
  stale_ = true;
}

void TreeDynamics::integrate() noexcept
{
  qd_ += step_ * qdd_;
  q_ += step_ * qd_;
  updateKinematics();
}

void TreeDynamics::stepEuler(const VectorRef& tau, double h) noexcept
{
  prepare(h);
  forwardDynamics(tau);
  integrate();
}

void TreeDynamics::stepRungeKutta(const VectorRef& tau, double h) noexcept
{
  start_q_ = q_;
  start_qd_ = qd_;
  sum_q_.setZero();
  sum_qd_.setZero();
  constexpr double kWeight[] = { 1.0, 2.0, 2.0, 1.0 }, kReach[] = { 0.5, 0.5, 1.0 };
  for (int stage = 0; stage < 4; ++stage)
  {
    prepare(0.0);
    forwardDynamics(tau);
    sum_q_ += kWeight[stage] * qd_;
    sum_qd_ += kWeight[stage] * qdd_;
    if (stage == 3)
      break;
    q_ = start_q_ + kReach[stage] * h * qd_;
    qd_ = start_qd_ + kReach[stage] * h * qdd_;
    updateKinematics();
  }
  q_ = start_q_ + h / 6.0 * sum_q_;
  qd_ = start_qd_ + h / 6.0 * sum_qd_;
  updateKinematics();
}
}  // namespace phri_sim
