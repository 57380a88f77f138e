#pragma once
/// Run-time side of the time-based HMM: where in the movement is the partner now, and where next.

#include <Eigen/Core>
#include <memory>

#include "phri_learning/time_hmm.hpp"

namespace phri_learning
{
/// How model time follows from the likeliest state i and n, the samples spent in it since its entry.
/// kEntryCorrected: a state that is held longer than it lasts runs on through its successor, not beyond: stopping at
/// its own end would let a robot that tracks the path hold the partner where they stand, for a start at rest looks like
/// the first state for ever; not stopping at all would run away from a partner who waits.
enum class TimeEstimate
{
  kThesis,          ///< (3.8) as printed, mu_t,i + dt n: counts from the state's centre, hence half a state late
  kEntryCorrected,  ///< mu_t,i + dt (n - (d_i - 1) / 2), at most the end of the next state
  kRegressed        ///< E[t | x, i] = mu_t + S_ts S_ss^-1 (x - mu_s), within 3/4 of a state's length of its centre
};

/// What a forecast is made of.
enum class Reference
{
  kPath,         ///< GMR at the future time: where the demonstrations were
  kDisplacement  ///< the present sample plus what the demonstrations moved since the present time
};

struct ForecastSettings
{
  Reference reference = Reference::kDisplacement;
  TimeEstimate time = TimeEstimate::kRegressed;
  /// Dimensions that are velocities: first and number. With number > 0 model time passes at the pace observed /
  /// modelled velocity ("velocity factor" of Fig. 3.5), within 0..3, drawn to 1 where the model hardly moves.
  int velocity_first = 0, velocity_count = 0;
};

/// Follows one movement in constant time per sample: Viterbi over the last `window` samples, which may begin in any
/// state (thesis: 30 samples), re-run on stored emissions; its last state and run length equal those of
/// TimeHmm::viterbi(window, kAnywhere). A state that fills the whole window goes on counting from before it.
/// Holds the model; allocates in the constructor only. Not thread-safe.
class TimeTracker
{
public:
  /// `recognised`: the first so many dimensions decide where in the movement the partner is; 0: all of them.
  explicit TimeTracker(std::shared_ptr<const TimeHmm> model, int window = 30, int recognised = 0);

  const TimeHmm& model() const { return *model_; }
  void reset();
  /// Takes the next sample x (d), finite, dt after the last one. Throws std::invalid_argument otherwise.
  void observe(const Eigen::Ref<const Eigen::VectorXd>& x);

  bool started() const { return samples_ > 0; }
  int state() const { return state_; }             ///< likeliest state now, -1 before the first sample
  int sinceEntry() const { return since_entry_; }  ///< samples since its entry, 0 at entry
  /// Model time now [s] and, if asked for, its variance [s^2].
  double time(TimeEstimate estimate, double* variance = nullptr);
  /// Pace at which model time passes, see ForecastSettings [-].
  double pace(const ForecastSettings& settings);
  /// The sample expected `horizon` [s] from now; model time stays within the movement. The covariance (symmetric
  /// positive definite) holds the spread of the demonstrations and the uncertainty of model time, which grows with the
  /// horizon by pace_variance; kDisplacement: of the deviation from the model that fades with `memory`. Writes into
  /// `result`, allocates nothing if it has the right size.
  void forecast(double horizon, const ForecastSettings& settings, phri_core::Gaussian* result);

private:
  std::shared_ptr<const TimeHmm> model_, recogniser_;  // the latter over the recognised dimensions
  int window_;
  TimeHmm::Scratch scratch_, recogniser_scratch_;
  Eigen::MatrixXd emission_;  // (S, window), a ring of columns
  Eigen::VectorXd best_;      // (S) log-probability of the best path into each state
  Eigen::VectorXi run_;       // (S) samples that path has already spent there
  Eigen::VectorXd x_, slope_, now_;
  int samples_ = 0, head_ = 0, state_ = -1, since_entry_ = 0;
};
}  // namespace phri_learning
