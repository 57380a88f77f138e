#pragma once
#include <memory>

#include "phri_core/mailbox.hpp"
#include "phri_sim/hand.hpp"
#include "phri_sim/monotonic.hpp"

namespace phri_sim
{
/// One reading of a real force/torque handle, in the control frame unless `frame` says otherwise.
struct SensedForce
{
  Eigen::Vector2d force{ 0, 0 };  ///< [N] exerted BY the hand ON the handle
  std::int64_t received_ns = 0;   ///< by the monotonic clock
  std::int64_t stamp_age_ns = 0;  ///< of its stamp when it was received; negative: stamped in the future
  std::uint64_t sequence = 1;     ///< 1, 2, ... as its source counts
  std::uint32_t frame = 0;        ///< 0: the control frame; else another one
};

/// The hand of a real force/torque handle: passes the newest reading on, with its age. It judges nothing; stale, not
/// finite, out of range, out of order, in a wrong frame: that is the input guard's business, which therefore gets every
/// reading as it is. Before the first reading the force is NaN, which the guard refuses.
class SensedHand : public Hand
{
public:
  using Readings = phri_core::Mailbox<SensedForce>;
  explicit SensedHand(std::shared_ptr<Readings> readings, MonotonicClock clock = &monotonicNs);
  HandForce act(const HandleState& handle) noexcept override;

private:
  std::shared_ptr<Readings> readings_;
  MonotonicClock clock_;
  SensedForce newest_;
};
}  // namespace phri_sim
