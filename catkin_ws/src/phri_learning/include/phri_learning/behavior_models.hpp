#pragma once
/// Behaviour models (definition 2.2) on top of the learned ones.

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "phri_core/interaction.hpp"
#include "phri_learning/time_hmm.hpp"
#include "phri_learning/time_tracker.hpp"

namespace phri_learning
{
/// What tells where in the movement the partner is. Velocity and force change as soon as the robot helps or the partner
/// waits, the place does not.
enum class Recognition
{
  kPosition,  ///< x
  kMotion,    ///< [x; xdot]
  kAll        ///< [x; xdot; u_h], as the thesis
};

struct TimeHmmModelSettings
{
  int dof = 2;                             ///< degrees of freedom of the object, 1..6
  int window = 30;                         ///< Viterbi window [samples]
  Reference reference = Reference::kPath;  ///< what a controller shall track
  TimeEstimate time = TimeEstimate::kEntryCorrected;
  Recognition recognition = Recognition::kPosition;
  bool adapt_pace = false;  ///< model time follows the observed velocity
};

/// The enumerators by their names in configuration files: "path", "displacement"; "thesis", "entry_corrected",
/// "regressed"; "position", "motion", "all". Throw std::invalid_argument naming the known ones.
Reference referenceNamed(const std::string& name);
TimeEstimate timeEstimateNamed(const std::string& name);
Recognition recognitionNamed(const std::string& name);

/// How a TimeTracker forecasts, by name: "thesis": path at the time of (3.8) as printed; "entry_corrected": the same at
/// the entry-corrected time; "displacement": displacement from the regressed time. Throws std::invalid_argument naming
/// them.
ForecastSettings forecastNamed(const std::string& name);

/// The row [x; xdot; u_h] (3 dof) that the models of this package see, in the control frame [m, rad; m/s, rad/s; N,
/// Nm]. Throws std::invalid_argument unless the observation has `dof` degrees of freedom and is finite.
Eigen::VectorXd observationVector(const phri_core::Observation& observation, int dof);

/// A recorded trial as training data: (T, 3 dof), one row per observation.
Eigen::MatrixXd demonstration(const std::vector<phri_core::Observation>& observations, int dof);

/// Time-based HMM as predictor of the desired trajectory and of the human's wrench.
class TimeHmmModel : public phri_core::BehaviorModel
{
public:
  /// Throws std::invalid_argument without a model, or if its dimension is not 3 dof.
  explicit TimeHmmModel(std::shared_ptr<const TimeHmm> model, const TimeHmmModelSettings& settings = {});

  void reset() override;
  /// One observation per sampling time dt of the model. Throws std::invalid_argument if it is not finite or has another
  /// number of degrees of freedom; the state is then unchanged.
  void observe(const phri_core::Observation& observation) override;
  /// Gaussians over [x_d; xdot_d] and u_h; nothing before the first observation. Covariances are symmetric positive
  /// definite.
  std::optional<phri_core::Prediction> predict(double horizon, double dt) override;

  const TimeTracker& tracker() const { return tracker_; }
  const TimeHmmModelSettings& settings() const { return settings_; }

private:
  TimeHmmModelSettings settings_;
  TimeTracker tracker_;
  ForecastSettings forecast_;
  Eigen::VectorXd sample_;
  phri_core::Gaussian joint_;
  double t_ = 0.0;
};
}  // namespace phri_learning
