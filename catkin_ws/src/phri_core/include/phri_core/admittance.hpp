#pragma once
#include <Eigen/Core>
#include <array>

#include "phri_core/spatial.hpp"

namespace phri_core
{
/// Admittance M xdd + D xd = u with diagonal M [kg, kgm2] and D [Ns/m, Nms/rad] (2.16), integrated exactly over a tick
/// in which u is constant: per axis, with a = exp(-D dt / M),
///   v+ = a v + (1 - a) u / D,   x+ = x + (M / D)(1 - a) v + (dt - (M / D)(1 - a)) u / D,
/// and the limits of these for D -> 0. `step` allocates nothing.
class Admittance
{
public:
  /// Throws std::invalid_argument unless mass is in [1e-3, 1e4], damping in [0, 1e5] and dt in (0, 1] s.
  Admittance(const VectorDof& mass, const VectorDof& damping, double dt);

  /// Advances by dt under the total wrench `u` (dof).
  void step(const VectorDof& u) noexcept;
  /// Moves to a state; velocities set to a limited value here leave no stored momentum (anti-windup).
  void reset(const VectorDof& position, const VectorDof& velocity) noexcept;
  /// Multiplies the damping from now on; 1 is the nominal admittance.
  void scaleDamping(double factor) noexcept;
  /// Another nominal admittance from now on, keeping the state; the caller answers for the ranges of the constructor.
  /// Trap: a step of the mass at a velocity v changes the kinetic energy by v'(dM)v / 2; ramp it (see AdmittanceRamp).
  void set(const VectorDof& mass, const VectorDof& damping) noexcept;

  const VectorDof& position() const { return x_; }
  const VectorDof& velocity() const { return v_; }
  const VectorDof& mass() const { return mass_; }
  const VectorDof& damping() const { return damping_; }
  double dt() const { return dt_; }

private:
  void integrate() noexcept;
  VectorDof mass_, damping_;
  double dt_, scale_ = 1.0;
  VectorDof x_, v_;
  VectorDof decay_, velocity_gain_, position_decay_, position_gain_;
};

/// Moves from one nominal admittance to another without a bump: mass and damping change linearly, within `kTime` or as
/// much longer as keeps |dM/dt| <= D, half of what passivity with a varying mass allows: v'(dM/dt)v / 2 <= v'Dv.
class AdmittanceRamp
{
public:
  static constexpr double kTime = 0.5;  ///< [s]

  AdmittanceRamp(const VectorDof& mass, const VectorDof& damping);
  /// A new target, reached from where the ramp is now.
  void toward(const VectorDof& mass, const VectorDof& damping) noexcept;
  /// Advances by dt [s]; true while something changed.
  bool step(double dt) noexcept;
  const VectorDof& mass() const { return mass_; }
  const VectorDof& damping() const { return damping_; }

private:
  VectorDof mass_, damping_, mass_target_, damping_target_;
  double left_ = 0.0;  // [s]
};
}  // namespace phri_core
