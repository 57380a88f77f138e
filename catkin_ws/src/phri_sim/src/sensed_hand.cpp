#include "phri_sim/sensed_hand.hpp"

#include <limits>

namespace phri_sim
{
SensedHand::SensedHand(std::shared_ptr<Readings> readings, MonotonicClock clock)
  : readings_(std::move(readings)), clock_(clock)
{
  newest_.force.setConstant(std::numeric_limits<double>::quiet_NaN());
  newest_.received_ns = clock_();
  newest_.sequence = 0;
}

HandForce SensedHand::act(const HandleState& /*handle*/) noexcept
{
  if (const SensedForce* newer = readings_->take())
    newest_ = *newer;
  HandForce out;
  out.force = newest_.force;
  out.sensed = true;
  out.age_ns = clock_() - newest_.received_ns;
  out.stamp_age_ns = newest_.stamp_age_ns + out.age_ns;
  out.sequence = newest_.sequence;
  out.frame = newest_.frame;
  return out;
}
}  // namespace phri_sim
