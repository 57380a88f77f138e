#pragma once
// The two halves of an EmergingPartner's run-time state: what it remembers, and what it expects.

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "phri_core/gaussian.hpp"
#include "phri_learning/displacement_mixture.hpp"
#include "phri_learning/learned_primitives.hpp"
#include "phri_learning/primitive_recogniser.hpp"
#include "phri_learning/segmentation.hpp"
#include "phri_learning/time_tracker.hpp"

namespace phri_learning
{
/// The latest samples, cut into segments. Allocates in the constructor, in finish and in takeSegments only.
class SegmentMemory
{
public:
  explicit SegmentMemory(const EmergingOptions& options);

  void push(const Eigen::VectorXd& sample, double time);
  /// Lets the segmentation take up to `count` samples that it has not seen.
  void segment(int count);
  /// End of the series.
  void finish();

  std::vector<CommittedSegment> takeSegments();
  int waiting() const { return waiting_; }
  int lost() const { return lost_; }

  std::int64_t samples() const { return samples_; }  ///< of the series
  int window() const { return window_; }
  /// Sample, 0: the latest; up to window() - 1, as far as there are any.
  Eigen::MatrixXd::ConstColXpr before(int back) const { return ring_.col(place(samples_ - 1 - back)); }

private:
  struct Slot
  {
    Eigen::MatrixXd samples;  // (3 dof, longest)
    Eigen::Index count = 0;
    double begin = 0.0, margin = 0.0;
    bool follows = false;
    int ended = -1;
  };
  void setScale();
  void feed();
  void commit(std::int64_t end, int ended, double margin);
  Eigen::Index place(std::int64_t sample) const { return static_cast<Eigen::Index>(sample % ring_.cols()); }

  EmergingOptions options_;
  int window_;
  OnlineSegmentation segmentation_;  // sees samples that are divided by scale_ already
  Eigen::VectorXd scale_, scaled_;
  bool scale_known_;
  Eigen::MatrixXd ring_;  // (3 dof, capacity)
  std::int64_t samples_ = 0, segmented_ = 0, begin_ = 0;
  double start_ = 0.0;  // time of sample 0
  bool follows_ = false;
  std::vector<Slot> queue_;
  int first_ = 0, waiting_ = 0, lost_ = 0;
};

/// What is recognised and forecast. Allocates in the constructor and in adopt only.
class PartnerForecaster
{
public:
  explicit PartnerForecaster(const EmergingOptions& options);

  void reset();
  void observe(const SegmentMemory& memory);
  void adopt(std::shared_ptr<const LearnedPrimitives> learned, const SegmentMemory& memory);

  bool known() const { return active_ >= 0; }
  int primitive() const;
  double primitiveTime() const;
  const PrimitiveRecogniser& recogniser() const { return recogniser_; }
  /// `ahead` [s] after the latest sample. Displacements start at `now`, the observation `elapsed` [s] after that
  /// sample.
  const phri_core::Gaussian& at(double ahead, double elapsed, const Eigen::VectorXd& now);

private:
  int current() const;
  int settled(int now);
  void follow(int active, const SegmentMemory& memory);
  void track(const Eigen::Ref<const Eigen::VectorXd>& sample);
  void forecast(int age);
  void interpolate(double ahead, Eigen::VectorXd* mean) const;

  EmergingOptions options_;
  std::shared_ptr<const LearnedPrimitives> learned_;
  PrimitiveRecogniser recogniser_;
  std::vector<TimeTracker> trackers_;          // kPath: of each primitive's window HMM
  std::vector<DisplacementMixture> mixtures_;  // kDisplacement
  ForecastSettings settings_;
  int active_ = -1;  // index of the primitive whose model forecasts
  int rival_ = -1, rival_samples_ = 0;
  std::vector<phri_core::Gaussian> nodes_;  // expected k dt after the latest sample
  Eigen::MatrixXd earlier_;                 // (3 dof, nodes): means before the latest sample
  Eigen::MatrixXd difference_;              // (3 dof, nodes): that fades after a change
  int fading_ = 0;                          // samples that it still fades
  phri_core::Gaussian joint_;
  Eigen::VectorXd offset_;
};
}  // namespace phri_learning
