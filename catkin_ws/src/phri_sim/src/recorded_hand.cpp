#include "phri_sim/recorded_hand.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace phri_sim
{
void check(const Recording& recording)
{
  if (recording.positions.empty())
    throw std::invalid_argument("the recording is empty; expected one position and one force per tick");
  if (recording.positions.size() != recording.forces.size())
    throw std::invalid_argument("the recording has " + std::to_string(recording.positions.size()) + " positions and " +
                                std::to_string(recording.forces.size()) + " forces; expected as many of each");
  for (std::size_t k = 0; k < recording.positions.size(); ++k)
    if (!recording.positions[k].allFinite() || !recording.forces[k].allFinite())
      throw std::invalid_argument("tick " + std::to_string(k) + " of the recording is not finite");
}

RecordedHand::RecordedHand(std::shared_ptr<const Recording> recording, Mode mode, const SpringSettings& spring,
                           double dt)
  : recording_(std::move(recording)),
    mode_(mode),
    spring_(spring, dt),
    linger_ticks_(static_cast<std::size_t>(std::llround(kLinger / dt)))
{
  check(*recording_);
}

HandForce RecordedHand::act(const HandleState& handle) noexcept
{
  const std::size_t tick = tick_++, size = recording_->positions.size();
  HandForce out;
  if (mode_ == Mode::kForce)
  {
    out.sensed = true;
    out.sequence = tick + 1;
    if (tick < size)
      out.force = recording_->forces[tick];
    return out;
  }
  const bool holding = tick < size + linger_ticks_;
  out.force = spring_.step(handle, holding ? &recording_->positions[std::min(tick, size - 1)] : nullptr);
  return out;
}
}  // namespace phri_sim
