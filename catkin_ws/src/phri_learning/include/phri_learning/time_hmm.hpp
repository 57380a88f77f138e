#pragma once
/// Time-based hidden Markov model (section 3.1.1): a left-to-right HMM over d-dimensional spatial samples whose states
/// also know WHEN they are visited. S states with K Gaussian components each; component c = i K + k of state i. Any
/// dimension, any unit: nothing here knows what a dimension means.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "phri_core/gaussian.hpp"
#include "phri_core/random.hpp"

namespace phri_learning
{
/// Which formulas the durations follow. `kThesis` keeps (3.12) as printed, whose divisor 4 halves every duration, and
/// predicts by (3.8) as printed, half a state late; it exists to be compared against.
enum class Formulas
{
  kCorrected,
  kThesis
};

/// Whether a sequence starts at the beginning of the movement or anywhere in it (a window cut from a running movement).
enum class Start
{
  kBeginning,  ///< the model's own initial probabilities
  kAnywhere    ///< every state equally likely
};

/// What training estimates and what a model file stores. Row c of a matrix belongs to component c = i K + k.
struct TimeHmmParameters
{
  double dt = 0.0;                  ///< sampling time [s]
  Eigen::MatrixXd transition;       ///< (S, S), rows sum to 1, only a_ii and a_i,i+1 may differ from 0
  Eigen::VectorXd initial;          ///< (S), sums to 1
  Eigen::MatrixXd weights;          ///< (S, K), rows sum to 1
  Eigen::MatrixXd mean_s;           ///< (S K, d) spatial means [unit of the data]
  std::vector<Eigen::MatrixXd> ss;  ///< S K times (d, d) spatial covariances, pooled over demonstrations
  Eigen::VectorXd mean_t;           ///< (S K) mean times since the start of the movement [s]
  Eigen::VectorXd tt;               ///< (S K) time variances WITHIN a demonstration, (3.2) [s^2]
  Eigen::MatrixXd ts;               ///< (S K, d) covariance of time and space within a demonstration, (3.3)
  Eigen::VectorXd between_tt;  ///< (S K) variance BETWEEN demonstrations of their mean times, which (3.2) removes [s^2]
  Eigen::VectorXd scale;       ///< (d) size of each dimension in training; makes every floor independent of units
  double covariance_floor = 1e-4;  ///< smallest eigenvalue of a covariance after division by scale scale' [-]
  double repeat_variance = 0.0;  ///< how much a new demonstration may differ beyond what few ones show, by scale^2 [-]
  double pace_variance = 0.0;    ///< variance of (progress in model time) / (elapsed time), see TimeTracker [-]
  Eigen::VectorXd memory;        ///< (d) time after which a deviation from the model has faded to 1/e [s]
};

/// Nearest symmetric matrix whose eigenvalues, after division by scale scale', are at least `floor`; given a sample
/// covariance, this is also the maximum-likelihood covariance under that restriction. `raised`: whether one was below.
Eigen::MatrixXd withEigenvalueFloor(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& scale, double floor,
                                    bool* raised = nullptr);

/// log(e^a + e^b); -inf stands for probability 0.
inline double logAdd(double a, double b)
{
  constexpr double kNegligible = -36.0;  // a term lost against 1 in double precision
  const double high = std::max(a, b), low = std::min(a, b);
  return low - high > kNegligible ? high + std::log1p(std::exp(low - high)) : high;  // false for NaN = -inf + inf
}

/// An immutable, validated model with everything precomputed that run time needs (Cholesky factors, gains, durations).
class TimeHmm
{
public:
  static constexpr int kLanes = 4;  ///< components whose densities are computed together
  /// Memory for the run-time functions, so that they allocate nothing; one per thread.
  struct Scratch
  {
    Eigen::VectorXd component, weight, mean, other;
    Eigen::MatrixXd covariance;
  };
  /// means (N, d) with N covariances (d, d).
  struct Trajectory
  {
    Eigen::MatrixXd means;
    std::vector<Eigen::MatrixXd> covariances;
  };

  /// Throws std::invalid_argument naming the parameter (and state) that has a wrong shape, is not finite, is not a
  /// probability, is not left-to-right or is not positive definite.
  explicit TimeHmm(TimeHmmParameters parameters, Formulas formulas = Formulas::kCorrected);

  const TimeHmmParameters& parameters() const { return parameters_; }
  Formulas formulas() const { return formulas_; }
  int states() const { return states_; }
  int components() const { return components_; }
  int dimension() const { return dimension_; }
  double dt() const { return parameters_.dt; }
  /// Mean time of state i, sum_k w_ik mu_t,ik [s].
  double stateTime(int state) const { return state_time_(state); }
  /// Durations [samples]. Corrected: sqrt(1 + 12 v) with v = Var[t | i] / dt^2, exact for a state that visits d samples
  /// in a row; thesis: (3.12). Never below 1.
  const Eigen::VectorXd& durations() const { return durations_; }
  /// Length of the movement [s], (3.10).
  double length() const { return length_; }
  Scratch scratch() const;
  /// The same model of the first `dimensions` dimensions alone (Gaussians marginalise), 1..dimension().
  TimeHmm leading(int dimensions) const;

  /// log P(x | i) of every state; x (d), out (S). Spatial only. Allocates nothing.
  void logEmission(const Eigen::Ref<const Eigen::VectorXd>& x, Scratch* scratch, Eigen::Ref<Eigen::VectorXd> out) const;
  /// log w_ik + log N(x | i, k) of every component and sample; x (T, d), result (S K, T).
  Eigen::MatrixXd logComponents(const Eigen::Ref<const Eigen::MatrixXd>& x) const;
  /// log of the diagonal (S) and of the superdiagonal (S - 1) of the transition matrix.
  const Eigen::VectorXd& logStay() const { return log_stay_; }
  const Eigen::VectorXd& logNext() const { return log_next_; }
  Eigen::VectorXd logStart(Start start) const;

  /// log P(x | model) of the spatial samples x (T, d).
  double score(const Eigen::Ref<const Eigen::MatrixXd>& x, Start start = Start::kBeginning) const;
  /// Most likely state sequence of x (T, d).
  std::vector<int> viterbi(const Eigen::Ref<const Eigen::MatrixXd>& x, Start start = Start::kBeginning) const;

  /// Gaussian mixture regression at absolute times [s] since the start of the movement: means (3.5). Covariances as
  /// printed in (3.6), or, if `full_covariance`, what a new demonstration really shows at that time by the law of total
  /// variance: the spread of the component means, which (3.6) omits, the time variance between demonstrations, which
  /// (3.2) takes out, and repeat_variance. Beyond the ends of the movement the line of the outermost state goes on, as
  /// (3.5) says.
  Trajectory regress(const Eigen::Ref<const Eigen::VectorXd>& times, bool full_covariance = true) const;
  /// Mean of (3.5) at `time` into scratch->mean. Allocates nothing.
  void regressMean(double time, Scratch* scratch) const;
  /// Mean of (3.5) at `time` into scratch->mean and, into scratch->covariance, the mean squared deviation from it if
  /// the time itself is uncertain with `time_variance` [s^2] (five Gauss-Hermite nodes). Allocates nothing.
  void regressUncertain(double time, double time_variance, Scratch* scratch) const;

  /// E[t | x, i] within state i, mu_t + S_ts S_ss^-1 (x - mu_s) (components weighted by their likelihood), and its
  /// variance.
  void timeWithin(int state, const Eigen::Ref<const Eigen::VectorXd>& x, Scratch* scratch, double* mean,
                  double* variance) const;

private:
  void logComponent(const Eigen::Ref<const Eigen::VectorXd>& x, Scratch* scratch) const;
  void validate() const;
  void precompute();
  void timeWeights(double time, Scratch* scratch) const;
  void requireSamples(const Eigen::Ref<const Eigen::MatrixXd>& x) const;

  TimeHmmParameters parameters_;
  Formulas formulas_;
  int states_ = 0, components_ = 0, dimension_ = 0;
  Eigen::VectorXd state_time_, durations_, log_stay_, log_next_;
  double length_ = 0.0;
  Eigen::VectorXd center_;  // subtracted before whitening, so that large offsets cost no digits
  // Column b: components b kLanes ..: per row i of the inverse Cholesky factor W, -(W mean)_i, W_i0 .. W_ii, each of
  // them for kLanes components in a row
  Eigen::MatrixXd whitening_;
  Eigen::VectorXd log_norm_;       // (S K): log w - log sqrt det(2 pi S_ss)
  Eigen::VectorXd log_time_norm_;  // (S K): log w - log sqrt S_tt
  Eigen::MatrixXd slope_;          // (d, S K): S_st / S_tt
  Eigen::MatrixXd mean_columns_;   // (d, S K)
  Eigen::MatrixXd conditional_;    // (d d, S K): S_ss - S_st S_ts / S_tt, floored
  Eigen::MatrixXd time_slope_;     // (d, S K): S_ss^-1 S_st
  Eigen::VectorXd time_residual_;  // (S K): S_tt - S_ts S_ss^-1 S_st
};

/// A random sequence (samples, d) of the spatial model, from its beginning; samples >= 1.
Eigen::MatrixXd sample(const TimeHmm& model, int samples, phri_core::Random* random);
}  // namespace phri_learning
