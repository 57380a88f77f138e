#pragma once
/// Settings of the partner that learns while it interacts; the defaults are those of 3.1.3 and 5.1.1.

#include "phri_learning/behavior_models.hpp"
#include "phri_learning/primitive_library.hpp"
#include "phri_learning/primitive_recogniser.hpp"
#include "phri_learning/segmentation.hpp"
#include "phri_learning/time_tracker.hpp"

namespace phri_learning
{
/// The segmentation's own defaults are for long recordings at rest between movements; these cut a movement that goes on
/// and on wherever its direction changes for good.
inline SegmentationOptions emergingSegmentation()
{
  SegmentationOptions o;
  o.window = 16;
  o.switch_cost = 6.0;
  o.lag = 30;
  return o;
}

struct EmergingOptions
{
  int dof = 2;           ///< degrees of freedom of the object, 1..6; samples are [x; xdot; u_h], 3 dof
  double dt = 0.05;      ///< sampling time of learning and recognition [s]; observations may come at any other
  double horizon = 0.3;  ///< farthest prediction [s]
  /// kPath: where the primitive was when it was learned. It does not follow the handle, so a robot that tracks it
  /// corrects deviations, and can go on alone: this is what assistance needs. kDisplacement: from where the handle is
  /// now, by DisplacementMixture: the better prediction of what the partner will do, but a reference that moves with
  /// the handle.
  Reference reference = Reference::kPath;
  /// kPath only. kRegressed and kPosition: time follows from the place alone, so a robot that goes on by itself finds
  /// its way, and one whose partner waits does not run ahead.
  TimeEstimate time = TimeEstimate::kRegressed;
  Recognition progress = Recognition::kPosition;  ///< kPath only: what tells where in a primitive the partner is
  /// What tells which primitive it is. Not the force: it changes as soon as the robot helps.
  Recognition recognition = Recognition::kMotion;
  int window_states = 20;  ///< of the window HMM, even
  /// For recognition, positions may be off by this fraction of the size (standard deviation) of all that was learned,
  /// beyond what a primitive's members show: few members promise more than a new repetition keeps.
  double spread = 0.1;
  /// The same for velocities and forces. Large, so that direction counts and pace does not: a partner who pauses is
  /// still recognised, one who goes the other way is not.
  double motion_spread = 0.5;
  int blend = 5;       ///< samples over which a change of primitive or of knowledge is blended, 0..100
  int shortest = 12;   ///< a segment of fewer samples is not learned from [samples]
  int longest = 1200;  ///< of a longer segment the latest so many are learned from [samples]
  int queue = 16;      ///< segments that wait for learning at most; then the oldest is lost, and counted
  Recognition segmented = Recognition::kMotion;  ///< what is segmented
  RecogniserOptions recogniser;
  /// Its dt is ignored. Without `scale`, every dimension is divided by its standard deviation over the first
  /// `scale_samples` samples; segmentation then begins with these, late, and catches up.
  SegmentationOptions segmentation = emergingSegmentation();
  int scale_samples = 200;      ///< 2..10000
  PrimitiveOptions primitives;  ///< its training.dt is ignored
};

/// Throws std::invalid_argument naming option, value and range.
void checkOptions(const EmergingOptions& options);

/// Leading dimensions of [x; xdot; u_h] that recognise.
int recognisedDimensions(Recognition recognition, int dof);
}  // namespace phri_learning
