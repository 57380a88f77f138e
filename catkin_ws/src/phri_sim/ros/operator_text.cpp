#include "operator_text.hpp"

namespace phri_sim
{
namespace
{
const char* causeOf(phri_core::FaultCode fault)
{
  switch (fault)
  {
    case phri_core::FaultCode::None:
      return "";
    case phri_core::FaultCode::WrenchStale:
      return "no good force sample for too long: check the force/torque sensor and its driver";
    case phri_core::FaultCode::WrenchFrame:
      return "the force came in another frame: check the driver's frame_id";
    case phri_core::FaultCode::PositionInvalid:
      return "the measured position is not a number: check the encoders";
    case phri_core::FaultCode::LateCycle:
      return "the loop came too late: the machine is too busy for 1 kHz";
    case phri_core::FaultCode::NotFinite:
      return "the command was not a number";
  }
  return "";
}
}  // namespace

std::string operatorText(const phri_control::TickRecord& record)
{
  using phri_core::LoopState;
  if (record.state == LoopState::Fault)
    return std::string(causeOf(record.fault)) + "; then let go for 1 s, clear the fault and start";
  if (record.state == LoopState::Idle)
    return record.limits & phri_core::kLimitBias
               ? "the sensor reads a force at rest: let go of the handle, or tare the sensor, then start"
               : "stopped: start to go on";
  return "";
}
}  // namespace phri_sim
