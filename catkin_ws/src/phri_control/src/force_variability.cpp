#include "phri_control/force_variability.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "phri_core/check.hpp"

namespace phri_control
{
MatrixDof covarianceMax(const MatrixDof& a, const MatrixDof& b) noexcept
{
  constexpr double kRank = 1e-14;  // of the largest eigenvalue
  const Eigen::Index n = a.rows();
  MatrixDof sum = a + b;
  if (n == 0 || !sum.allFinite())
    return sum;
  const Eigen::SelfAdjointEigenSolver<MatrixDof> range(sum);
  const double largest = range.eigenvalues()(n - 1);
  if (!(largest > 0.0))
    return MatrixDof::Zero(n, n);
  Eigen::Index zeros = 0;  // eigenvalues are ascending
  while (range.eigenvalues()(zeros) <= kRank * largest)
    ++zeros;
  const Eigen::Index rank = n - zeros;
  const phri_core::VectorDof root = range.eigenvalues().tail(rank).cwiseSqrt();
  const MatrixDof basis = range.eigenvectors().rightCols(rank);

  const MatrixDof whitener = basis * root.cwiseInverse().asDiagonal();  // C^-1/2 up to a rotation, which cancels
  const MatrixDof whitened = whitener.transpose().lazyProduct(a.lazyProduct(whitener).eval());
  const Eigen::SelfAdjointEigenSolver<MatrixDof> shares(whitened);
  const phri_core::VectorDof larger =
      shares.eigenvalues().cwiseMax((phri_core::VectorDof::Ones(rank) - shares.eigenvalues()));
  const MatrixDof back = (basis * root.asDiagonal()).lazyProduct(shares.eigenvectors());
  const MatrixDof result = (back * larger.asDiagonal()).lazyProduct(back.transpose());
  return 0.5 * (result + result.transpose());
}

ForceWindow::ForceWindow(Eigen::Index dof, double duration, double dt) : dof_(dof), duration_(duration)
{
  constexpr double kLongest = 60.0;
  phri_core::requireRange("ForceWindow: dof", static_cast<double>(dof), 1, phri_core::kMaxDof, "");
  phri_core::requireRange("ForceWindow: duration", duration, 1e-6, kLongest, "s");
  phri_core::requireRange("ForceWindow: dt", dt, 1e-6, duration, "s");
  samples_.assign(static_cast<std::size_t>(std::max(1.0, std::round(duration / dt))),
                  { 0.0, phri_core::VectorDof::Zero(dof) });
}

bool ForceWindow::add(double t, const phri_core::VectorDof& force) noexcept
{
  if (!std::isfinite(t) || force.size() != dof_ || !force.allFinite() || (count_ > 0 && t <= samples_[newest_].t))
    return false;
  newest_ = (newest_ + 1) % samples_.size();
  samples_[newest_].t = t;
  samples_[newest_].force = force;
  count_ = std::min(count_ + 1, samples_.size());
  return true;
}

ForceMoments ForceWindow::moments(double t) const noexcept
{
  constexpr double kTick = 1e-9;  // [s] times are sums of decimal steps: the sample at t - duration is outside
  ForceMoments result{ 0, phri_core::VectorDof::Zero(dof_), MatrixDof::Zero(dof_, dof_), MatrixDof::Zero(dof_, dof_) };
  const auto each = [&](auto&& visit) {
    for (std::size_t i = 0; i < count_; ++i)
    {
      const Sample& sample = samples_[(newest_ + samples_.size() - i) % samples_.size()];
      if (sample.t <= t + kTick && sample.t > t - duration_ + kTick)
        visit(sample.force);
    }
  };
  each([&](const phri_core::VectorDof& force) {
    ++result.count;
    result.mean += force;
    result.second_moment += force.lazyProduct(force.transpose());
  });
  if (result.count == 0)
    return result;
  const double share = 1.0 / result.count;
  result.mean *= share;
  result.second_moment *= share;
  each([&](const phri_core::VectorDof& force) {  // a second pass: E uu' - u0 u0' cancels where the mean is large
    const phri_core::VectorDof deviation = force - result.mean;
    result.covariance += share * deviation.lazyProduct(deviation.transpose());
  });
  return result;
}
}  // namespace phri_control
