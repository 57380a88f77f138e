#include "replay_hand.hpp"

#include <geometry_msgs/WrenchStamped.h>
#include <phri_msgs/Tick.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/JointState.h>

#include <cmath>
#include <filesystem>

#include "trial_messages.hpp"

namespace phri_sim
{
namespace
{
constexpr double kTimeError = 1e-6;  // [s] rounding of a tick's time in the bag, by far smaller than a tick
constexpr const char* kExpected = "; expected a complete bag of one trial, as the experiment node records it";

[[noreturn]] void refuse(const std::string& path, const std::string& cause)
{
  throw std::invalid_argument("hand/bag = \"" + path + "\": " + cause + kExpected);
}

/// The one topic in the bag that ends in `/name` and has this type.
std::string topicNamed(const rosbag::View& all, const std::string& name, const std::string& type)
{
  std::vector<std::string> found;
  for (const rosbag::ConnectionInfo* connection : const_cast<rosbag::View&>(all).getConnections())
  {
    const std::string& topic = connection->topic;
    const bool fits =
        topic.size() > name.size() && topic.compare(topic.size() - name.size() - 1, name.size() + 1, "/" + name) == 0;
    if (fits && connection->datatype == type && std::find(found.begin(), found.end(), topic) == found.end())
      found.push_back(topic);
  }
  if (found.empty())
    throw std::runtime_error("no topic .../" + name + " (" + type + ")");
  if (found.size() > 1)
    throw std::runtime_error("topics " + found[0] + " and " + found[1] + ", one was expected");
  return found.front();
}

/// The messages of one topic in the order in which they were written.
template <typename Message, typename Take>
void each(const rosbag::Bag& bag, const std::string& topic, Take take)
{
  rosbag::View view(bag, rosbag::TopicQuery(topic));
  for (const rosbag::MessageInstance& instance : view)
    if (const boost::shared_ptr<Message> message = instance.instantiate<Message>())
      take(*message);
    else
      throw std::runtime_error("a message of " + topic + " cannot be read");
}

Recording read(const std::string& path, double dt)
{
  const rosbag::Bag bag(path, rosbag::bagmode::Read);
  const rosbag::View all(bag);
  const std::string tick_topic = topicNamed(all, "tick", "phri_msgs/Tick");
  const std::string joint_topic = topicNamed(all, "joint_states", "sensor_msgs/JointState");
  const std::string wrench_topic = topicNamed(all, "human_wrench", "geometry_msgs/WrenchStamped");

  Recording recording;
  std::size_t ticks = 0;
  each<phri_msgs::Tick>(bag, tick_topic, [&](const phri_msgs::Tick& tick) {
    const double expected = ticks++ * dt;
    if (!(std::abs(tick.t - expected) < kTimeError))
      throw std::runtime_error("tick " + std::to_string(ticks - 1) + " is of t = " + std::to_string(tick.t) +
                               " s and not of " + std::to_string(expected) + " s: ticks are missing");
  });
  each<sensor_msgs::JointState>(bag, joint_topic, [&](const sensor_msgs::JointState& joints) {
    if (joints.name != TickMessages().joints.name || joints.position.size() != 2)
      throw std::runtime_error(joint_topic + " has other joints than handle_x, handle_y");
    recording.positions.emplace_back(joints.position[0], joints.position[1]);
  });
  each<geometry_msgs::WrenchStamped>(bag, wrench_topic, [&](const geometry_msgs::WrenchStamped& wrench) {
    if (wrench.header.frame_id != kFrame)
      throw std::runtime_error(wrench_topic + " is in frame " + wrench.header.frame_id + " and not in " + kFrame);
    recording.forces.emplace_back(wrench.wrench.force.x, wrench.wrench.force.y);
  });
  if (recording.positions.size() != ticks || recording.forces.size() != ticks)
    throw std::runtime_error(std::to_string(ticks) + " ticks, but " + std::to_string(recording.positions.size()) +
                             " joint states and " + std::to_string(recording.forces.size()) + " human wrenches");
  check(recording);
  return recording;
}
}  // namespace

Recording readRecording(const std::string& path, double dt)
{
  if (path.empty())
    refuse(path, "no file is named");
  if (!std::filesystem::is_regular_file(path))
    refuse(path, "no such file");
  try
  {
    return read(path, dt);
  }
  catch (const std::exception& error)  // rosbag throws types of four families
  {
    refuse(path, error.what());
  }
}

ReplayHand::ReplayHand(const HandSettings& settings, double dt)
  : settings_(settings), dt_(dt), recording_(std::make_shared<const Recording>(readRecording(settings.bag, dt)))
{
  hand(TrialSpec());  // throws what would else be thrown only when the first trial starts
}

std::unique_ptr<Hand> ReplayHand::hand(const TrialSpec& /*spec*/)
{
  const auto mode = settings_.replay == "motion" ? RecordedHand::Mode::kMotion : RecordedHand::Mode::kForce;
  return std::make_unique<RecordedHand>(recording_, mode, settings_.spring, dt_);
}
}  // namespace phri_sim
