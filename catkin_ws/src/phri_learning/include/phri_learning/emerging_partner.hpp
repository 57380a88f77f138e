#pragma once
/// The robot partner of 3.1 and 5.1.1: knows nothing at first and hence predicts nothing (a passive follower), cuts
/// what it observes into segments, and predicts as soon as primitives have been learned from them.
///
///   EmergingPartner partner(options);          // fast half, the thread of the observations
///   PrimitiveLearner learner(options);         // slow half, any thread
///   partner.observe(..); partner.predict(..);  // constant time
///   learn(&partner, &learner);                 // both halves in one thread, e.g. lockstep, at times of the host's
///   choice
/// or, with learning in a thread of its own,
///   segments = partner.takeSegments();  ->  snapshot = learner.add(segment)  ->  partner.adopt(snapshot)
/// where takeSegments and adopt belong to the thread of the observations.
///
/// Observations are resampled to the learner's rate by linear interpolation. A prediction speaks of the time of the
/// last observation and after. It is empty while no primitive is recognised. Points farther away than 0.02 m are for
/// the assistance to ignore (phri_control::withinGate).
///
/// Smoothness: when the recognised primitive or the knowledge changes, the difference of the two forecasts of the same
/// moments fades within `blend` samples.

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "phri_core/interaction.hpp"
#include "phri_learning/emerging_options.hpp"
#include "phri_learning/learned_primitives.hpp"
#include "phri_learning/primitive_recogniser.hpp"

namespace phri_learning
{
class PartnerForecaster;
class SegmentMemory;

class EmergingPartner : public phri_core::BehaviorModel
{
public:
  explicit EmergingPartner(const EmergingOptions& options = {});
  ~EmergingPartner() override;
  EmergingPartner(EmergingPartner&&) noexcept;

  /// End of a movement (a trial): its open segments are committed, the last one up to the last sample; what was learned
  /// stays. May allocate.
  void reset() override;
  /// Times must rise. Constant time, allocates nothing. Throws std::invalid_argument if it is not finite, of another
  /// number of degrees of freedom, or not later than the last one; the partner is then unchanged.
  void observe(const phri_core::Observation& observation) override;
  /// Gaussians over [x_d; xdot_d] and u_h; nothing while no primitive is recognised. Throws std::invalid_argument for a
  /// horizon longer than that of the options.
  std::optional<phri_core::Prediction> predict(double horizon, double dt) override;
  /// The same into `result`; false: nothing is predicted. Allocates nothing if `result` comes from the same call.
  bool predict(double horizon, double dt, phri_core::Prediction* result);

  /// Segments committed since the last call, in order. May allocate.
  std::vector<CommittedSegment> takeSegments();
  /// Predicts with this from now on; recognition looks back at the window it has seen. May allocate. Throws
  /// std::invalid_argument without a snapshot, or if it was learned at another dt, dof or reference.
  void adopt(std::shared_ptr<const LearnedPrimitives> learned);

  const EmergingOptions& options() const { return options_; }
  const std::shared_ptr<const LearnedPrimitives>& learned() const { return learned_; }  ///< null: nothing yet
  /// Library node recognised now, -1: none.
  int primitive() const;
  /// Time since the beginning of that primitive [s]; negative or beyond its length while on the way from or to another.
  double primitiveTime() const;
  const PrimitiveRecogniser& recogniser() const;
  std::int64_t samples() const { return samples_; }  ///< at the learner's rate, since reset
  int waitingSegments() const;                       ///< committed, not taken
  int lostSegments() const;                          ///< because nobody took them

private:
  void take(double time);

  EmergingOptions options_;
  std::shared_ptr<const LearnedPrimitives> learned_;
  std::unique_ptr<PartnerForecaster> forecaster_;  // what is recognised and expected
  std::unique_ptr<SegmentMemory> memory_;          // samples, cut into segments
  Eigen::VectorXd latest_, previous_, sample_;
  double start_time_ = 0.0, latest_time_ = 0.0, sample_time_ = 0.0;
  std::int64_t samples_ = 0;
};

/// Learns from all segments that wait, and adopts the result. Returns their number.
int learn(EmergingPartner* partner, PrimitiveLearner* learner);
}  // namespace phri_learning
