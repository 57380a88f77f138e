#include "phri_sim/contact_solver.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace phri_sim
{
namespace
{
using Eigen::Matrix2d;
using Eigen::Vector2d;

constexpr int kSweepsFirst = 6;        // before each of Newton's attempts
constexpr int kNewtonSteps = 8;        // of an attempt at friction as it is, and
constexpr int kSoftenedSteps = 20;     // of the first one at softer friction
constexpr double kUnmovable = 1e-300;  // [1/kg] so that tangents that cannot move divide nothing by zero
constexpr double kSoftest = 1e3;       // of the creep, where Newton failed [-]
constexpr double kStiffening = 0.1;    // of that from attempt to attempt; its root where one fails, up to
constexpr double kLeastStiffening = 0.97;
constexpr double kSoftened = 1e-6;  // tolerance of all but the last attempt, which only lead there [-]

/// Impulses of the two tangents that stop the point, or, beyond the cone, that brake it most.
Vector2d tangents(const Matrix2d& stop, double mass, const Vector2d& slip, const Vector2d& before,
                  double limit) noexcept
{
  const Vector2d stick = before - stop * slip;
  if (stick.squaredNorm() <= limit * limit)
    return stick;
  const Vector2d slide = before - mass * slip;
  const double length = slide.norm();
  return length > limit ? Vector2d(slide * (limit / length)) : slide;
}
}  // namespace

ContactSolver::ContactSolver(int max_rows)
  : blocks_(std::size_t(max_rows)),
    velocity_(max_rows),
    trial_(max_rows),
    solved_(max_rows),
    residual_(max_rows),
    jacobian_(max_rows, max_rows),
    pressing_(std::size_t(max_rows))
{
}

int ContactSolver::solve(double h, const Matrix& delassus, const std::vector<CompliantContact>& contacts,
                         const ConstVector& free_velocity, Vector impulses) noexcept
{
  const Eigen::Index rows = delassus.rows();
  setUp(h, delassus, contacts);
  impulses.setZero();
  int taken = 0;
  while (taken < kMaxSweeps)
  {
    velocity_.head(rows) = free_velocity;
    velocity_.head(rows).noalias() += delassus * impulses;
    for (int i = 0; i < kSweepsFirst && taken < kMaxSweeps; ++i)
    {
      ++taken;
      if (sweep(delassus, impulses))
        return taken;
    }
    trial_.head(rows) = impulses;
    bool solved = newton(delassus, free_velocity, 1.0, kNewtonSteps, taken);
    if (!solved)
    {
      trial_.head(rows) = impulses;
      solved = stiffen(delassus, free_velocity, taken);
    }
    if (solved)
    {
      enterCone();
      impulses = trial_.head(rows);
      return taken;
    }
  }
  return kMaxSweeps + 1;
}

/// From friction so soft that Newton's method ends, to friction as it is, in steps short enough that it ends again.
bool ContactSolver::stiffen(const Matrix& delassus, const ConstVector& free_velocity, int& steps) noexcept
{
  auto trial = trial_.head(delassus.rows());
  auto solved = solved_.head(delassus.rows());
  if (!newton(delassus, free_velocity, kSoftest, kSoftenedSteps, steps))
    return false;
  double softening = kSoftest, ratio = kStiffening;
  while (softening > 1.0 && ratio < kLeastStiffening)
  {
    solved = trial;
    const double next = std::max(1.0, softening * ratio);
    if (newton(delassus, free_velocity, next, kNewtonSteps, steps))
    {
      softening = next;
      continue;
    }
    trial = solved;
    ratio = std::sqrt(ratio);
  }
  return softening <= 1.0;
}

void ContactSolver::setUp(double h, const Matrix& delassus, const std::vector<CompliantContact>& contacts) noexcept
{
  used_ = 0;
  for (const CompliantContact& c : contacts)
  {
    Block& block = blocks_[used_++];
    const double inverse_mass = delassus(c.row, c.row), stiffness = c.share * c.stiffness;
    const double damping =
        c.distance > 0.0 ? 0.0 : c.share * 2.0 * c.damping_ratio * std::sqrt(c.stiffness / inverse_mass);
    const double gain = h * stiffness + damping;
    block.row = c.row;
    block.friction = c.friction;
    block.bias = c.distance * stiffness / gain;
    block.softness = 1.0 / (h * gain);
    block.normal_mass = 1.0 / (inverse_mass + block.softness);
    if (c.friction <= 0.0)
      continue;
    Matrix2d steep = delassus.block<2, 2>(c.row + 1, c.row + 1);
    block.creep = kCreep * steep.trace() + kUnmovable;
    steep.diagonal().array() += block.creep;
    block.stop = steep.inverse();
    block.tangent_mass = 1.0 / steep.trace();  // not beyond the inverse of the largest eigenvalue
  }
}

/// One pass over all contacts, keeping velocity_ up to date; true if hardly anything changed any more.
bool ContactSolver::sweep(const Matrix& delassus, Vector impulses) noexcept
{
  auto velocity = velocity_.head(delassus.rows());
  double change = 0.0, largest = 0.0;
  for (std::size_t i = 0; i < used_; ++i)
  {
    const Block& block = blocks_[i];
    const int n = block.row;
    const double excess = velocity(n) + block.bias + block.softness * impulses(n);
    const double normal = std::max(impulses(n) - excess * block.normal_mass, 0.0);
    const double step = normal - impulses(n);
    if (step != 0.0)
    {
      impulses(n) = normal;
      velocity += delassus.col(n) * step;
    }
    change = std::max(change, std::abs(step));
    largest = std::max(largest, normal);
    if (block.friction <= 0.0)
      continue;
    const Vector2d before = impulses.segment<2>(n + 1);
    const Vector2d slip = velocity.segment<2>(n + 1) + block.creep * before;
    const Vector2d after = tangents(block.stop, block.tangent_mass, slip, before, block.friction * normal);
    const Vector2d tangent_step = after - before;
    if (tangent_step.x() != 0.0 || tangent_step.y() != 0.0)
    {
      impulses.segment<2>(n + 1) = after;
      velocity += delassus.col(n + 1) * tangent_step.x() + delassus.col(n + 2) * tangent_step.y();
    }
    change = std::max({ change, std::abs(tangent_step.x()), std::abs(tangent_step.y()) });
  }
  return change <= kTolerance * largest;
}

/// From trial_, in place. Adds the steps it took.
bool ContactSolver::newton(const Matrix& delassus, const ConstVector& free_velocity, double softening, int most,
                           int& steps) noexcept
{
  auto trial = trial_.head(delassus.rows());
  auto velocity = velocity_.head(delassus.rows());
  const double tolerance = softening > 1.0 ? kSoftened : kTolerance;
  for (int i = 0; i < most && steps < kMaxSweeps; ++i, ++steps)
  {
    velocity = free_velocity;
    velocity.noalias() += delassus * trial;
    double off = open(delassus);
    int at = 0;
    for (std::size_t b = 0; b < used_ && at < size_; ++b)
    {
      const Block& block = blocks_[b];
      if (pressing_[std::size_t(at)] != block.row)
        continue;
      off = std::max(off, lineariseNormal(delassus, block, at++));
      if (block.friction <= 0.0)
        continue;
      off = std::max(off, lineariseTangents(delassus, block, softening, at));
      at += 2;
    }
    if (off <= tolerance * trial.cwiseAbs().maxCoeff())
      return true;
    if (!solveLinear())
      return false;
    for (int k = 0; k < size_; ++k)
      trial(pressing_[std::size_t(k)]) -= residual_(k);
  }
  return false;
}

/// Which contacts press; the impulses of all others become zero. Returns the largest impulse so lost.
double ContactSolver::open(const Matrix& delassus) noexcept
{
  auto velocity = velocity_.head(delassus.rows());
  double lost = 0.0;
  size_ = 0;
  for (std::size_t i = 0; i < used_; ++i)
  {
    const Block& block = blocks_[i];
    const int last = block.row + (block.friction > 0.0 ? 2 : 0);
    const double excess = velocity_(block.row) + block.bias + block.softness * trial_(block.row);
    if (trial_(block.row) - excess * block.normal_mass > 0.0)
    {
      for (int row = block.row; row <= last; ++row)
        pressing_[std::size_t(size_++)] = row;
      continue;
    }
    for (int row = block.row; row <= last; ++row)
    {
      if (trial_(row) == 0.0)
        continue;
      lost = std::max(lost, std::abs(trial_(row)));
      velocity -= delassus.col(row) * trial_(row);
      trial_(row) = 0.0;
    }
  }
  return lost;
}

/// Residual and row `at` of the Jacobian: the spring's equation. Returns how far off it is, in impulse; so does the
/// next.
double ContactSolver::lineariseNormal(const Matrix& delassus, const Block& block, int at) noexcept
{
  for (int k = 0; k < size_; ++k)
    jacobian_(at, k) = delassus(pressing_[std::size_t(k)], block.row);
  jacobian_(at, at) += block.softness;
  residual_(at) = velocity_(block.row) + block.bias + block.softness * trial_(block.row);
  return std::abs(residual_(at)) * block.normal_mass;
}

/// Rows `at` and `at` + 1: impulse = projection onto the disc of (impulse - mass x slip), times 1 / mass.
double ContactSolver::lineariseTangents(const Matrix& delassus, const Block& block, double softening, int at) noexcept
{
  const int n = block.row;
  const double creep = softening * block.creep, limit = block.friction * std::max(trial_(n), 0.0);
  const Vector2d impulse = trial_.segment<2>(n + 1);
  const Vector2d slip = velocity_.segment<2>(n + 1) + creep * impulse;
  const Vector2d reach = impulse - block.tangent_mass * slip;
  const double length = reach.norm(), inverse_mass = 1.0 / block.tangent_mass;
  if (length <= limit)
  {
    for (int k = 0; k < size_; ++k)
    {
      jacobian_(at, k) = delassus(pressing_[std::size_t(k)], n + 1);
      jacobian_(at + 1, k) = delassus(pressing_[std::size_t(k)], n + 2);
    }
    jacobian_(at, at) += creep;
    jacobian_(at + 1, at + 1) += creep;
    residual_.segment<2>(at) = slip;
    return slip.cwiseAbs().maxCoeff() * block.tangent_mass;
  }
  const Vector2d along = reach / length;
  const Matrix2d turn = limit / length * (Matrix2d::Identity() - along * along.transpose());
  for (int k = 0; k < size_; ++k)
  {
    const int row = pressing_[std::size_t(k)];
    const double x = delassus(row, n + 1), y = delassus(row, n + 2);
    jacobian_(at, k) = turn(0, 0) * x + turn(0, 1) * y;
    jacobian_(at + 1, k) = turn(1, 0) * x + turn(1, 1) * y;
  }
  jacobian_.block<2, 2>(at, at) += inverse_mass * (Matrix2d::Identity() - turn) + creep * turn;
  jacobian_.block<2, 1>(at, at - 1) -= inverse_mass * block.friction * along;
  const Vector2d beyond = impulse - limit * along;
  residual_.segment<2>(at) = inverse_mass * beyond;
  return beyond.cwiseAbs().maxCoeff();
}

/// residual_ = jacobian_^-1 residual_ by elimination with row pivots; false if singular.
bool ContactSolver::solveLinear() noexcept
{
  for (int k = 0; k < size_; ++k)
  {
    int pivot = k;
    for (int i = k + 1; i < size_; ++i)
    {
      if (std::abs(jacobian_(i, k)) > std::abs(jacobian_(pivot, k)))
        pivot = i;
    }
    if (!(std::abs(jacobian_(pivot, k)) > 0.0))
      return false;
    const int right = size_ - k - 1;
    if (pivot != k)
    {
      jacobian_.row(pivot).segment(k, right + 1).swap(jacobian_.row(k).segment(k, right + 1));
      std::swap(residual_(pivot), residual_(k));
    }
    const double inverse = 1.0 / jacobian_(k, k);
    for (int i = k + 1; i < size_; ++i)
    {
      const double factor = jacobian_(i, k) * inverse;
      if (factor == 0.0)
        continue;
      jacobian_.row(i).segment(k + 1, right) -= factor * jacobian_.row(k).segment(k + 1, right);
      residual_(i) -= factor * residual_(k);
    }
  }
  for (int k = size_ - 1; k >= 0; --k)
  {
    for (int j = k + 1; j < size_; ++j)
      residual_(k) -= jacobian_(k, j) * residual_(j);
    residual_(k) /= jacobian_(k, k);
  }
  return residual_.head(size_).allFinite();
}

/// Newton's solution is outside by roundings.
void ContactSolver::enterCone() noexcept
{
  for (std::size_t i = 0; i < used_; ++i)
  {
    const Block& block = blocks_[i];
    trial_(block.row) = std::max(trial_(block.row), 0.0);
    if (block.friction <= 0.0)
      continue;
    auto tangent = trial_.segment<2>(block.row + 1);
    const double length = tangent.norm(), limit = block.friction * trial_(block.row);
    if (length > limit)
      tangent *= limit / length;
  }
}
}  // namespace phri_sim
