#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "phri_core/parameters.hpp"

namespace phri_sim
{
/// One simulated person. Nothing here is human data; ranges and sources of the numbers: docs/participants.md.
struct Participant
{
  int index = 0;
  double speed = 0.075;              ///< v_c [m/s] comfortable speed
  double curvature_exponent = 0.33;  ///< beta of v ~ curvature^-beta
  double steering = 0.2;             ///< [s] channel width per speed in the steering law
  double clearance = 0.012;          ///< [m] clearance from walls that feels comfortable
  double side_bias = 0.0;            ///< [m] constant lateral offset from the route, left positive
  double wander = 0.002;             ///< [m] trial-to-trial lateral variation
  double stiffness = 220.0;          ///< K [N/m] along the strong axis of the arm
  double stiffness_ratio = 0.35;     ///< weak over strong axis
  double stiffness_angle = 0.0;      ///< [rad] of the strong axis from the y axis (toward the shoulder)
  double damping_ratio = 0.7;        ///< zeta
  double hand_mass = 1.3;            ///< [kg] that the damping ratio refers to
  double muscle_lag = 0.045;         ///< [s] of each of two cascaded lags
  double reflex_delay = 0.08;        ///< d_p [s] proprioceptive
  double visual_delay = 0.2;         ///< d_v [s]
  double decision_delay = 0.25;      ///< d_r [s] perception of obstacles, change of role
  double force_variation = 0.06;     ///< c, signal-dependent noise
  double force_noise = 0.15;         ///< [N] white, per sample
  double tremor = 0.05;              ///< [N] amplitude at 8-12 Hz
  double internal_model = 0.75;      ///< a_1, share of the load's dynamics that is fed forward in the first trial
  double learning_rate = 0.35;       ///< eta
  double forgetting = 0.03;          ///< lambda
  double visual_stiffness = 60.0;    ///< K_v [N/m]
  double visual_damping = 60.0;      ///< D_v [Ns/m]
  double force_max = 70.0;           ///< [N]
  double yield_force = 4.0;          ///< [N] of the partner's counter-pull that starts a change of role
  double yielding = 0.3;             ///< kappa_y: give in > 0, fight < 0

  /// a_n and K_n after `trials` trials of practice: a_{n+1} = a_n + eta (1 - a_n) - lambda a_n, K relaxes from 1.3 K to
  /// K.
  double internalModelAfter(int trials) const;
  double stiffnessAfter(int trials) const;
};

/// Distribution of one parameter over people.
struct Trait
{
  enum class Shape
  {
    Normal,    ///< mean, standard deviation
    LogNormal  ///< median, coefficient of variation
  };
  double Participant::*field;
  std::string key, unit;
  Shape shape;
  double median, spread, low, high;
  std::string help;
};

/// A population: how each parameter is distributed. Defaults are the calibrated ones.
struct Population
{
  std::vector<Trait> traits;
  Population();
  /// Keys `<trait>/median` and `<trait>/spread`.
  phri_core::ParameterTable table();
  /// Person number `index` of the population with this seed: always the same person, whatever the population's size.
  Participant person(std::uint64_t seed, int index) const;
};

/// Loads `config/participants/<name>.yaml` or a path.
Population loadPopulation(const std::string& name_or_path);
}  // namespace phri_sim
