// Gaussian mixture regression of TimeHmm: (3.5)-(3.7) and the law of total variance around it.
#include <array>
#include <cmath>

#include "phri_core/check.hpp"
#include "phri_learning/time_hmm.hpp"

namespace phri_learning
{
namespace
{
constexpr double kNegligible = 1e-16;  // weight lost against 1 in double precision

// five-point Gauss-Hermite rule for the standard normal
constexpr std::array<double, 5> kNodes = { -2.8569700138728056, -1.3556261799742659, 0.0, 1.3556261799742659,
                                           2.8569700138728056 };
constexpr std::array<double, 5> kNodeWeights = { 0.011257411327720691, 0.22207592200561266, 0.53333333333333333,
                                                 0.22207592200561266, 0.011257411327720691 };
}  // namespace

void TimeHmm::timeWeights(double time, Scratch* scratch) const
{
  Eigen::VectorXd& h = scratch->weight;
  h = log_time_norm_.array() - 0.5 * (time - parameters_.mean_t.array()).square() / parameters_.tt.array();
  const double top = h.maxCoeff();
  double sum = 0.0;
  for (Eigen::Index c = 0; c < h.size(); ++c)
  {
    h(c) = h(c) - top < -36.0 ? 0.0 : std::exp(h(c) - top);
    sum += h(c);
  }
  h /= sum;
}

void TimeHmm::regressMean(double time, Scratch* scratch) const
{
  timeWeights(time, scratch);
  scratch->mean.setZero();
  for (Eigen::Index c = 0; c < scratch->weight.size(); ++c)
    if (scratch->weight(c) > kNegligible)
      scratch->mean += scratch->weight(c) * (mean_columns_.col(c) + slope_.col(c) * (time - parameters_.mean_t(c)));
}

void TimeHmm::regressUncertain(double time, double time_variance, Scratch* scratch) const
{
  regressMean(time, scratch);
  scratch->covariance.setZero();
  const double deviation = std::sqrt(time_variance);
  for (std::size_t node = 0; node < kNodes.size(); ++node)
  {
    if (deviation == 0.0 && kNodes[node] != 0.0)
      continue;
    const double node_time = time + deviation * kNodes[node];
    const double node_weight = deviation == 0.0 ? 1.0 : kNodeWeights[node];
    timeWeights(node_time, scratch);
    for (Eigen::Index c = 0; c < scratch->weight.size(); ++c)
    {
      const double h = node_weight * scratch->weight(c);
      if (!(h > kNegligible))
        continue;
      scratch->covariance.reshaped() += h * conditional_.col(c);
      scratch->other = mean_columns_.col(c) + slope_.col(c) * (node_time - parameters_.mean_t(c)) - scratch->mean;
      scratch->other *= std::sqrt(h);
      scratch->covariance.noalias() += scratch->other * scratch->other.transpose();
    }
  }
  scratch->covariance.diagonal().array() += parameters_.repeat_variance * parameters_.scale.array().square();
}

TimeHmm::Trajectory TimeHmm::regress(const Eigen::Ref<const Eigen::VectorXd>& times, bool full_covariance) const
{
  phri_core::requireFinite("times", times);
  Scratch work = scratch();
  Trajectory result{ Eigen::MatrixXd(times.size(), dimension_), {} };
  result.covariances.reserve(static_cast<std::size_t>(times.size()));
  for (Eigen::Index n = 0; n < times.size(); ++n)
  {
    regressMean(times(n), &work);
    if (full_covariance)
    {
      regressUncertain(times(n), work.weight.dot(parameters_.between_tt), &work);
      result.covariances.push_back(work.covariance);
    }
    else
    {
      result.covariances.emplace_back(dimension_, dimension_);
      result.covariances.back().reshaped() = conditional_ * work.weight;
    }
    result.means.row(n) = work.mean;
  }
  return result;
}

void TimeHmm::timeWithin(int state, const Eigen::Ref<const Eigen::VectorXd>& x, Scratch* scratch, double* mean,
                         double* variance) const
{
  const Eigen::Index first = static_cast<Eigen::Index>(state) * components_;
  Eigen::VectorXd& logs = scratch->component;
  double top = 0.0;
  if (components_ > 1)
  {
    logComponent(x, scratch);
    top = logs.segment(first, components_).maxCoeff();
  }
  double sum = 0.0, first_moment = 0.0, second_moment = 0.0;
  for (Eigen::Index c = first; c < first + components_; ++c)
  {
    const double r = components_ > 1 ? std::exp(logs(c) - top) : 1.0;
    const double time = parameters_.mean_t(c) - state_time_(state) + time_slope_.col(c).dot(x - mean_columns_.col(c));
    sum += r;
    first_moment += r * time;
    second_moment += r * (time_residual_(c) + time * time);
  }
  first_moment /= sum;
  *mean = state_time_(state) + first_moment;
  *variance = second_moment / sum - first_moment * first_moment;
}
}  // namespace phri_learning
