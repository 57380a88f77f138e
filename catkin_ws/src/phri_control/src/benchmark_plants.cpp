#include "phri_control/benchmark_plants.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
constexpr double kHuge = std::numeric_limits<double>::max();
constexpr double kLeastPositive = std::numeric_limits<double>::min();

/// The four slopes of the classical scheme and, on request, their derivatives.
struct Slopes
{
  PlantState k[4];
  PlantMatrix dx[4];
  PlantInput du[4];
};

constexpr double kReach[4] = { 0.0, 0.5, 0.5, 1.0 };  // how far along the previous slope each one is taken
constexpr double kShare[4] = { 1.0, 2.0, 2.0, 1.0 };  // of a sixth
constexpr double kSixth = 1.0 / 6.0;

void slopes(const Plant& plant, double dt, const PlantState& x, const Eigen::Vector2d& u, bool derivatives, Slopes& out)
{
  const Eigen::Index n = x.size();
  PlantState point = x;
  PlantMatrix fx(n, n);
  PlantInput fu(n, 2);
  for (int i = 0; i < 4; ++i)
  {
    if (i > 0)
      point = x + kReach[i] * dt * out.k[i - 1];
    out.k[i].resize(n);
    plant.rate(point, u, out.k[i]);
    if (!derivatives)
      continue;
    plant.rateJacobians(point, u, fx, fu);
    out.dx[i] = fx;
    out.du[i] = fu;
    if (i > 0)
    {
      out.dx[i].noalias() += kReach[i] * dt * fx.lazyProduct(out.dx[i - 1]);
      out.du[i].noalias() += kReach[i] * dt * fx.lazyProduct(out.du[i - 1]);
    }
  }
}
}  // namespace

void step(const Plant& plant, Integrator integrator, double dt, const PlantState& x, const Eigen::Vector2d& u,
          PlantState& next)
{
  if (integrator == Integrator::Euler)
  {
    PlantState xdot(x.size());
    plant.rate(x, u, xdot);
    next = x + dt * xdot;
    return;
  }
  Slopes s;
  slopes(plant, dt, x, u, false, s);
  next = x;
  for (int i = 0; i < 4; ++i)
    next += kSixth * kShare[i] * dt * s.k[i];
}

void linearise(const Plant& plant, Integrator integrator, double dt, const PlantState& x, const Eigen::Vector2d& u,
               PlantMatrix& A, PlantInput& B)
{
  const Eigen::Index n = x.size();
  if (integrator == Integrator::Euler)
  {
    A.resize(n, n);
    B.resize(n, 2);
    plant.rateJacobians(x, u, A, B);
    A *= dt;
    A.diagonal().array() += 1.0;
    B *= dt;
    return;
  }
  Slopes s;
  slopes(plant, dt, x, u, true, s);
  A.setIdentity(n, n);
  B.setZero(n, 2);
  for (int i = 0; i < 4; ++i)
  {
    A += kSixth * kShare[i] * dt * s.dx[i];
    B += kSixth * kShare[i] * dt * s.du[i];
  }
}

PointMass::PointMass(const Eigen::Vector2d& mass, const Eigen::Vector2d& damping, std::optional<DrivingForce> drive)
  : mass_(mass), inverse_mass_(mass.cwiseInverse()), damping_(damping), drive_(drive)
{
  for (int i = 0; i < 2; ++i)
  {
    const std::string axis = "[" + std::to_string(i) + "]";
    phri_core::requireRange("PointMass: mass" + axis, mass(i), kLeastPositive, kHuge, "kg");
    phri_core::requireRange("PointMass: damping" + axis, damping(i), 0.0, kHuge, "Ns/m");
  }
  if (drive)
    phri_core::requireRange("PointMass: wavenumber of the drive", drive->wavenumber, -kHuge, kHuge, "rad/m");
}

void PointMass::rate(const PlantState& x, const Eigen::Vector2d& u, PlantState& xdot) const
{
  Eigen::Vector2d force = u - damping_.cwiseProduct(x.segment<2>(2));
  if (drive_)
    force += Eigen::Vector2d(std::cos(drive_->wavenumber * x(0)), std::sin(drive_->wavenumber * x(1)));
  xdot.segment<2>(0) = x.segment<2>(2);
  xdot.segment<2>(2) = inverse_mass_.cwiseProduct(force);
}

void PointMass::rateJacobians(const PlantState& x, const Eigen::Vector2d&, PlantMatrix& fx, PlantInput& fu) const
{
  fx.setZero();
  fu.setZero();
  for (int i = 0; i < 2; ++i)
  {
    fx(i, 2 + i) = 1.0;
    fx(2 + i, 2 + i) = -inverse_mass_(i) * damping_(i);
    fu(2 + i, i) = inverse_mass_(i);
  }
  if (drive_)
  {
    const double k = drive_->wavenumber;
    fx(2, 0) = -inverse_mass_(0) * k * std::sin(k * x(0));
    fx(3, 1) = inverse_mass_(1) * k * std::cos(k * x(1));
  }
}

void PointMass::motionJacobian(const PlantState&, MotionJacobian& jacobian) const
{
  jacobian.setIdentity(4, 4);
}

TwoLinkArm::TwoLinkArm(const ArmParameters& parameters, ArmInput input) : parameters_(parameters), input_(input)
{
  for (int i = 0; i < 2; ++i)
  {
    const std::string link = "[" + std::to_string(i) + "]";
    phri_core::requireRange("TwoLinkArm: mass" + link, parameters.mass(i), kLeastPositive, kHuge, "kg");
    phri_core::requireRange("TwoLinkArm: length" + link, parameters.length(i), kLeastPositive, kHuge, "m");
    phri_core::requireRange("TwoLinkArm: inertia" + link, parameters.inertia(i), kLeastPositive, kHuge, "kg m^2");
  }
  phri_core::requireFinite("TwoLinkArm: friction", parameters.friction);
  const double l1 = parameters.length(0), l2 = parameters.length(1), m2 = parameters.mass(1);
  a1_ = parameters.inertia(0) + parameters.inertia(1) + m2 * l1 * l1;
  a2_ = 0.5 * m2 * l1 * l2;
  a3_ = parameters.inertia(1);
  if (!(a3_ * (a1_ - a3_) > a2_ * a2_))  // the determinant of M with both links in line
  {
    std::ostringstream text;
    text << "TwoLinkArm: inertia[1] = " << a3_ << " kg m^2 leaves the mass matrix indefinite for the straight arm, "
         << "expected above " << a2_ * a2_ / (a1_ - a3_) << " (inertias are about the joints)";
    throw std::invalid_argument(text.str());
  }
}

Eigen::Matrix2d TwoLinkArm::massMatrix(const Eigen::Vector2d& q) const
{
  const double c = std::cos(q(1));
  Eigen::Matrix2d mass;
  mass << a1_ + 2.0 * a2_ * c, a3_ + a2_ * c, a3_ + a2_ * c, a3_;
  return mass;
}

double TwoLinkArm::kineticEnergy(const PlantState& x) const
{
  const Eigen::Vector2d qd = x.segment<2>(2);
  return 0.5 * qd.dot(massMatrix(x.segment<2>(0)) * qd);
}

Eigen::Vector2d TwoLinkArm::endEffector(const Eigen::Vector2d& q) const
{
  const double l1 = parameters_.length(0), l2 = parameters_.length(1);
  return { l1 * std::cos(q(0)) + l2 * std::cos(q(0) + q(1)), l1 * std::sin(q(0)) + l2 * std::sin(q(0) + q(1)) };
}

Eigen::Matrix2d TwoLinkArm::jacobian(const Eigen::Vector2d& q) const
{
  const double l1 = parameters_.length(0), l2 = parameters_.length(1);
  Eigen::Matrix2d result;
  result.col(1) << -l2 * std::sin(q(0) + q(1)), l2 * std::cos(q(0) + q(1));
  result.col(0) = result.col(1) + l1 * Eigen::Vector2d(-std::sin(q(0)), std::cos(q(0)));
  return result;
}

void TwoLinkArm::rate(const PlantState& x, const Eigen::Vector2d& u, PlantState& xdot) const
{
  const Eigen::Vector2d q = x.segment<2>(0), qd = x.segment<2>(2);
  const Eigen::Vector2d torque = input_ == ArmInput::JointTorque ? u : Eigen::Vector2d(jacobian(q).transpose() * u);
  const Eigen::Vector2d coriolis =
      a2_ * std::sin(q(1)) * Eigen::Vector2d(-qd(1) * (2.0 * qd(0) + qd(1)), qd(0) * qd(0));
  xdot.segment<2>(0) = qd;
  xdot.segment<2>(2) = massMatrix(q).inverse() * (torque - coriolis - parameters_.friction * qd);
}

void TwoLinkArm::rateJacobians(const PlantState& x, const Eigen::Vector2d& u, PlantMatrix& fx, PlantInput& fu) const
{
  const Eigen::Vector2d q = x.segment<2>(0), qd = x.segment<2>(2);
  PlantState xdot(4);
  rate(x, u, xdot);
  const Eigen::Vector2d qdd = xdot.segment<2>(2);
  const Eigen::Matrix2d inverse = massMatrix(q).inverse();
  const double s = a2_ * std::sin(q(1)), c = a2_ * std::cos(q(1));

  // M qdd = tau - C - B qd, differentiated: M d(qdd) = d(tau) - d(C) - B d(qd) - d(M) qdd
  Eigen::Matrix2d by_q = Eigen::Matrix2d::Zero(), by_qd;
  by_q.col(1) = Eigen::Vector2d(s * (2.0 * qdd(0) + qdd(1)), s * qdd(0)) -
                c * Eigen::Vector2d(-qd(1) * (2.0 * qd(0) + qd(1)), qd(0) * qd(0));
  by_qd << 2.0 * s * qd(1), 2.0 * s * (qd(0) + qd(1)), -2.0 * s * qd(0), 0.0;
  by_qd -= parameters_.friction;
  Eigen::Matrix2d by_u = Eigen::Matrix2d::Identity();
  if (input_ == ArmInput::WorkspaceForce)
  {
    by_u = jacobian(q).transpose();
    // d(J'u)/dq: the two links' shares of -p'u, on the angles they turn with
    const double second =
        -u.dot(endEffector(q) - parameters_.length(0) * Eigen::Vector2d(std::cos(q(0)), std::sin(q(0))));
    by_q.array() += second;
    by_q(0, 0) += -u.dot(endEffector(q)) - second;
  }
  fx.setZero();
  fx(0, 2) = fx(1, 3) = 1.0;
  fx.block<2, 2>(2, 0) = inverse * by_q;
  fx.block<2, 2>(2, 2) = inverse * by_qd;
  fu.setZero();
  fu.block<2, 2>(2, 0) = inverse * by_u;
}

Eigen::Vector4d TwoLinkArm::motion(const PlantState& x) const
{
  Eigen::Vector4d y;
  y << endEffector(x.segment<2>(0)), jacobian(x.segment<2>(0)) * x.segment<2>(2);
  return y;
}

void TwoLinkArm::motionJacobian(const PlantState& x, MotionJacobian& out) const
{
  const Eigen::Vector2d q = x.segment<2>(0);
  const double first = x(2), both = x(2) + x(3);
  const Eigen::Vector2d along1 = parameters_.length(0) * Eigen::Vector2d(std::cos(q(0)), std::sin(q(0)));
  const Eigen::Vector2d along2 = endEffector(q) - along1;
  const Eigen::Matrix2d by_q = jacobian(q);
  out.setZero(4, 4);
  out.block<2, 2>(0, 0) = by_q;
  out.block<2, 2>(2, 2) = by_q;
  out.block<2, 1>(2, 0) = -first * along1 - both * along2;
  out.block<2, 1>(2, 1) = -both * along2;
}

void TwoLinkArm::addMotionCurvature(const PlantState& x, const Eigen::Vector4d& weight, PlantMatrix& hessian) const
{
  // In the links' absolute angles a, b the output is e(a) + e(b): no mixed derivatives. Each link adds its own 2 x 2
  // Hessian in (angle, rate), and the second link's goes to both joints.
  const Eigen::Vector2d position = weight.segment<2>(0), velocity = weight.segment<2>(2);
  const double angle[2] = { x(0), x(0) + x(1) }, turn[2] = { x(2), x(2) + x(3) };
  for (int link = 0; link < 2; ++link)
  {
    const double l = parameters_.length(link);
    const Eigen::Vector2d along = l * Eigen::Vector2d(std::cos(angle[link]), std::sin(angle[link]));
    const Eigen::Vector2d across(-along(1), along(0));
    const double twice = -position.dot(along) - turn[link] * velocity.dot(across), mixed = -velocity.dot(along);
    for (int i = 0; i <= link; ++i)
      for (int j = 0; j <= link; ++j)
      {
        hessian(i, j) += twice;
        hessian(i, 2 + j) += mixed;
        hessian(2 + i, j) += mixed;
      }
  }
}

PlantState TwoLinkArm::stateAt(const Eigen::Vector4d& motion) const
{
  phri_core::requireFinite("TwoLinkArm: motion", motion);
  const double l1 = parameters_.length(0), l2 = parameters_.length(1), reach = motion.head<2>().norm();
  const double cosine = (reach * reach - l1 * l1 - l2 * l2) / (2.0 * l1 * l2);
  if (!(std::abs(cosine) < 1.0))
  {
    std::ostringstream text;
    text << "TwoLinkArm: the end-effector cannot be " << reach << " m from the shoulder, expected between "
         << std::abs(l1 - l2) << " and " << l1 + l2 << " m, both excluded (singular)";
    throw std::invalid_argument(text.str());
  }
  Eigen::Vector2d q;
  q(1) = std::acos(cosine);
  q(0) = std::atan2(motion(1), motion(0)) - std::atan2(l2 * std::sin(q(1)), l1 + l2 * cosine);
  PlantState x(4);
  x << q, jacobian(q).inverse() * motion.tail<2>();
  return x;
}

void CarLikeRobot::rate(const PlantState& x, const Eigen::Vector2d& u, PlantState& xdot) const
{
  xdot << x(3) * std::cos(x(2)), x(3) * std::sin(x(2)), x(3) * x(4), u(0), u(1);
}

void CarLikeRobot::rateJacobians(const PlantState& x, const Eigen::Vector2d&, PlantMatrix& fx, PlantInput& fu) const
{
  const double c = std::cos(x(2)), s = std::sin(x(2));
  fx.setZero();
  fx(0, 2) = -x(3) * s;
  fx(0, 3) = c;
  fx(1, 2) = x(3) * c;
  fx(1, 3) = s;
  fx(2, 3) = x(4);
  fx(2, 4) = x(3);
  fu.setZero();
  fu(3, 0) = fu(4, 1) = 1.0;
}

Eigen::Vector4d CarLikeRobot::motion(const PlantState& x) const
{
  return { x(0), x(1), x(3) * std::cos(x(2)), x(3) * std::sin(x(2)) };
}

void CarLikeRobot::motionJacobian(const PlantState& x, MotionJacobian& out) const
{
  const double c = std::cos(x(2)), s = std::sin(x(2));
  out.setZero(4, 5);
  out(0, 0) = out(1, 1) = 1.0;
  out(2, 2) = -x(3) * s;
  out(2, 3) = c;
  out(3, 2) = x(3) * c;
  out(3, 3) = s;
}

void CarLikeRobot::addMotionCurvature(const PlantState& x, const Eigen::Vector4d& weight, PlantMatrix& hessian) const
{
  const Eigen::Vector2d along(std::cos(x(2)), std::sin(x(2))), across(-along(1), along(0));
  hessian(2, 2) -= x(3) * weight.tail<2>().dot(along);
  const double mixed = weight.tail<2>().dot(across);
  hessian(2, 3) += mixed;
  hessian(3, 2) += mixed;
}
}  // namespace phri_control
