#pragma once
/// On-line segmentation of a time series where the distribution of its recent samples changes (section 3.1.2, after
/// Kohlmorgen and Lemm, NIPS 14, 2001).
///
/// Window t holds the last W embedded samples x_t = (y_t, y_{t - tau}, .., y_{t - (m - 1) tau}), divided by `scale` and
/// sigma, as a Parzen density with Gaussian kernels. With g = exp(-|.|^2 / 4) and S_ab = mean of g over all pairs of
/// two windows, int (p - q)^2 dx is proportional to S_aa + S_bb - 2 S_ab. Every window is also a state, its prototype.
/// The segmentation is the state sequence that minimises
///   sum_t d(prototype s_t, window t) + switch_cost * (number of switches).
/// In the model's terms switch_cost = 2 v^2 log k, where staying is k times as likely as switching to a given state.
///
/// Two properties to know. A regime is seen through windows, so it must last about 2 W samples, and a repeated movement
/// is ONE regime if W covers its period. A series in slow drift is cut wherever that pays: use velocities or
/// forces rather than positions for point-to-point movements.

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

namespace phri_learning
{
enum class WindowDistance
{
  kSquared,    ///< S_aa + S_bb - 2 S_ab, the integral without its constant, 0..2; small for any two wide densities
  kNormalized  ///< (S_aa + S_bb - 2 S_ab) / (S_aa + S_bb), 0..1: 1 for two densities without overlap, however wide
};

struct SegmentationOptions
{
  int window = 24;           ///< W, 2..1000 [samples]
  int embedding = 1;         ///< m, 1..50
  int delay = 1;             ///< tau, 1..1000 [samples]
  double switch_cost = 9.5;  ///< C, > 0, in units of the distance summed over windows
  int lag = 35;              ///< L: a boundary is committed when it has stayed where it is for L samples
  int slack = 3;             ///< how far a boundary may move and still count as where it was [samples]
  int horizon = 600;         ///< H > 2 (L + W): most windows under consideration; bounds memory, work and delay
  int prototypes = 16;       ///< most prototypes of past segments that are kept; the least recently used goes first
  double sigma = 1.0;        ///< width of the kernels in units of `scale`; 0: by the neighbour rule, see sigma_samples
  int sigma_samples = 120;   ///< sigma = 0 only: samples from which `neighbourSigma` sets sigma once, then fixed
  double dt = 0.05;          ///< sampling time [s]; only turns indices into times
  WindowDistance distance = WindowDistance::kNormalized;
  Eigen::VectorXd scale;  ///< size of each dimension of a sample, > 0 [unit of the data]; empty: 1
};

/// Throws std::invalid_argument naming option, value and range; `dimension` is that of a sample.
void checkOptions(const SegmentationOptions& options, int dimension);

struct Boundary
{
  std::int64_t index = 0;  ///< first sample of the new segment since construction or finish(); see OnlineSegmentation
  double time = 0.0;       ///< index dt [s]
  /// Id of the prototype of the segment that ended here. Equal ids: the same regime came back; different ids need not
  /// mean different regimes, since a window of its own often fits a segment better than the prototype that was kept.
  int ended = -1;
  double margin = 0.0;  ///< by how much one prototype for both neighbours would be dearer, >= 0; small: doubtful
  int delay = 0;        ///< samples between the boundary and its commitment
  bool forced = false;  ///< committed because the horizon was full, not because it stayed where it was
};

/// The neighbour rule: mean distance of a sample (row, already divided by its scale) to its first `neighbours`
/// neighbours; 1 where that is 0 (all samples equal), since any width then gives the same distances.
double neighbourSigma(const Eigen::Ref<const Eigen::MatrixXd>& samples, int neighbours);

/// Commits boundaries with a bounded delay. Each push re-solves the windows under consideration exactly (every state,
/// new and old, through the whole of them), so with horizon and lag longer than the series it is the off-line optimum.
/// Once the first boundary has not moved for `lag` samples it is committed: everything before it is forgotten but the
/// prototype of the segment that ended, which stays a state to return to. If the horizon fills first, that boundary is
/// committed as `forced`; without one old enough, the oldest window is dropped and the regime in force is kept.
/// So delay <= horizon + span/2.
///
/// A boundary's index is the middle of the first window of the new segment: with span = W + (m - 1) tau samples seen by
/// a window, a change of regime is located within span samples at worst.
///
/// Memory, all of it taken at construction and never more (embedded dimension D = m dim):
/// 9 H (H + P) + 8 (H + P) (W + 7) + 8 D (H + W + P W) bytes and small change; push allocates nothing. Work per push:
/// O(H (H + P)) additions, O((H + P W) D) for kernels.
class OnlineSegmentation
{
public:
  OnlineSegmentation(const SegmentationOptions& options, int dimension);

  /// Takes a sample (dim). Throws std::invalid_argument if it has another size or is not finite (nothing changes then).
  std::optional<Boundary> push(const Eigen::Ref<const Eigen::VectorXd>& sample);
  /// End of the series: the boundaries still open, in order. The prototypes stay known, the index starts again at 0.
  std::vector<Boundary> finish();

  const SegmentationOptions& options() const { return options_; }
  int dimension() const { return dimension_; }
  double sigma() const { return sigma_; }  ///< in force; 0 until the neighbour rule has seen its samples
  std::int64_t samples() const { return samples_ + waiting_; }  ///< of this series
  int openWindows() const { return static_cast<int>(last_ - first_ + 1); }
  int knownPrototypes() const;
  std::size_t memoryBytes() const;  ///< of all arrays

private:
  friend std::vector<Boundary> segmentOffline(const Eigen::Ref<const Eigen::MatrixXd>&, SegmentationOptions);

  bool take(const Eigen::Ref<const Eigen::VectorXd>& sample);  // whether a window was added
  void applySigmaRule();
  bool addEmbedded();
  void addDistances();
  void solve();
  std::optional<Boundary> advance();
  Boundary describe(std::size_t position, bool forced) const;
  double margin(std::size_t position) const;
  int keep(int state);
  void forget(std::int64_t until);
  void restart();

  int openState(std::int64_t window) const { return options_.prototypes + column(window); }
  int column(std::int64_t window) const { return static_cast<int>(window % options_.horizon); }
  int place(std::int64_t sample) const { return static_cast<int>(sample % embedded_.cols()); }

  SegmentationOptions options_;
  int dimension_, span_;
  double sigma_;
  std::int64_t samples_ = 0;            // taken, of this series
  std::int64_t embedded_count_ = 0;     // embedded samples; embedded sample e ends with sample e + (m - 1) tau
  std::int64_t first_ = 0, last_ = -1;  // windows under consideration, named by their last embedded sample
  int waiting_ = 0;                     // samples held back by the neighbour rule
  Eigen::MatrixXd pending_;             // (dim, sigma_samples)
  Eigen::MatrixXd recent_;              // (dim, (m - 1) tau + 1): ring of scaled samples
  Eigen::MatrixXd embedded_;            // (D, H + W): ring of embedded samples by sigma
  Eigen::VectorXd row_;                 // (H + W): kernel of the newest sample with the older ones, then running sums
  Eigen::MatrixXd kernel_;              // (W, W): ring, kernel among the newest W samples
  Eigen::MatrixXd row_sums_;            // (P + H, W): sum of the kernel of sample (ring) with each state's window
  Eigen::VectorXd self_;                // (P + H): S_aa of each state
  Eigen::VectorXd cross_;               // (P + H): S_ab with the newest window
  Eigen::MatrixXd distance_;            // (P + H, H): of state and window; unused states: infinite
  Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic> switched_;  // (P + H, H)
  std::vector<int> best_;                                         // (H): cheapest state at each window
  Eigen::VectorXd start_, cost_;                                  // (P + H)
  std::vector<std::int64_t> starts_;                // of the best path: where each segment after the first begins
  std::vector<int> states_;                         // of the best path: one more than starts_
  std::vector<Eigen::MatrixXd> prototype_samples_;  // P times (D, W)
  std::vector<int> prototype_id_;                   // (P), -1: unused
  std::vector<std::int64_t> prototype_used_;        // (P)
  std::int64_t uses_ = 0;
  int next_id_ = 0;
  int carried_ = -1;          // prototype in force before first_, if windows were dropped since the last boundary
  std::int64_t anchor_ = -1;  // where the first boundary was when it came to rest
  int rested_ = 0;            // samples since
};

/// The exact optimum of the whole series (T, dim) at once: O(T^2) time and memory. `lag`, `slack` and `horizon` play no
/// part. Throws std::invalid_argument as the class does.
std::vector<Boundary> segmentOffline(const Eigen::Ref<const Eigen::MatrixXd>& samples, SegmentationOptions options);
}  // namespace phri_learning
