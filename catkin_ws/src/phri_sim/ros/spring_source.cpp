#include "spring_source.hpp"

namespace phri_sim
{
using Wish = SpringTarget::Wish;

SpringSource::SpringSource(const HandSettings& settings, double dt) : settings_(settings), dt_(dt)
{
  Spring(settings.spring, dt);  // throws what `hand` would throw only when the first trial starts
}

std::unique_ptr<Hand> SpringSource::hand(const TrialSpec& /*spec*/)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  target_ = std::make_shared<SpringTarget>();  // one reader per mailbox: the last trial's hand keeps the old one
  used_ = fresh();
  if (used_)
    pass();
  return std::make_unique<SpringHand>(settings_.spring, dt_, target_);
}

void SpringSource::setTarget(const Eigen::Vector2d& position)
{
  give(Wish::kPosition, position);
}

void SpringSource::moveTarget(const Eigen::Vector2d& velocity)
{
  give(Wish::kVelocity, velocity);
}

void SpringSource::releaseTarget()
{
  give(Wish::kNothing, Eigen::Vector2d::Zero());
}

bool SpringSource::held() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return fresh();
}

bool SpringSource::heldSinceLastTrial() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return fresh() && used_;
}

bool SpringSource::fresh() const
{
  return wish_.kind != Wish::kNothing && (monotonicNs() - wish_.set_ns) * 1e-9 <= settings_.spring.timeout;
}

void SpringSource::give(Wish::Kind kind, const Eigen::Vector2d& value)
{
  if (!value.allFinite())
    return;
  const std::lock_guard<std::mutex> lock(mutex_);
  if (kind == Wish::kNothing || !fresh())
    used_ = false;
  wish_ = { kind, value, monotonicNs() };
  if (target_)
    pass();
}

void SpringSource::pass()
{
  switch (wish_.kind)
  {
    case Wish::kPosition:
      target_->set(wish_.value);
      return;
    case Wish::kVelocity:
      target_->move(wish_.value);
      return;
    case Wish::kNothing:
      target_->release();
  }
}
}  // namespace phri_sim
