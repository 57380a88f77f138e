#pragma once
/// Which of many known movements is being made now, and where in it: constant time per sample, no allocation.
///
/// Every model runs a forward filter on the samples, with the transition probabilities (1 - leak) a_ij + leak / S: with
/// the leak, a partner who jumps, pauses or starts anywhere is found again. Sample s is worth the increment
///   l_i(s) = log p_i(x_s | x_s-1, x_s-2, ..),      the first sample from every state with probability 1 / S,
/// and the likelihood of model i is the sum of its last `window` increments, i.e. log P_i(last `window` samples | all
/// before). Thesis (3.1.2): log P_i(last 30 samples), started anew in every window, which costs `window` times as much;
/// both are equal until the window is full, if nothing leaks. An increment counts at least typical_i - outlier d, so
/// that a moment without explanation is over when it is over, not a window later.
///
/// The winner changes once the same other model has been the likeliest for `confirm` samples in a row, or at once while
/// nothing is known. It is known while its likelihood is at most `gate` d nats per sample below its typical one.

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "phri_learning/time_hmm.hpp"

namespace phri_learning
{
struct RecogniserOptions
{
  int window = 30;       ///< W, 1..1000 [samples]
  double leak = 0.01;    ///< 0..0.5
  int confirm = 3;       ///< 1..100 [samples]
  double gate = 1.25;    ///< > 0; a deviation of z standard deviations in every dimension costs z^2 / 2 [nat per dim.]
  double outlier = 6.0;  ///< > gate [nat per dimension]
  int least = 5;         ///< samples before anything is known, 1..window
};

/// Throws std::invalid_argument naming option, value and range.
void checkOptions(const RecogniserOptions& options);

struct RecognisedModel
{
  std::shared_ptr<const TimeHmm> hmm;
  /// Mean increment on examples of the movement [nat]; see typicalIncrement.
  double typical = 0.0;
};

/// Mean over all samples of the increments of a model on examples (T_e, d), each from its beginning.
double typicalIncrement(const TimeHmm& hmm, const std::vector<Eigen::MatrixXd>& examples, double leak);

class PrimitiveRecogniser
{
public:
  struct Entry
  {
    double log_likelihood = 0.0;  ///< sum over the window [nat]
    int state = -1;               ///< likeliest now
    double time = 0.0;            ///< expected model time of the states now [s]
    double progress = 0.0;        ///< time / length, 0..1
  };

  /// Throws std::invalid_argument: options, no model given in an entry, differing dimensions. No entry at all is fine:
  /// then nothing is ever known.
  explicit PrimitiveRecogniser(std::vector<RecognisedModel> models, const RecogniserOptions& options = {});
  ~PrimitiveRecogniser();
  PrimitiveRecogniser(PrimitiveRecogniser&&) noexcept;
  PrimitiveRecogniser& operator=(PrimitiveRecogniser&&) noexcept;

  void reset();
  /// Takes the next sample x (d), dt of the models after the last one; the entries in the order of the models. Throws
  /// std::invalid_argument for another size or if it is not finite; nothing changes then.
  const std::vector<Entry>& filter(const Eigen::Ref<const Eigen::VectorXd>& x);

  const std::vector<Entry>& entries() const { return entries_; }
  /// Index of the model in force, -1 while none is known.
  int winner() const { return known_ ? winner_ : -1; }
  /// (log_likelihood / samples in the window - typical) / d of a model; at least -gate: known [nat].
  double excess(int model) const;
  int samples() const { return samples_; }  ///< in the window
  const std::vector<RecognisedModel>& models() const { return models_; }
  const RecogniserOptions& options() const { return options_; }

private:
  struct Filters;
  void choose();

  std::vector<RecognisedModel> models_;
  RecogniserOptions options_;
  std::unique_ptr<Filters> filters_;
  std::vector<Entry> entries_;
  Eigen::MatrixXd increments_;  // (W, models), ring of rows
  int head_ = 0, samples_ = 0, winner_ = -1, rival_ = -1, rival_samples_ = 0;
  bool known_ = false;
};
}  // namespace phri_learning
