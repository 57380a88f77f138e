#pragma once
/// The values that cross the layers: what is measured, what a behaviour model sees, what it believes, what is
/// commanded.

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "phri_core/gaussian.hpp"
#include "phri_core/spatial.hpp"

namespace phri_core
{
/// One reading of a robot, in the control frame C. Wrenches are exerted BY the named agent ON the object.
struct Measurement
{
  std::int64_t receive_ns = 0;   ///< monotonic time at which the wrench sample arrived [ns]
  std::int64_t stamp_ns = 0;     ///< stamp of its source, on the same clock [ns]
  std::uint64_t sequence = 0;    ///< counts the source's samples; equal to the previous one: nothing new arrived
  std::uint32_t frame = 0;       ///< index of the frame that the wrench is expressed in; 0 is the control frame
  VectorDof position;            ///< encoder reading [m, rad]
  VectorDof human_wrench;        ///< force/torque sensor, by the human on the object [N, Nm]
  VectorDof environment_wrench;  ///< by the (rendered) environment on the object [N, Nm]
};

/// What the loop asks of the robot's motion servo, in the control frame.
struct Command
{
  VectorDof position;  ///< [m, rad]
  VectorDof velocity;  ///< [m/s, rad/s]
};

/// What a behaviour model and a controller see (definition 2.2): xi = [x; xdot].
struct Observation
{
  double t = 0.0;                ///< since the start of the trial [s]
  VectorState state;             ///< xi (2 dof) [m; m/s]
  VectorDof human_wrench;        ///< by the human on the object [N, Nm]
  VectorDof environment_wrench;  ///< by the environment on the object [N, Nm]
  Eigen::VectorXd features;      ///< anything more that a model wants to see; may be empty
};

/// Belief about what the human wants over a horizon: element k speaks of time t0 + k dt. Both lists have the same
/// length, or human_wrench is empty.
struct Prediction
{
  double t0 = 0.0;                      ///< time of the observation it was made from [s]
  double dt = 0.0;                      ///< step [s]
  std::vector<Gaussian> desired_state;  ///< xi_d (2 dof), N(mu_k, Sigma_xi,k)
  std::vector<Gaussian> human_wrench;   ///< (dof) [N], N(mu_u,k, Sigma_int,k)
  std::string model;                    ///< name of the model that made it
};

/// A model of the human that watches the interaction and predicts it. Not for the tick: may allocate and throw.
class BehaviorModel
{
public:
  virtual ~BehaviorModel() = default;
  /// Forgets the current trial's observations, keeps what was learned.
  virtual void reset() = 0;
  /// Takes the next observation; called at the prediction rate (50 Hz), in order.
  virtual void observe(const Observation& observation) = 0;
  /// Belief over `horizon` [s] in steps of `dt` [s], from the last observation on: round(horizon / dt) + 1 elements.
  /// Nothing while the model cannot tell.
  virtual std::optional<Prediction> predict(double horizon, double dt) = 0;
};
}  // namespace phri_core
