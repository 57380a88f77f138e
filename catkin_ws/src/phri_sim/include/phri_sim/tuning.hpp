#pragma once
#include "phri_sim/experiment.hpp"

namespace phri_sim
{
/// What may change while trials run: the tunable settings of the controllers and the rendered object. The ranges are
/// those of the experiment's own schemas; the rendered object is never so light or so little damped that a wall of
/// 20 kN/m would make it bounce at the loop's delay of 2 ms (k < D / T).
struct Tuning
{
  phri_control::AssistanceSettings assistance;
  double mass = 90.0;      ///< [kg] along both axes
  double damping = 200.0;  ///< [Ns/m] along both axes

  explicit Tuning(const Experiment& experiment);
  /// Keys such as "pd/stiffness" and "admittance/mass", bound to this object.
  phri_core::ParameterTable table();
  /// Puts the values into an experiment; mass and damping of axes that differ stay unless they were changed.
  void apply(Experiment& experiment) const;
};
}  // namespace phri_sim
