#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "phri_sim/scene.hpp"

namespace phri_sim
{
/// What a hand sees and feels of the handle at the start of a tick, in the control frame.
struct HandleState
{
  double t = 0.0;                                          ///< [s] since the start of the trial
  Eigen::Vector2d position{ 0, 0 };                        ///< [m]
  Eigen::Vector2d velocity{ 0, 0 };                        ///< [m/s]
  Eigen::Vector2d robot_force{ 0, 0 };                     ///< [N] assistance, BY the robot ON the object, last tick
  const std::vector<MovingObstacle>* obstacles = nullptr;  ///< of the trial
};

/// What a hand does to the handle during a tick.
struct HandForce
{
  Eigen::Vector2d force{ 0, 0 };  ///< [N] exerted BY the hand ON the handle
  /// The force is a reading of a force/torque sensor (a real one, or a recorded one) and reaches the loop as it is; the
  /// rest describes that reading. Otherwise the simulated sensor reads the force.
  bool sensed = false;
  std::int64_t age_ns = 0;        ///< since the reading arrived
  std::int64_t stamp_age_ns = 0;  ///< since its source stamped it
  std::uint64_t sequence = 0;     ///< counts the readings; as before: nothing new arrived
  std::uint32_t frame = 0;        ///< 0: the control frame; else another one, which the input guard refuses
};

/// Whose force moves the handle. `act` is called once per tick of 1 ms: it must not allocate, lock, throw or call ROS.
class Hand
{
public:
  virtual ~Hand() = default;
  virtual HandForce act(const HandleState& handle) noexcept = 0;
};
}  // namespace phri_sim
