#include "hand_source.hpp"

#include "joy_hand.hpp"
#include "marker_hand.hpp"
#include "phri_core/check.hpp"
#include "replay_hand.hpp"
#include "topic_hand.hpp"

namespace phri_sim
{
void addParameters(phri_core::ParameterTable& table, HandSettings& s)
{
  addParameters(table, s.spring);
  table.number("hand/joy_speed", &s.joy_speed, "m/s", 0.01, 1.0, "of the target with the stick at its end (human: joy)")
      .text("hand/bag", &s.bag, {}, "the recording (human: replay)")
      .text("hand/replay", &s.replay, { "force", "motion" },
            "the measured force, or a spring towards where the hand was (human: replay)")
      .text("hand/stamps", &s.stamps, { "wall", "ros" },
            "clock of the sensor's stamps: of the machine, or the session's (human: topic)");
}

const std::vector<std::string>& handKinds()
{
  static const std::vector<std::string> kinds = { "simulated", "marker", "joy", "replay", "topic" };
  return kinds;
}

std::unique_ptr<HandSource> makeHandSource(const std::string& kind, const HandSettings& settings,
                                           const phri_control::LoopSettings& loop, ros::NodeHandle& node,
                                           ros::NodeHandle& private_node, const OperatorActions& actions)
{
  if (kind == "simulated")
    return nullptr;
  if (kind == "marker")
    return std::make_unique<MarkerHand>(settings, loop.dt, node, private_node, actions);
  if (kind == "joy")
    return std::make_unique<JoyHand>(settings, loop.dt, node, actions);
  if (kind == "replay")
    return std::make_unique<ReplayHand>(settings, loop.dt);
  if (kind == "topic")
    return std::make_unique<TopicHand>(settings, loop.safety, node);
  std::string known;
  for (const std::string& name : handKinds())
    known += (known.empty() ? "" : ", ") + name;
  const std::string meant = phri_core::closest(kind, handKinds());
  throw std::invalid_argument("human = \"" + kind + "\": expected one of " + known +
                              (meant.empty() ? "" : "; did you mean \"" + meant + "\"?"));
}
}  // namespace phri_sim
