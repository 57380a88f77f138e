#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <memory>

#include "phri_core/interaction.hpp"
#include "phri_sim/experiment.hpp"
#include "phri_sim/hand.hpp"

namespace phri_sim
{
/// What a trial is about: a device or robot with its sensors, its surroundings and the person at it, a millisecond at a
/// time. The interaction loop renders the object between `read` and `write`. Both are called in the tick: they do not
/// allocate, lock, throw or call ROS. Bit-identical for one experiment and TrialSpec.
class Stage
{
public:
  virtual ~Stage() = default;
  /// Where the object is at first, in the loop's coordinates [m, rad].
  virtual phri_core::VectorDof start() const = 0;
  /// The person acts, then the sensors are read. `assistance`: BY the robot ON the object in the last tick [N, Nm].
  virtual phri_core::Measurement read(std::int64_t now_ns, const phri_core::VectorDof& assistance) noexcept = 0;
  /// The robot follows the command for the rest of the millisecond.
  virtual void write(const phri_core::Command& command) noexcept = 0;
  /// The task is done: the object rests where it should be.
  virtual bool arrived() const noexcept = 0;
};

/// The stage that the experiment names. `hand`: whose force moves the object; without one, the simulated participant's.
std::unique_ptr<Stage> makeStage(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec,
                                 std::unique_ptr<Hand> hand);
}  // namespace phri_sim
