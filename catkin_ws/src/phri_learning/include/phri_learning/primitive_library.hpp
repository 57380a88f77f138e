#pragma once
/// Movement primitives learned one segment at a time: a tree by incremental clustering (section 3.1.2, after Kulic,
/// Takano and Nakamura, IJRR 27, 2008) and a graph of which primitive follows which.
///
/// Every segment becomes a TimeHmm, compared with `spread` added to its covariances. A node holds items: its child
/// nodes and the segments that belong to no child. With D_ij the distance of items i and j, the items are grouped by
/// complete linkage as long as no two of a group are farther apart than K_cut times the mean of D over all pairs of
/// items. A group then becomes one child
///   - of its own, if it is segments only, m or more of them;
///   - the child it contains, which takes the segments in (this is how a segment descends);
///   - one for several, if it contains several children (siblings are compared at every step).
/// A node's model is trained on the segments of its whole branch. The root has no model.
///
/// Values: copying a library copies pointers to immutable models and segments. To learn without disturbing a predictor,
/// add to a copy in another thread, which is the slow part (training), and exchange the two, which is the fast part.

#include <Eigen/Core>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "phri_learning/hmm_training.hpp"
#include "phri_learning/model_file.hpp"
#include "phri_learning/time_hmm.hpp"

namespace phri_learning
{
/// Distance of two models, -(D_12 + D_21) / 2 with D_12 = [log P(O_2 | 1) - log P(O_2 | 2)] / T_2 and O_i the
/// generalised output of model i (regress at 0, dt, .. length): symmetric, 0 for a model and itself, >= 0 in
/// expectation (a single pair may come out slightly negative) [nat per sample]. (The thesis prints D without the
/// minus.)
double modelDistance(const TimeHmm& first, const TimeHmm& second);
/// (T, d), T >= 2.
Eigen::MatrixXd generalisedOutput(const TimeHmm& model);

/// How the mean over pairs is taken.
enum class CutRule
{
  /// D < K mean D. One far outlier raises the mean of all, and everything else is thrown together.
  kMean,
  /// log(1 + D) < K mean log(1 + D), with D < 0 as 0: log-likelihoods grow with the square of a deviation, so the plain
  /// mean is that of the farthest pair alone.
  kLogMean
};

struct PrimitiveOptions
{
  TrainingOptions training;  ///< of every segment's and node's model
  int members = 3;           ///< m: segments that make a primitive, >= 2
  double cutoff = 0.6;       ///< K_cut, 0 < K_cut < 1
  CutRule rule = CutRule::kLogMean;
  /// Repetitions of one primitive differ by about this fraction of the data's size (standard deviation of all samples
  /// so far, per dimension). Models are compared with that much variance added; otherwise a straight segment along an
  /// axis, whose other dimensions hardly vary, would be far from its own repetition. > 0. A size below 1e-9 (a
  /// nanometre) counts as that much: rounding is no shape.
  double spread = 0.1;
  double laplace = 0.0;  ///< alpha >= 0 of the succession probabilities
  int remembered = 12;   ///< segments that a node keeps for training and clustering, >= m; the oldest is forgotten, but
                         ///< still counted. Bounds the work of an add and the memory for segments.
  int waiting = 40;      ///< the same for the root's own segments, which belong to no primitive yet, >= remembered
};

/// Throws std::invalid_argument naming option, value and range.
void checkOptions(const PrimitiveOptions& options);

/// A model with its generalised output; immutable, shared by copies.
struct EncodedModel
{
  int serial = 0;  ///< unique within a library
  std::shared_ptr<const TimeHmm> hmm;
  Eigen::MatrixXd output;
};

struct PrimitiveSegment
{
  int id = 0;                                      ///< 0, 1, .. in the order of arrival
  std::shared_ptr<const Eigen::MatrixXd> samples;  ///< (T, d)
  std::shared_ptr<const EncodedModel> model;
};

struct PrimitiveNode
{
  int id = 0;  ///< 0 is the root; ids are never used again
  int parent = -1;
  std::vector<int> children;
  std::vector<PrimitiveSegment> segments;     ///< its own, i.e. in no child; the latest ones
  int count = 0;                              ///< segments ever added to its branch
  std::shared_ptr<const EncodedModel> model;  ///< null for the root
};

class PrimitiveLibrary
{
public:
  explicit PrimitiveLibrary(PrimitiveOptions options = {});

  /// Learns from a segment (T, d); returns the nodes it belongs to, from the root down. `follows`: it came right after
  /// the segment added before. Throws std::invalid_argument for what `train` refuses or another d than before; the
  /// library is then unchanged.
  std::vector<int> add(const Eigen::MatrixXd& segment, bool follows = true);
  /// Takes in another library of equal options and dimension: all its nodes and segments, counts added, equal
  /// primitives of the two merged. Its segments come after this one's. Throws std::invalid_argument if they do not fit.
  void merge(const PrimitiveLibrary& other);

  const PrimitiveOptions& options() const { return options_; }
  int dimension() const { return dimension_; }  ///< 0 before the first segment
  int segmentCount() const { return static_cast<int>(node_of_.size()); }
  std::vector<int> nodeIds() const;
  /// Throws std::invalid_argument for an unknown id.
  const PrimitiveNode& node(int id) const;
  /// Path from the root to the node that holds the segment.
  std::vector<int> path(int segment) const;

  /// The upper node of each branch: the primitives that predict (3.1.3), in the order of their ids.
  const std::vector<int>& upperNodes() const { return node(0).children; }
  /// Upper node of a segment, -1 as long as it belongs to none.
  int primitiveOf(int segment) const;
  /// What can be predicted with: the models of the upper nodes, and, if `single`, of the remembered segments that
  /// belong to none, so that the first repetition of a movement already finds its example. Second: node id, or -1 -
  /// segment id.
  std::vector<std::pair<std::shared_ptr<const TimeHmm>, int>> models(bool single = false) const;

  /// How the upper nodes follow each other. Row: before, column: after, in the order of upperNodes(). Segments that
  /// belong to no upper node yet are not counted; once they do, they are.
  struct Successions
  {
    std::vector<int> nodes;
    Eigen::MatrixXi counts;
    Eigen::MatrixXd probability;  ///< (n + alpha) / (sum + alpha N); a row without any is 0 (alpha = 0)
  };
  Successions successions() const;

  /// JSON as in model_file.hpp, schema "phri_learning/PrimitiveLibrary"; throws ModelFileError. Everything comes back
  /// to the last bit.
  void save(const std::string& path) const;
  static PrimitiveLibrary load(const std::string& path);

private:
  struct Item;
  std::shared_ptr<const EncodedModel> encode(const std::vector<Eigen::MatrixXd>& samples);
  std::shared_ptr<const EncodedModel> encoded(TimeHmm model);
  double distance(const EncodedModel& first, const EncodedModel& second);
  std::shared_ptr<const TimeHmm> compared(const EncodedModel& model);
  void updateSize();
  void cluster(int node);
  bool clusterOnce(int node);
  void form(int parent, const std::vector<Item>& group);
  void retrain(int node);
  void forgetOldest(int node);
  std::vector<PrimitiveSegment> branch(int node) const;
  PrimitiveNode& at(int id) { return nodes_.at(id); }

  PrimitiveOptions options_;
  int dimension_ = 0, next_node_ = 1, next_serial_ = 0;
  std::map<int, PrimitiveNode> nodes_;
  std::vector<int> node_of_;   // by segment id; forgotten segments too
  std::vector<char> follows_;  // by segment id
  double samples_ = 0.0;       // of all segments, with their sums and sums of squares
  Eigen::VectorXd sum_, squares_;
  Eigen::VectorXd size_;  // of the data as comparisons use it; follows the data when it is more than 10 % off
  // by serials; only save time
  std::map<int, std::shared_ptr<const TimeHmm>> compared_;
  std::map<std::pair<int, int>, double> distances_;
};
}  // namespace phri_learning
