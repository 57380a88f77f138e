#pragma once
/// Assistive controllers of 5.1 and 5.3: a prediction in, a feedback policy out, planned at 50 Hz. The model of the
/// object is (5.36), xi+ = A xi + B u_r with A = [I, dt I; 0, I - dt D/M], B = [0; dt/M], at the tick's period.
///
///   none         (a)  u_r = 0
///   lqr          (b)  (5.28): J = 1/2 |xi_T - mu_T|^2_Q + 1/2 sum |xi_k - mu_k|^2_Q + |u_k|^2_R, theta = 0
///   mahalanobis  (c)  (5.29): the same with Qhat_k = (Sigma_k + floor I)^-1/2 Q (Sigma_k + floor I)^-1/2 instead of Q
///   pd           (5.2): u_r = K_x (mu_x - x) + K_xd (mu_xd - xdot), mu at the time of action plus a lookahead
///
/// mu_k, Sigma_k are the predicted desired state at the stage's time: means and weights are computed at the
/// prediction's own times (10-20 ms apart) and interpolated linearly to the stages. Trap: weights are per sample, so Q
/// depends on dt.
///
/// To add a controller: a class and a line of the catalogue in assistance.cpp.

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "phri_control/assistance_settings.hpp"
#include "phri_control/feedback_policy.hpp"
#include "phri_core/interaction.hpp"

namespace phri_control
{
class AssistanceController
{
public:
  virtual ~AssistanceController() = default;

  /// A policy from observation.t on, valid to the end of the horizon or of the prediction, whichever comes first.
  /// Nothing when the inputs are unusable (the caller keeps the old policy): not finite, wrong size, no prediction left
  /// at observation.t, or a solve that failed; `failure` says which. Not for the tick (allocates), not for two threads.
  virtual std::optional<FeedbackPolicy> plan(const phri_core::Observation& observation,
                                             const phri_core::Prediction& prediction) = 0;

  /// Why the last `plan` returned nothing; empty when it returned a policy.
  const std::string& failure() const { return failure_; }

protected:
  std::string failure_;
};

/// The gate of 5.1.1: false if the position that `prediction` starts from is farther than `gate` [m] from the observed
/// one, so that it is better ignored than followed. 0 or less: no gate. The last `rotations` coordinates, angles, do
/// not count.
bool withinGate(const phri_core::Observation& observation, const phri_core::Prediction& prediction, double gate,
                int rotations = 0);

/// The controller `name` of the catalogue; its policies carry its index in assistanceNames() as source. Throws
/// std::invalid_argument for an unknown name (listing the known ones) or a setting out of range.
std::unique_ptr<AssistanceController> makeAssistance(const std::string& name, const AssistanceSettings& settings);

/// Names of the catalogue, in its order.
const std::vector<std::string>& assistanceNames();
}  // namespace phri_control
