#pragma once
/// How far a movement goes in the next moments, learned from demonstrations: the trained half of DisplacementMixture.
///
/// A sample y (d) is made of blocks of n axes: first the position p [m, rad], then companions such as velocity and
/// wrench, each in its own unit. What is predicted k samples ahead is the change D_k = y(t + k) - y(t).
///   1. Base, the same everywhere and in every direction: D_k = sum_l w_kl delta_l, delta_l = p(t) - p(t - l) for three
///      lags (0.02, 0.06, 0.16 s); a constant-velocity model whose fading with the horizon is learned. Companions add
///      their own value and its change over the second lag. Ridge regression about constant velocity (companions: about
///      no change), so exact constant-velocity data leave it exact.
///   2. Local, for each state i of a time-HMM over [p; v]: what the base misses, r = D_k - base ~
///      N(b_i + B_i (phi - phi_i), C_i) with phi = [p; delta_1; delta_2; delta_3; companions]: the conditional of the
///      joint Gaussian of (phi, r) in that state, i.e. Gaussian mixture regression as (3.5)-(3.7) with phi in place of
///      time, shrunk by a ridge. Pauses and paces that no demonstration showed do not mislead it as they mislead time.
/// The ridge is chosen, and both covariances are estimated, by leaving one demonstration out at a time; covariances are
/// then widened by E / (E - 1), the variance of a Student t with 2 E degrees of freedom, for E demonstrations only.
/// Trap: covariances of neighbouring samples of one demonstration are not independent information; in-sample residuals
/// would promise a multiple of the accuracy that a new demonstration shows.
/// Sources: (3.1)-(3.7) of the thesis; A. E. Hoerl and R. W. Kennard, Technometrics 12(1), 1970, 55-67 (ridge).

#include <Eigen/Core>
#include <array>
#include <memory>
#include <vector>

#include "phri_learning/time_hmm.hpp"

namespace phri_learning
{
struct DisplacementOptions
{
  int axes = 2;          ///< n, the first n columns are positions; the dimension must be a multiple of it
  double dt = 0.02;      ///< sampling time of the demonstrations [s]
  double horizon = 0.3;  ///< farthest prediction [s]
  /// States of the time-HMM; 0: one per horizon of the mean demonstration, within 10 and 40.
  int states = 0;
};

/// Trained values; index k - 1 is k samples ahead, local lists have S entries per horizon, entry (k - 1) S + i.
struct DisplacementRegression
{
  double dt = 0.0;                            ///< [s]
  int axes = 0, dimension = 0;                ///< n, d
  int steps = 0;                              ///< farthest k
  int demonstrations = 0;                     ///< E
  std::array<int, 3> lags{};                  ///< [samples], rising
  std::shared_ptr<const TimeHmm> recogniser;  ///< over [p; (p(t) - p(t - lags[1])) / (lags[1] dt)]
  Eigen::VectorXd center;                     ///< (q) subtracted from phi before it is divided by `scale`
  Eigen::VectorXd scale;                      ///< (q) size of each entry of phi in the demonstrations, > 0
  std::vector<Eigen::MatrixXd> base;          ///< k: (d / n, 5) weights of delta_1..3, value and change of the block
  std::vector<Eigen::MatrixXd> local;         ///< (d, 1 + q): [b_i - B_i phi_i, B_i] in centred and scaled phi
  std::vector<Eigen::MatrixXd> base_covariance, local_covariance;  ///< (d, d), positive definite
  /// Mean gain in log-likelihood of the position by the local model over the base in state i, left-out demonstrations.
  std::vector<double> evidence;

  int states() const { return recogniser->states(); }
  int blocks() const { return dimension / axes; }
  int features() const { return 3 * axes + dimension; }
};

/// The last samples, as far back as the lags reach. Before its first sample a movement went on with a known velocity,
/// or with the one between its first two samples; until the second one comes it rests. Allocates in the constructor
/// only.
class SampleHistory
{
public:
  SampleHistory(int axes, int dimension, double dt, const std::array<int, 3>& lags);
  /// First sample y (d), velocity before it v (n) or unknown.
  void start(const Eigen::Ref<const Eigen::VectorXd>& y);
  void start(const Eigen::Ref<const Eigen::VectorXd>& y, const Eigen::Ref<const Eigen::VectorXd>& v);
  void push(const Eigen::Ref<const Eigen::VectorXd>& y);
  Eigen::MatrixXd::ConstColXpr now() const { return before(0); }
  Eigen::MatrixXd::ConstColXpr before(int samples) const;
  /// phi (q), not centred.
  void features(Eigen::Ref<Eigen::VectorXd> phi) const;
  /// (d / n, 5) x axis: what the base weighs, column c of axis a of block b.
  double basis(int block, int axis, int column) const;
  /// [p; v] (2 n) that the recogniser sees.
  void motion(Eigen::Ref<Eigen::VectorXd> out) const;

private:
  int axes_, size_;
  bool unknown_ = false;  // velocity before the first sample
  double dt_;
  std::array<int, 3> lags_;
  Eigen::MatrixXd ring_;  // (d, longest lag + 1)
  int head_ = 0;
};

/// P(state | samples so far) of a left-to-right chain over [p; v], with a hundredth of the probability spread over all
/// states per sample, so that a partner who jumps, or starts anywhere, is found again. O(S) memory, allocates in the
/// constructor only.
class StateFilter
{
public:
  explicit StateFilter(std::shared_ptr<const TimeHmm> model);
  void reset() { started_ = false; }
  void observe(const Eigen::Ref<const Eigen::VectorXd>& motion);
  const Eigen::VectorXd& probability() const { return probability_; }

private:
  std::shared_ptr<const TimeHmm> model_;
  TimeHmm::Scratch scratch_;
  Eigen::VectorXd probability_, log_;
  bool started_ = false;
};

/// Trains on demonstrations (T_e, d) of any lengths; `recogniser`: a time-HMM over [p; v] at the same dt, trained here
/// if none is given. Cost O(sum T_e H q^2 + H S E q^3). Deterministic. Throws std::invalid_argument: options out of
/// range, no demonstration, differing or indivisible dimensions, not finite, none longer than the horizon.
DisplacementRegression trainDisplacements(const std::vector<Eigen::MatrixXd>& demonstrations,
                                          const DisplacementOptions& options,
                                          std::shared_ptr<const TimeHmm> recogniser = nullptr);
}  // namespace phri_learning
