#pragma once
/// How much a force varies, for the noise of the risk-sensitive controllers (5.3.3, 5.4.2): moments over a sliding
/// window, and the larger of two covariances, eps = max(eps_e, eps_c) of what a model expects and what is observed.

#include <Eigen/Core>
#include <vector>

#include "phri_core/spatial.hpp"

namespace phri_control
{
/// Covariance of a force (dof, dof) [N^2]; lives on the stack whatever its size.
using MatrixDof =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, phri_core::kMaxDof, phri_core::kMaxDof>;

/// The maximum of two covariances: with C = S1 + S2 and C^-1/2 S1 C^-1/2 = V diag(d) V' on the range of C,
///   max = C^1/2 V diag(max(d, 1 - d)) V' C^1/2.
/// Not below either of them (in the sense of positive semi-definite differences), symmetric in its arguments, entrywise
/// for diagonal ones, `S` for (S, S), scales with them; singular and zero ones are fine (eigenvalues of C below 1e-14
/// of the largest count as 0). Allocates nothing; the caller promises symmetric positive semi-definite matrices of one
/// size: what is not finite gives what is not finite.
MatrixDof covarianceMax(const MatrixDof& a, const MatrixDof& b) noexcept;

/// Means over the samples of a window.
struct ForceMoments
{
  int count = 0;              ///< of samples; 0: everything below is 0
  phri_core::VectorDof mean;  ///< u_0 [N]
  MatrixDof second_moment;    ///< about zero, 1/n sum u u' [N^2]
  MatrixDof covariance;       ///< about the mean, 1/n sum (u - u_0)(u - u_0)' [N^2]
};

/// The samples of the last `duration` seconds. `add` and `moments` allocate nothing.
class ForceWindow
{
public:
  /// Room for round(duration / dt) samples: samples that come faster than every `dt` push older ones out early. Throws
  /// std::invalid_argument unless dof is 1..6 and 0 < dt <= duration <= 60 s.
  ForceWindow(Eigen::Index dof, double duration, double dt);

  /// Takes `force` [N] at time `t` [s]; times must increase. False, and nothing is taken, if they do not, if the size
  /// is wrong or an element is not finite.
  bool add(double t, const phri_core::VectorDof& force) noexcept;

  /// Over the samples in (t - duration, t], each of the same weight; summed anew each time, so that nothing drifts.
  ForceMoments moments(double t) const noexcept;

  void clear() noexcept { count_ = 0; }

private:
  struct Sample
  {
    double t;
    phri_core::VectorDof force;
  };

  Eigen::Index dof_;
  double duration_;
  std::vector<Sample> samples_;  // ring
  std::size_t newest_ = 0, count_ = 0;
};
}  // namespace phri_control
