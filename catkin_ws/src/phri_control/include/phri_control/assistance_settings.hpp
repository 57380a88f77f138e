#pragma once
#include <string>

#include "phri_core/parameters.hpp"
#include "phri_core/spatial.hpp"

namespace phri_control
{
/// Diagonal weights Q = diag(position I, velocity I); with R = 1 per N^2.
struct StateWeights
{
  double position = 0.0;  ///< [1/m^2], for `mahalanobis` [-]
  double velocity = 0.0;  ///< [s^2/m^2], for `mahalanobis` [-]
};

/// Defaults are those of the thesis' study (5.3.4) and, for `pd`, of 5.1.1.
struct AssistanceSettings
{
  /// The rendered object (diagonal M [kg, kgm2], D [Ns/m, Nms/rad]): the admittance's own parameters, to be set from
  /// them. Not in the table, so that they are given once. Their size is the number of degrees of freedom, 1..6.
  phri_core::VectorDof mass = Eigen::Vector2d::Constant(90.0);
  phri_core::VectorDof damping = Eigen::Vector2d::Constant(200.0);
  int rotations = 0;  ///< the last so many coordinates are angles; given with the admittance, not in the table

  double dt = 1e-3;      ///< [s] period of a stage
  double horizon = 0.2;  ///< [s]
  /// "error_feedback" (the thesis): u = L (xi - mu). "preview" adds the optimal feedforward of the tracking problem.
  std::string law = "error_feedback";
  double q_scale = 1.0;         ///< [-] on Q of all controllers alike, to be fixed on `lqr`
  double control_weight = 1.0;  ///< R [1/N^2]
  StateWeights lqr{ 1e10, 1e7 };
  StateWeights mahalanobis{ 1e5, 10.0 };
  double covariance_floor = 1e-8;  ///< [m^2; m^2/s^2] added to the predicted covariance's diagonal
  double pd_stiffness = 200.0;     ///< [N/m]
  double pd_damping = 90.0;        ///< [Ns/m]
  double pd_turn_stiffness = 0.0;  ///< [Nm/rad] of angles
  double pd_turn_damping = 0.0;    ///< [Nms/rad]
  double pd_lookahead = 0.0;       ///< [s]
};

/// Key, unit and range of every setting but mass and damping.
phri_core::ParameterTable parameterTable(AssistanceSettings& settings);

/// Throws std::invalid_argument naming the setting, its value, unit and range.
void requireValid(AssistanceSettings settings);
}  // namespace phri_control
