#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "phri_core/parameters.hpp"
#include "phri_sim/participant.hpp"

namespace phri_sim
{
/// One simulated person who carries one end of a long object. Nothing here is human data; which numbers are derived
/// from published ones and which are assumed stands in config/participants/carrying_adults.yaml.
struct CarryingPerson
{
  int index = 0;
  double speed = 0.165;               ///< [m/s] comfortable speed with the load, on the straight
  double curvature_exponent = 0.33;   ///< beta of v ~ curvature^-beta
  double patience = 0.12;             ///< [m] the load may lag behind before the person stops to wait
  double stiffness_forward = 400.0;   ///< K6 [N/m] along the walking person's x axis
  double stiffness_lateral = 0.625;   ///< share of the above
  double stiffness_vertical = 0.875;  ///< share of the above
  double stiffness_yaw = 10.0;        ///< K6 [Nm/rad]
  double stiffness_pitch = 1.2;       ///< share of the above
  double stiffness_roll = 0.6;        ///< share of the above (about the object's long axis)
  double damping_ratio = 0.7;         ///< zeta of K6 with the reflected inertia
  double hand_mass = 3.2;             ///< M6 [kg] fore-aft and vertical; 0.65 of it laterally
  double hand_inertia = 0.019;        ///< M6 [kgm2] about roll and pitch; half of it about yaw
  double reflex_share = 0.3;          ///< r, share of K6 that comes through the reflex, delayed and lagged
  double muscle_lag = 0.045;          ///< [s] of each of two cascaded lags; 10 ms more for torques
  double reflex_delay = 0.08;         ///< d_p [s] proprioceptive
  double visual_delay = 0.2;          ///< d_v [s]
  double decision_delay = 0.25;       ///< d_r [s] in which a role changes
  double visual_stiffness = 20.0;     ///< K_v [N/m] slow correction in the plane
  double weight_share = 0.5;          ///< a_w of the object's weight that the person expects to carry
  double force_variation = 0.06;      ///< c, signal-dependent noise
  double force_noise = 0.15;          ///< [N] white, per sample
  double torque_noise = 0.01;         ///< [Nm] white, per sample
  double tremor = 0.05;               ///< [N] amplitude at 8-12 Hz
  double gait_rate = 1.8;             ///< [1/s] steps
  double gait_bob = 0.01;             ///< [m] vertical amplitude at 0.5 m/s, once a step
  double gait_sway = 0.005;           ///< [m] lateral amplitude at 0.5 m/s, once in two steps
  double trigger = 0.6;               ///< [Nm] yaw pulse just before setting off, toward the first bend
  double leading = 0.85;              ///< alpha of translation: 1 leads, 0 follows
  double turning = 0.3;               ///< alpha of yaw
  double yield_force = 6.0;           ///< [N] of the partner's counter-pull that changes the role
  double yielding = 0.3;              ///< kappa_y: gives in > 0, fights < 0
  double force_max = 80.0;            ///< [N]
  double torque_max = 8.0;            ///< [Nm]
  double grip_max = 40.0;             ///< [N] along the object, beyond it the grip slips
};

/// Distribution of one trait over people.
struct CarryingTrait
{
  double CarryingPerson::*field;
  std::string key, unit;
  Trait::Shape shape;
  double median, spread, low, high;
  std::string help;
};

/// How each trait is distributed over people who carry. Drawn as Population draws: see there.
struct CarryingPopulation
{
  std::vector<CarryingTrait> traits;
  CarryingPopulation();
  /// Keys `<trait>/median` and `<trait>/spread`.
  phri_core::ParameterTable table();
  /// Person number `index` of the population with this seed: always the same person.
  CarryingPerson person(std::uint64_t seed, int index) const;
};

/// Loads `config/participants/<name>.yaml` or a path.
CarryingPopulation loadCarryingPopulation(const std::string& name_or_path);
}  // namespace phri_sim
