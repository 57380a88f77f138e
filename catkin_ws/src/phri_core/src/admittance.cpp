#include "phri_core/admittance.hpp"

#include <algorithm>
#include <cmath>

#include "phri_core/check.hpp"

namespace phri_core
{
Admittance::Admittance(const VectorDof& mass, const VectorDof& damping, double dt)
  : mass_(mass), damping_(damping), dt_(dt), x_(VectorDof::Zero(mass.size())), v_(VectorDof::Zero(mass.size()))
{
  requireShape("admittance damping", damping, mass.size(), 1);
  requireRange("admittance dt", dt, 1e-9, 1.0, "s");
  for (Eigen::Index i = 0; i < mass.size(); ++i)
  {
    requireRange("admittance mass", mass(i), 1e-3, 1e4, "kg");
    requireRange("admittance damping", damping(i), 0.0, 1e5, "Ns/m");
  }
  decay_ = velocity_gain_ = position_decay_ = position_gain_ = VectorDof::Zero(mass.size());
  integrate();
}

void Admittance::scaleDamping(double factor) noexcept
{
  if (factor == scale_)
    return;
  scale_ = factor;
  integrate();
}

void Admittance::set(const VectorDof& mass, const VectorDof& damping) noexcept
{
  mass_ = mass;
  damping_ = damping;
  integrate();
}

void Admittance::integrate() noexcept
{
  for (Eigen::Index i = 0; i < mass_.size(); ++i)
  {
    const double m = mass_(i), z = scale_ * damping_(i) * dt_ / m;
    // phi1 = (1 - e^-z) / z and phi2 = (z - 1 + e^-z) / z^2, by series where cancellation would spoil them
    const double phi1 = z > 1e-5 ? -std::expm1(-z) / z : 1.0 - z / 2.0 + z * z / 6.0;
    const double phi2 = z > 1e-3 ? (z + std::expm1(-z)) / (z * z) : 0.5 - z / 6.0 + z * z / 24.0;
    decay_(i) = std::exp(-z);
    velocity_gain_(i) = phi1 * dt_ / m;
    position_decay_(i) = phi1 * dt_;
    position_gain_(i) = phi2 * dt_ * dt_ / m;
  }
}

void Admittance::step(const VectorDof& u) noexcept
{
  for (Eigen::Index i = 0; i < x_.size(); ++i)
  {
    x_(i) += position_decay_(i) * v_(i) + position_gain_(i) * u(i);
    v_(i) = decay_(i) * v_(i) + velocity_gain_(i) * u(i);
  }
}

void Admittance::reset(const VectorDof& position, const VectorDof& velocity) noexcept
{
  x_ = position;
  v_ = velocity;
}

AdmittanceRamp::AdmittanceRamp(const VectorDof& mass, const VectorDof& damping)
  : mass_(mass), damping_(damping), mass_target_(mass), damping_target_(damping)
{
}

void AdmittanceRamp::toward(const VectorDof& mass, const VectorDof& damping) noexcept
{
  mass_target_ = mass;
  damping_target_ = damping;
  left_ = kTime;
  for (Eigen::Index i = 0; i < mass.size(); ++i)
  {
    const double growth = mass(i) - mass_(i), least = std::min(damping(i), damping_(i));
    if (growth > 0.0)
      left_ = std::max(left_, growth / std::max(least, 1e-3));
  }
}

bool AdmittanceRamp::step(double dt) noexcept
{
  if (!(left_ > 0.0))
    return false;
  const double share = std::min(1.0, dt / left_);
  mass_ += share * (mass_target_ - mass_);
  damping_ += share * (damping_target_ - damping_);
  left_ -= dt;
  if (left_ <= 0.5 * dt)
  {
    mass_ = mass_target_;
    damping_ = damping_target_;
    left_ = 0.0;
  }
  return true;
}
}  // namespace phri_core
