#pragma once
/// The default predictor: two experts, the base and the local model of a DisplacementRegression, believed by how well
/// they were supported before and how well they predicted just now.
///
/// Expert m predicts D_k ~ N(mu_m, S_m). S_m and mu_m of the local expert are the moments of the mixture over the
/// states with P(i | y so far), spread of the means included (the term that (3.6) omits). Once the time a forecast
/// speaks of has come, its error e gives
///   log-weight  l_m <- f l_m + a log t_6(e; 0, s_m^2 S_m),          f = exp(-dt / 0.5 s), a = 1.5 / k
///   scale       s_m^2 = max(1, (4 + sum g^j a e'S_m^-1 e / n) / (4 + sum g^j a)),      g = exp(-dt / 1 s)
/// a because the errors of k neighbouring forecasts are nearly one error; Student's t so that one surprise does not
/// decide; the scale may widen but not narrow what demonstrations promise, and is kept per block of axes, weights by
/// the position alone. w_m ~ exp(l_m + kEvidence E_m) with the gain of left-out demonstrations, sum_i P(i) evidence_i,
/// for the local expert: where nothing was tested yet, demonstrations decide. Result: moments of sum_m w_m N(mu_m,
/// s_m^2 S_m). Weights and scales are kept at a third, two thirds and all of the horizon and interpolated in between,
/// so that a forecast is smooth over its horizon; y(t + k) = y(t) + D_k is continuous with the present by construction.
///
/// What it cannot do: know of a change of mind before it shows; 95 % regions are honest on average over a movement, not
/// at each moment. The covariance is that of the partner's motion about the mean, not of measurement noise.
/// Sources: J. M. Bates and C. W. J. Granger, Operational Research Quarterly 20(4), 1969, 451-468 (combination by
/// recent errors); A. E. Raftery, M. Karny and P. Ettler, Technometrics 52(1), 2010, 52-66 (forgetting).

#include <Eigen/Core>
#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "phri_core/interaction.hpp"
#include "phri_learning/displacement_regression.hpp"

namespace phri_learning
{
/// Follows one movement; constant time per sample, allocates in the constructor only. Not thread-safe.
class DisplacementMixture
{
public:
  static constexpr int kExperts = 2;  ///< 0 base, 1 local
  static constexpr int kNodes = 3;    ///< horizons at which experts are judged

  /// Throws std::invalid_argument without a model.
  explicit DisplacementMixture(std::shared_ptr<const DisplacementRegression> model);

  const DisplacementRegression& model() const { return *model_; }
  void reset();
  /// Takes the next sample y (d), finite, dt after the last one; throws std::invalid_argument otherwise and stays as it
  /// was. `velocity` (n) [m/s] counts with the first one only; without it, see SampleHistory.
  void observe(const Eigen::Ref<const Eigen::VectorXd>& y);
  void observe(const Eigen::Ref<const Eigen::VectorXd>& y, const Eigen::Ref<const Eigen::VectorXd>& velocity);

  bool started() const { return samples_ > 0; }
  /// P(state | samples so far), (S).
  const Eigen::VectorXd& states() const { return filter_.probability(); }
  /// Weight of each expert at the step nearest to `horizon` [s]; they sum to 1. Before the first sample: undefined.
  std::array<double, kExperts> weights(double horizon) const;
  /// The sample expected `horizon` [s] from now, 0 to the horizon of the model, linear between its steps; symmetric
  /// positive definite. Writes into `result`, allocates nothing if it has the right size. Throws std::invalid_argument
  /// for a horizon out of range or before the first sample.
  void forecast(double horizon, phri_core::Gaussian* result);

private:
  struct Expert
  {
    Eigen::VectorXd mean;
    Eigen::MatrixXd covariance;
  };
  struct Pending  // a forecast at a node, waiting for its time
  {
    std::array<Eigen::VectorXd, kExperts> mean;  // of y, not of its change
    std::array<Eigen::MatrixXd, kExperts> covariance;
  };
  struct Belief
  {
    double log_weight = 0.0;
    Eigen::VectorXd errors;  // (blocks) sum g^j a e'S^-1 e / n
    double samples = 0.0;    // sum g^j a
  };
  void take(const Eigen::Ref<const Eigen::VectorXd>& y, const Eigen::Ref<const Eigen::VectorXd>* velocity);
  void settle();
  void predictExperts(int k);
  double scale(int node, int expert, int block) const;
  void mixAt(int k, phri_core::Gaussian* result);
  std::array<double, kExperts> weightsAt(int k) const;

  std::shared_ptr<const DisplacementRegression> model_;
  SampleHistory history_;
  StateFilter filter_;
  std::array<int, kNodes> nodes_{};
  std::array<std::vector<Pending>, kNodes> pending_;  // rings of `node` forecasts
  std::array<std::array<Belief, kExperts>, kNodes> belief_;
  std::array<Expert, kExperts> expert_;
  Eigen::VectorXd phi_, motion_, local_, deviation_, widening_;
  Eigen::MatrixXd block_;
  phri_core::Gaussian step_;
  long samples_ = 0;
};

/// The predictor as a behaviour model over [x; xdot; u_h] (3 dof), one observation per dt of the model.
class DisplacementModel : public phri_core::BehaviorModel
{
public:
  /// Throws std::invalid_argument without a model, or unless its dimension is 3 times its axes.
  explicit DisplacementModel(std::shared_ptr<const DisplacementRegression> model);

  void reset() override { mixture_.reset(); }
  /// Throws std::invalid_argument if the observation is not finite or has another number of degrees of freedom; the
  /// model then stays as it was.
  void observe(const phri_core::Observation& observation) override;
  /// Gaussians over [x_d; xdot_d] and u_h; nothing before the first observation. Throws std::invalid_argument for a
  /// horizon longer than the model's.
  std::optional<phri_core::Prediction> predict(double horizon, double dt) override;

  const DisplacementMixture& mixture() const { return mixture_; }

private:
  DisplacementMixture mixture_;
  phri_core::Gaussian joint_;
  double t_ = 0.0;
};
}  // namespace phri_learning
