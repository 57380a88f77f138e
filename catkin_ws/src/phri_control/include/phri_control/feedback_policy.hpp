#pragma once
#include <Eigen/Core>
#include <vector>

#include "phri_core/spatial.hpp"

namespace phri_control
{
/// Feedback gain (dof, 2 dof) [N/m, Ns/m]; lives on the stack whatever its size.
using MatrixGain =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, phri_core::kMaxDof, 2 * phri_core::kMaxDof>;

/// The only value that crosses from the slow loop (planning, 50 Hz) into the fast one (1 kHz): over a horizon,
///   u_r(t, xi) = L_k (xi - mu_k) + l_k,    k = floor((t - t0) / dt),
/// in the control frame, u_r exerted BY the robot ON the object. The minus sign of a restoring gain is inside L.
///
/// One rule everywhere: a policy is valid to its horizon's end t0 + T dt; then it holds its last stage and cross-fades
/// to passive (u_r = 0) within kFade by the C1 smoothstep. Before t0 the first stage holds.
class FeedbackPolicy
{
public:
  static constexpr double kFade = 0.2;  ///< [s] from the horizon's end to passive

  struct Stage
  {
    MatrixGain gain;                   ///< L (dof, 2 dof) [N/m, Ns/m]
    phri_core::VectorState reference;  ///< mu (2 dof) [m, rad; m/s, rad/s]
    phri_core::VectorDof feedforward;  ///< l (dof) [N, Nm]
  };

  /// No stage: passive and expired at all times.
  FeedbackPolicy() = default;

  /// `source` tells policies of different controllers or strategies apart: the loop cross-fades when it changes.
  /// Throws std::invalid_argument unless t0 is finite, dt in (0, 1] s, there is a stage, and all stages have the same
  /// sizes (m, 2 m), m = 1..6, and finite elements.
  FeedbackPolicy(double t0, double dt, std::vector<Stage> stages, int source = 0);

  /// u_r at time `t` [s] and state `xi` (2 dof). For the tick: allocates nothing. True if `u` is the policy's output,
  /// with the fade applied; false, with u = 0 of xi's size, if the policy is empty or expired, the size of xi is not
  /// the policy's, or the output would not be finite.
  bool act(double t, const phri_core::VectorState& xi, phri_core::VectorDof& u) const noexcept;

  /// Share of the policy in u_r: 1 up to the horizon's end, 0 from kFade after it on. [-]
  double weight(double t) const noexcept;
  /// Nothing is left of it at `t`: u_r = 0 from here on.
  bool expired(double t) const noexcept { return !(weight(t) > 0.0); }

  /// The stage that holds at `t`; precondition: not empty().
  const Stage& stageAt(double t) const noexcept;

  bool empty() const noexcept { return stages_.empty(); }
  Eigen::Index dof() const noexcept { return empty() ? 0 : stages_.front().gain.rows(); }
  double t0() const noexcept { return t0_; }
  double dt() const noexcept { return dt_; }
  double horizonEnd() const noexcept { return t0_ + dt_ * static_cast<double>(stages_.size()); }
  const std::vector<Stage>& stages() const noexcept { return stages_; }
  int source() const noexcept { return source_; }
  /// Tells policies of one source under different settings apart: a change of it is cross-faded like one of the source.
  int generation() const noexcept { return generation_; }
  void setGeneration(int generation) noexcept { generation_ = generation; }

private:
  double t0_ = 0.0, dt_ = 1e-3;
  std::vector<Stage> stages_;
  int source_ = 0, generation_ = 0;
};
}  // namespace phri_control
