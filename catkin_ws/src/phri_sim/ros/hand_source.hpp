#pragma once
#include <ros/ros.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "phri_sim/spring_hand.hpp"
#include "phri_sim/trial.hpp"

namespace phri_sim
{
/// Private parameters `hand/...` of the node that hosts trials.
struct HandSettings
{
  SpringSettings spring;         ///< marker, joy, and replay of motions
  double joy_speed = 0.2;        ///< [m/s] of the target with the stick at its end
  std::string bag;               ///< replay: the recording
  std::string replay = "force";  ///< replay: "force" (as measured) or "motion" (a spring towards where it was)
  std::string stamps = "wall";   ///< topic: clock of the sensor's stamps, "wall" or "ros" (the session's)
};
void addParameters(phri_core::ParameterTable& table, HandSettings& settings);

/// The kinds of hands: simulated, marker, joy, replay, topic.
const std::vector<std::string>& handKinds();

/// What an operator can do from a marker's menu or a joystick's buttons. The calls come from a thread of the hand, so
/// they must return soon (no running of whole trials in them); what they return is a short text for the operator.
struct OperatorActions
{
  std::function<std::string()> start, stop, clear_fault, reset;
  std::function<std::string(const std::string&)> controller;  ///< switches to the controller of this name
  std::vector<std::string> controllers;                       ///< that can be chosen; the first is checked at first
};

/// Where the hand of a real person (or a recording of one) comes from. Lives as long as the experiment node, makes one
/// Hand per trial. All members may be called from different threads, none of them from the tick.
class HandSource
{
public:
  virtual ~HandSource() = default;

  /// The hand of the next trial; the one before is then cut off. Throws std::invalid_argument.
  virtual std::unique_ptr<Hand> hand(const TrialSpec& spec) = 0;
  /// Empty when the hand is there and a trial may start; else a short sentence that tells the operator what is missing.
  virtual std::string waitingFor() = 0;
  /// A trial starts by itself as soon as nothing is waited for; else the operator starts it.
  virtual bool autostart() const = 0;
  /// At about 30 Hz, during trials and between them: where the handle is [m], the session's time, and a short text on
  /// the state ("PASSIVE", "FAULT E_WRENCH_STALE", "drag the handle to start"; may be empty).
  virtual void show(const Eigen::Vector2d& position, const ros::Time& stamp, const std::string& state) = 0;
  /// Tells that the controller was switched elsewhere, so that menus show it.
  virtual void controllerIs(const std::string& /*name*/) {}
};

/// The source of hands of this kind for a loop of these settings; null for "simulated". Throws std::invalid_argument
/// for an unknown kind, and for a recording that is missing or not one of ours (naming file, cause and what was
/// expected).
///
/// Names: marker: interactive marker server `hand` (topics `hand/update`, `hand/feedback`), its spring on `~markers`;
/// joy: subscribes `joy`; topic: subscribes `ft_sensor/wrench`. All in the namespace of `node`.
std::unique_ptr<HandSource> makeHandSource(const std::string& kind, const HandSettings& settings,
                                           const phri_control::LoopSettings& loop, ros::NodeHandle& node,
                                           ros::NodeHandle& private_node, const OperatorActions& actions);
}  // namespace phri_sim
