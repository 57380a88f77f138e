#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "phri_control/kinematics.hpp"
#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using SingularBasis = Eigen::Matrix<double, Eigen::Dynamic, 6, 0, kMaxArmJoints, 6>;

constexpr double kNullFloor = 1e-3;      // of eps: singular values below it belong to the null space of the posture
constexpr double kNullShare = 1e-2;      // of a joint in the null space, below it the joint does not take part in it
constexpr double kNullRounding = 1e-9;   // smaller elements of a unit vector are rounding
constexpr int kSearchSteps = 200;        // per attempt of findPosture
constexpr double kSearchLinear = 0.1;    // [m] longest step of findPosture
constexpr double kSearchAngular = 0.3;   // [rad] likewise
constexpr double kSearchJoint = 0.5;     // [rad] likewise, per joint
constexpr double kSearchDamping = 1e-6;  // [m] least eps of findPosture
constexpr double kSearchPosture = 0.2;   // share of the way to the preferred posture in a step

/// The Jacobian seen through its singular values, rotations weighted.
struct Decomposition
{
  Matrix6 left;         // U
  Twist squares;        // sigma_i^2, increasing
  SingularBasis basis;  // (W J)' U: column i is sigma_i times the i-th direction in joint space
  double floor;         // squared singular value that separates the null space

  Decomposition(const ArmJacobian& jacobian, double length, double eps) : floor(std::pow(kNullFloor * eps, 2))
  {
    ArmJacobian weighted = jacobian;
    weighted.bottomRows<3>() *= length;
    const Matrix6 square = weighted.lazyProduct(weighted.transpose());
    const Eigen::SelfAdjointEigenSolver<Matrix6> solver(square);
    left = solver.eigenvectors();
    squares = solver.eigenvalues().cwiseMax(0.0);
    basis = weighted.transpose().lazyProduct(left);
  }

  /// Joint velocities for a weighted twist, damped below `eps`.
  VectorJoints solve(const Twist& weighted_twist, double eps) const
  {
    const Twist components = left.transpose().lazyProduct(weighted_twist);
    Twist scaled;
    for (int i = 0; i < 6; ++i)
    {
      const double ratio = squares(i) / (eps * eps);
      scaled(i) = components(i) / (squares(i) + (ratio < 1.0 ? 0.25 * eps * eps * (1.0 - ratio) : 0.0));
    }
    return basis.lazyProduct(scaled);
  }

  /// What of `rates` does not move the tip.
  VectorJoints project(const VectorJoints& rates) const
  {
    const Twist components = basis.transpose().lazyProduct(rates);
    const Twist scaled = components.cwiseQuotient((squares.array() + floor).matrix());
    return rates - basis.lazyProduct(scaled);
  }

  /// Unit vector (or 0 where there is none) of joint velocities that do not move the tip: the one that moves `joint`
  /// most, or, if it takes no part in them (an elbow between spherical joints), the joint that takes most.
  VectorJoints nullDirection(Eigen::Index joint) const
  {
    const Twist inverse = (squares.array() + floor).inverse();
    const VectorJoints share = (1.0 - basis.cwiseAbs2().lazyProduct(inverse).array()).matrix();
    Eigen::Index most = 0;
    share.maxCoeff(&most);
    VectorJoints direction = VectorJoints::Zero(basis.rows());
    if (!(share(most) > kNullShare))
      return direction;
    direction(share(joint) > kNullShare ? joint : most) = 1.0;
    direction = project(direction).normalized();
    direction = project(direction).normalized();  // once more: the floor's leak relative to a small projection
    return (direction.array().abs() < kNullRounding).select(0.0, direction);
  }
};

/// Largest s in [0, 1] for which some t brings s task + t null within the bounds, and the t nearest to `wanted`. With
/// a joint's share of the null direction it is an interval of t whose ends are linear in s; two joints' intervals meet
/// up to an s of their own. s = t = 0 is allowed by the bounds.
struct Share
{
  double task = 1.0, null = 0.0;
};
Share largestShare(const VectorJoints& task, const VectorJoints& null, const VelocityBounds& bounds, double wanted)
{
  const Eigen::Index n = task.size();
  VectorJoints low(n), high(n), slope(n);
  Share share;
  for (Eigen::Index i = 0; i < n; ++i)
  {
    if (null(i) == 0.0)
    {
      const double bound = task(i) > 0.0 ? bounds.upper(i) : bounds.lower(i);
      if (std::abs(task(i)) > std::abs(bound))
        share.task = std::min(share.task, bound / task(i));
      continue;
    }
    slope(i) = task(i) / null(i);
    low(i) = (null(i) > 0.0 ? bounds.lower(i) : bounds.upper(i)) / null(i);
    high(i) = (null(i) > 0.0 ? bounds.upper(i) : bounds.lower(i)) / null(i);
  }
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j)
      if (null(i) != 0.0 && null(j) != 0.0 && share.task * (slope(j) - slope(i)) > high(j) - low(i))
        share.task = (high(j) - low(i)) / (slope(j) - slope(i));
  share.task = std::max(share.task, 0.0);
  double from = -1e300, to = 1e300;
  for (Eigen::Index i = 0; i < n; ++i)
  {
    if (null(i) != 0.0)
    {
      from = std::max(from, low(i) - share.task * slope(i));
      to = std::min(to, high(i) - share.task * slope(i));
    }
  }
  share.null = from > 1e299 || from < -1e299 ? 0.0 : std::max(from, std::min(wanted, to));
  return share;
}

/// Task and projected null motion within the bounds; the share of the task goes to `scale`.
VectorJoints withinBounds(const VectorJoints& task, const VectorJoints& null, const Decomposition& jacobian,
                          const VelocityBounds& bounds, double& scale)
{
  const VectorJoints sum = task + null;
  Eigen::Index worst = 0;
  const double excess = (sum - bounds.upper).cwiseMax(bounds.lower - sum).maxCoeff(&worst);
  scale = 1.0;
  if (excess <= 0.0)
    return sum;
  const VectorJoints direction = jacobian.nullDirection(worst);
  const double square = direction.squaredNorm();
  const Share share = largestShare(task, direction, bounds, square > 0.0 ? null.dot(direction) / square : 0.0);
  scale = share.task;
  return (share.task * task + share.null * direction).cwiseMax(bounds.lower).cwiseMin(bounds.upper);
}

Twist weigh(const Twist& twist, double length)
{
  Twist weighted = twist;
  weighted.tail<3>() *= length;
  return weighted;
}

/// Shortened to the two lengths, each part's direction kept.
Twist shorten(const Twist& twist, double linear, double angular)
{
  Twist result = twist;
  const double speed = twist.head<3>().norm(), rate = twist.tail<3>().norm();
  if (speed > linear)
    result.head<3>() *= linear / speed;
  if (rate > angular)
    result.tail<3>() *= angular / rate;
  return result;
}
}  // namespace

DifferentialInverse::DifferentialInverse(const ArmKinematics& arm, const InverseSettings& settings)
  : arm_(arm), settings_(settings)
{
  phri_core::requireRange("dt", settings.dt, 1e-5, 0.1, "s");
  phri_core::requireRange("length", settings.length, 1e-3, 10.0, "m");
  phri_core::requireRange("singular_value", settings.singular_value, 1e-6, 1.0, "m");
  phri_core::requireRange("pose_gain", settings.pose_gain, 0.0, 0.5 / settings.dt, "1/s");
  phri_core::requireRange("feedback_linear", settings.feedback_linear, 0.0, 10.0, "m/s");
  phri_core::requireRange("feedback_angular", settings.feedback_angular, 0.0, 10.0, "rad/s");
  phri_core::requireRange("posture_gain", settings.posture_gain, 0.0, 0.5 / settings.dt, "1/s");
  phri_core::requireRange("posture_velocity", settings.posture_velocity, 0.0, 10.0, "rad/s");
  phri_core::requireRange("manipulability_gain", settings.manipulability_gain, 0.0, 1e3, "rad^2/(m^3 s)");
  phri_core::requireRange("joint_acceleration", settings.joint_acceleration, 1e-2, 1e4, "rad/s^2");
  phri_core::requireRange("limit_margin", settings.limit_margin, 0.0,
                          std::min(1.0, 0.5 * (arm.upper() - arm.lower()).minCoeff()), "rad");
  phri_core::requireRange("velocity_share", settings.velocity_share, 1e-3, 1.0, "");
  if (settings_.posture.size() == 0)
  {
    settings_.posture = 0.5 * (arm.lower() + arm.upper());
    settings_.posture = settings_.posture.array().isFinite().select(settings_.posture, 0.0);
  }
  phri_core::requireShape("posture", settings_.posture, arm.joints(), 1);
  phri_core::requireFinite("posture", settings_.posture);
}

ArmRates DifferentialInverse::solve(const VectorJoints& q, const Eigen::Isometry3d& pose, const Twist& twist,
                                    bool correct) const noexcept
{
  if (q.size() != arm_.joints() || !q.allFinite())
  {
    ArmRates rates;
    rates.velocity = VectorJoints::Zero(arm_.joints());
    return rates;
  }
  ArmJacobian jacobian;
  const Eigen::Isometry3d actual = arm_.forward(q, jacobian);
  return solve(q, actual, jacobian, pose, twist, correct);
}

ArmRates DifferentialInverse::solve(const VectorJoints& q, const Eigen::Isometry3d& actual, const ArmJacobian& jacobian,
                                    const Eigen::Isometry3d& pose, const Twist& twist, bool correct) const noexcept
{
  ArmRates rates;
  rates.velocity = VectorJoints::Zero(arm_.joints());
  const InverseSettings& s = settings_;
  const bool finite = q.size() == arm_.joints() && jacobian.cols() == arm_.joints() && q.allFinite() &&
                      jacobian.allFinite() && twist.allFinite() && actual.matrix().allFinite() &&
                      (!correct || pose.matrix().allFinite());
  if (!finite)
    return rates;
  Twist wanted = twist;
  if (correct)
    wanted += shorten(s.pose_gain * poseError(pose, actual), s.feedback_linear, s.feedback_angular);
  const Decomposition decomposition(jacobian, s.length, s.singular_value);
  const VectorJoints task = decomposition.solve(weigh(wanted, s.length), s.singular_value);
  VectorJoints posture = s.posture_gain * (s.posture - q);
  if (s.manipulability_gain > 0.0)
    posture += s.manipulability_gain * manipulabilityGradient(jacobian);
  const double fastest = posture.cwiseAbs().maxCoeff();
  if (fastest > s.posture_velocity)
    posture *= s.posture_velocity / fastest;
  VelocityBounds bounds = jointFunnel(arm_, q, s.joint_acceleration, s.limit_margin, s.dt);
  bounds.lower = bounds.lower.cwiseMax(-s.velocity_share * arm_.velocity());
  bounds.upper = bounds.upper.cwiseMin(s.velocity_share * arm_.velocity());
  rates.velocity = withinBounds(task, decomposition.project(posture), decomposition, bounds, rates.scale);
  rates.singular_value = std::sqrt(decomposition.squares(0));
  rates.manipulability = std::sqrt(decomposition.squares.prod()) / std::pow(s.length, 3);
  rates.valid = rates.velocity.allFinite();
  if (!rates.valid)
    rates.velocity.setZero();
  return rates;
}

PostureResult findPosture(const DifferentialInverse& inverse, const Eigen::Isometry3d& pose, const VectorJoints& start,
                          phri_core::Random& random, int attempts, double tolerance)
{
  const ArmKinematics& arm = inverse.arm();
  const InverseSettings& s = inverse.settings();
  phri_core::requireShape("start", start, arm.joints(), 1);
  phri_core::requireFinite("start", start);
  phri_core::requireFinite("pose", pose.matrix());
  const VectorJoints low = arm.lower().array() + s.limit_margin, high = arm.upper().array() - s.limit_margin;
  PostureResult result;
  result.posture = start.cwiseMax(low).cwiseMin(high);
  result.error = HUGE_VAL;
  VectorJoints q = result.posture;
  for (int attempt = 0; attempt <= attempts; ++attempt)
  {
    for (int i = 0; attempt > 0 && i < arm.joints(); ++i)
      q(i) = random.uniform(std::max(low(i), -M_PI), std::min(high(i), M_PI));
    for (int step = 0; step < kSearchSteps; ++step, ++result.iterations)
    {
      ArmJacobian jacobian;
      const Twist error = poseError(pose, arm.forward(q, jacobian));
      const double size = weigh(error, s.length).norm();
      if (size < result.error)
      {
        result.posture = q;
        result.error = size;
      }
      result.converged = size <= tolerance;
      if (result.converged)
        return result;
      // less damping as the error shrinks (Levenberg, Marquardt), or poses near a singularity would be reached slowly
      const double eps = std::min(s.singular_value, std::max(size, kSearchDamping));
      const Decomposition decomposition(jacobian, s.length, eps);
      const Twist twist = weigh(shorten(error, kSearchLinear, kSearchAngular), s.length);
      const VelocityBounds bounds{ (low - q).cwiseMax(-kSearchJoint).cwiseMin(0.0),
                                   (high - q).cwiseMin(kSearchJoint).cwiseMax(0.0) };
      // fades out: a motion of the null space bends the path of the tip and would keep the error from vanishing
      const double share = kSearchPosture * std::max(0.0, 1.0 - 2.0 * step / kSearchSteps);
      double scale;
      q += withinBounds(decomposition.solve(twist, eps), decomposition.project(share * (s.posture - q)), decomposition,
                        bounds, scale);
    }
  }
  return result;
}
}  // namespace phri_control
