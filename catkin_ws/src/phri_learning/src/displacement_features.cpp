// What the displacement regression looks at: lags of the position, companions, and the state of the movement.
#include <algorithm>
#include <cmath>

#include "phri_learning/displacement_regression.hpp"

namespace phri_learning
{
SampleHistory::SampleHistory(int axes, int dimension, double dt, const std::array<int, 3>& lags)
  : axes_(axes), size_(lags[2] + 1), dt_(dt), lags_(lags), ring_(Eigen::MatrixXd::Zero(dimension, lags[2] + 1))
{
}

void SampleHistory::start(const Eigen::Ref<const Eigen::VectorXd>& y)
{
  ring_.colwise() = y;
  head_ = 0;
  unknown_ = true;
}

void SampleHistory::start(const Eigen::Ref<const Eigen::VectorXd>& y, const Eigen::Ref<const Eigen::VectorXd>& v)
{
  head_ = 0;
  unknown_ = false;
  for (int l = 0; l < size_; ++l)
  {
    auto column = ring_.col((size_ - l) % size_);
    column = y;
    column.head(axes_) -= (l * dt_) * v;
  }
}

void SampleHistory::push(const Eigen::Ref<const Eigen::VectorXd>& y)
{
  head_ = (head_ + 1) % size_;
  ring_.col(head_) = y;
  if (!unknown_)
    return;
  unknown_ = false;
  for (int l = 1; l < size_ - 1; ++l)  // column 0 holds the first sample, the column l before it is size - l
    ring_.col(size_ - l).head(axes_) -= l * (y.head(axes_) - ring_.col(0).head(axes_));
}

Eigen::MatrixXd::ConstColXpr SampleHistory::before(int samples) const
{
  return ring_.col((head_ - samples + size_) % size_);
}

void SampleHistory::features(Eigen::Ref<Eigen::VectorXd> phi) const
{
  phi.head(axes_) = now().head(axes_);
  for (int l = 0; l < 3; ++l)
    phi.segment((1 + l) * axes_, axes_) = now().head(axes_) - before(lags_[static_cast<std::size_t>(l)]).head(axes_);
  phi.tail(ring_.rows() - axes_) = now().tail(ring_.rows() - axes_);
}

double SampleHistory::basis(int block, int axis, int column) const
{
  if (column < 3)
    return now()(axis) - before(lags_[static_cast<std::size_t>(column)])(axis);
  const int row = block * axes_ + axis;
  return column == 3 ? now()(row) : now()(row) - before(lags_[1])(row);
}

void SampleHistory::motion(Eigen::Ref<Eigen::VectorXd> out) const
{
  out.head(axes_) = now().head(axes_);
  out.tail(axes_) = (now().head(axes_) - before(lags_[1]).head(axes_)) / (lags_[1] * dt_);
}

StateFilter::StateFilter(std::shared_ptr<const TimeHmm> model)
  : model_(std::move(model)), scratch_(model_->scratch()), probability_(model_->states()), log_(model_->states())
{
}

void StateFilter::observe(const Eigen::Ref<const Eigen::VectorXd>& motion)
{
  constexpr double kLost = 0.01;      // probability per sample that the partner is somewhere else altogether
  constexpr double kLowest = -500.0;  // log of the smallest likelihood ratio, still a normal double
  const Eigen::Index states = probability_.size();
  model_->logEmission(motion, &scratch_, log_);
  if (!started_)
    probability_.setConstant(1.0 / static_cast<double>(states));
  else
  {
    const auto& transition = model_->parameters().transition;
    for (Eigen::Index i = states - 1; i >= 0; --i)
    {
      const double entered = i > 0 ? probability_(i - 1) * transition(i - 1, i) : 0.0;
      probability_(i) =
          (1.0 - kLost) * (probability_(i) * transition(i, i) + entered) + kLost / static_cast<double>(states);
    }
  }
  const double top = log_.maxCoeff();
  for (Eigen::Index i = 0; i < states; ++i)
    probability_(i) *= std::exp(std::max(log_(i) - top, kLowest));
  probability_ /= probability_.sum();
  started_ = true;
}
}  // namespace phri_learning
