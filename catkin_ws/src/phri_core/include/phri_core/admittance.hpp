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

  const VectorDof& position() const { return x_; }
  const VectorDof& velocity() const { return v_; }
  const VectorDof& mass() const { return mass_; }
  const VectorDof& damping() const { return damping_; }
  double dt() const { return dt_; }

private:
  VectorDof mass_, damping_;
  double dt_, scale_ = 1.0;
  VectorDof x_, v_;
  VectorDof decay_, velocity_gain_, position_decay_, position_gain_;
};
}  // namespace phri_core
