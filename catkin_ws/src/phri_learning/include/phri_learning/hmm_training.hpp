#pragma once
/// Modified Baum-Welch training of the time-based HMM, (3.2)-(3.3).

#include <Eigen/Core>
#include <vector>

#include "phri_learning/time_hmm.hpp"

namespace phri_learning
{
struct TrainingOptions
{
  int states = 10;     ///< S
  int components = 1;  ///< K Gaussians per state
  double dt = 0.02;    ///< sampling time of the demonstrations [s]
  Formulas formulas = Formulas::kCorrected;
  int max_iterations = 10;         ///< few on purpose: more fits single demonstrations, see shrinkage
  double tolerance = 1e-5;         ///< stop when an iteration gains less log-likelihood per sample than this
  double covariance_floor = 1e-4;  ///< smallest eigenvalue of S_ss after division by the data's scale, see below [-]
  /// Weight of the mean covariance of all states in every state's own, in multiples of the mean samples per state; 0 is
  /// plain Baum-Welch. The samples of a state come from few demonstrations and are nearly copies of each other, so
  /// without it many states learn which demonstration they saw instead of where they are.
  double shrinkage = 1.0;
};

/// Throws std::invalid_argument naming the option that is out of range.
void checkOptions(const TrainingOptions& options);

struct TrainingResult
{
  TimeHmm model;
  /// Log-likelihood of all demonstrations, with shrinkage plus the log of its prior up to a constant: what EM
  /// maximises. From the first iteration with a fixed prior (the first, or after up to 5 warm-up iterations) to the
  /// last.
  std::vector<double> log_likelihood;
  int iterations = 0;
  bool converged = false;
  /// States that the data never reach: they keep their prior, i.e. the statistics of their equal time slice, placed
  /// after the end of the states that are reached.
  std::vector<int> starved;
  /// States with a covariance that had to be raised to covariance_floor: they hold too few different samples for the
  /// number of dimensions, or samples on a line. Prefer fewer states or more shrinkage.
  std::vector<int> collapsed;
};

/// Trains on demonstrations (T_e, d) of any lengths T_e >= 1, sampled every dt. The E-step sees the SPATIAL part only;
/// time statistics follow from its responsibilities, about each demonstration's own mean (3.2)-(3.3), so that
/// demonstrations need no alignment; the variance between demonstrations is kept beside them.
///
/// Each dimension is first divided by its standard deviation over all samples (a constant dimension: by its size), so
/// no unit matters: data times a factor gives the model times that factor. In these coordinates covariances are
/// restricted to eigenvalues >= covariance_floor (1e-4: a standard deviation of 1 % of the dimension's own) and
/// transition probabilities to [1e-6, 1 - 1e-6]. Clipping solves both restricted M-steps exactly, hence log_likelihood
/// never decreases. Deterministic: starts from equal time slices. Cost per iteration O(T S d^2).
///
/// The thesis calls (3.2)-(3.3) part of the M-step. With emissions of space AND time they would break the monotone
/// likelihood: the mean over all demonstrations with the variance about each one's own is no maximum of any likelihood.
/// Here time has no part in the responsibilities, so its statistics are taken once, after the last iteration, and the
/// spatial iteration is plain EM. What comes after it (covariances drawn together in timeStatistics, states put back to
/// their prior) is not in log_likelihood: score() of the model may be lower than its last entry.
///
/// Throws std::invalid_argument: no demonstration, empty one, differing dimensions, not finite (names demonstration and
/// sample), options out of range.
TrainingResult train(const std::vector<Eigen::MatrixXd>& demonstrations, const TrainingOptions& options);
}  // namespace phri_learning
