#pragma once
/// What an EmergingPartner knows: a primitive library and everything that predicting with it needs, made once per
/// learned segment, immutable, shared between threads behind a pointer.

#include <Eigen/Core>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "phri_learning/displacement_regression.hpp"
#include "phri_learning/emerging_options.hpp"
#include "phri_learning/primitive_library.hpp"

namespace phri_learning
{
/// A primitive with its neighbours (figure 3.2): its own states, before them the last of its likeliest predecessor,
/// after them the first of its likeliest successor, concatenated by (3.13). It holds every window HMM of
/// `window_states` states that is centred in the primitive, so that a movement on its way from one primitive to the
/// next is explained, and predicted, by one model.
struct PrimitiveWindow
{
  std::shared_ptr<const TimeHmm> hmm;
  int before = 0;      ///< states of the predecessor
  double begin = 0.0;  ///< time at which the primitive itself begins [s]
};

/// `before` and `after` may be null. Throws std::invalid_argument as `concatenate`, and for an odd number of window
/// states or less than 2.
PrimitiveWindow primitiveWindow(const TimeHmm* before, const TimeHmm& own, const TimeHmm* after, int window_states);

struct LearnedPrimitive
{
  int node = 0;                          ///< of the library
  int predecessor = -1, successor = -1;  ///< likeliest ones by the graph of successions; -1: none seen
  std::shared_ptr<const TimeHmm> own;    ///< the node's model
  PrimitiveWindow window;
  std::shared_ptr<const TimeHmm> recognised;  ///< the window HMM over the recognised dimensions, `spread` added
  double typical = 0.0;                       ///< of `recognised` on the remembered members [nat per sample]
  /// Of the remembered members, each with the beginning of what followed it; null for Reference::kPath.
  std::shared_ptr<const DisplacementRegression> displacement;
  std::vector<std::pair<int, int>> fitted;  ///< segments and numbers of samples that it was fitted to
};

/// Samples of the latest segments of a node's branch, at most as many as a node is trained on, in order of arrival.
std::vector<Eigen::MatrixXd> memberSamples(const PrimitiveLibrary& library, int node);

struct LearnedPrimitives
{
  EmergingOptions options;
  PrimitiveLibrary library;
  std::vector<LearnedPrimitive> primitives;  ///< the upper nodes, in the order of their ids
};

/// A stretch of the samples between two boundaries, as the partner commits it.
struct CommittedSegment
{
  Eigen::MatrixXd samples;  ///< (T, 3 dof) at the learner's rate
  double begin = 0.0;       ///< time of its first sample [s]
  bool follows = false;     ///< right after the segment before
  int ended = -1;           ///< prototype id of the segmentation, see Boundary
  double margin = 0.0;      ///< of the boundary at its end, see Boundary
};

/// The slow half: turns segments into knowledge. Belongs to one thread, which need not be the partner's.
class PrimitiveLearner
{
public:
  explicit PrimitiveLearner(const EmergingOptions& options);
  /// Goes on with a library, e.g. a loaded one. Throws std::invalid_argument if it is of another dimension or sampling
  /// time than the options. Models that predict are fitted again from the remembered segments.
  PrimitiveLearner(const EmergingOptions& options, PrimitiveLibrary library);

  /// Learns from a segment; the knowledge from now on. Throws std::invalid_argument as PrimitiveLibrary::add.
  std::shared_ptr<const LearnedPrimitives> add(const CommittedSegment& segment);
  std::shared_ptr<const LearnedPrimitives> snapshot() const { return snapshot_; }

  /// The library's file (PrimitiveLibrary::save). It does not hold what is fitted from the library: loading fits again.
  void save(const std::string& path) const { snapshot_->library.save(path); }
  static PrimitiveLearner load(const EmergingOptions& options, const std::string& path);

private:
  using Segments = std::map<int, std::shared_ptr<const Eigen::MatrixXd>>;  // by id
  void refresh(PrimitiveLibrary library);
  void fitDisplacement(const Segments& all, const Segments& own, LearnedPrimitive* primitive) const;

  EmergingOptions options_;
  std::shared_ptr<const LearnedPrimitives> snapshot_;
};
}  // namespace phri_learning
