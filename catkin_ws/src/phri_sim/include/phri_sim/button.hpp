#pragma once
#include <string>

#include "phri_sim/world.hpp"

namespace phri_sim
{
struct ButtonParameters
{
  double stiffness = 300.0;  ///< of the spring [N/m]
  double damping = 0.5;      ///< [Ns/m]
  double click = 2.5e-3;     ///< travel at which it clicks [m]: 0.75 N
  double release = 2.0e-3;   ///< travel below which it can click again [m]
};

/// A push button: prismatic joint of a World whose child link is the cap; position 0 is out, positive is pressed, the
/// joint's upper limit is the end stop. Success is what the physics says: it clicks where the cap has travelled far
/// enough, whoever pushed it. The spring is set as the joint's drive, with a preload that carries the cap's own weight
/// in the pose in which the world is when the button is made: a cap at rest is out.
class Button
{
public:
  /// Throws std::invalid_argument if the joint is not prismatic, its limits are not 0 and some travel above `click`, or
  /// a parameter is out of range; std::out_of_range for an unknown joint.
  Button(World& world, const std::string& joint, const ButtonParameters& parameters = {});

  /// After each step of the world.
  void update() noexcept;

  double travel() const noexcept;              ///< now [m]
  double force() const { return force_; }      ///< that presses on the cap, along the joint's axis, last step [N]
  bool touching() const { return touching_; }  ///< something presses on the cap
  bool pressed() const { return pressed_; }    ///< beyond `click`, until below `release`
  int touches() const { return touches_; }     ///< times that touching() became true
  int clicks() const { return clicks_; }       ///< times that pressed() became true
  double deepest() const { return deepest_; }  ///< largest travel so far [m]
  void reset() noexcept;                       ///< counts and events, not the world

private:
  World* world_;
  ButtonParameters parameters_;
  int joint_, cap_;
  double force_ = 0.0, deepest_ = 0.0;
  bool touching_ = false, pressed_ = false;
  int touches_ = 0, clicks_ = 0;
};
}  // namespace phri_sim
