#include "joy_hand.hpp"

#include <cstdio>

namespace phri_sim
{
namespace
{
constexpr double kSilence = 5.0;  // [s] after which the operator is told that nothing comes
}  // namespace

JoyHand::JoyHand(const HandSettings& settings, double dt, ros::NodeHandle& node, const OperatorActions& actions)
  : SpringSource(settings, dt), actions_(actions), asked_since_ns_(monotonicNs())
{
  const boost::function<void(const sensor_msgs::Joy::ConstPtr&)> receive = [this](const sensor_msgs::Joy::ConstPtr& m) {
    this->receive(*m);
  };
  subscriber_ =
      thread_.handle(node).subscribe("joy", 10, receive, ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  thread_.start();
}

JoyHand::~JoyHand()
{
  thread_.stop();
}

void JoyHand::receive(const sensor_msgs::Joy& message)
{
  const Eigen::Vector2d velocity = stickVelocity(message.axes, settings_.joy_speed);
  bool start, stop;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    received_ns_ = monotonicNs();
    deflected_ = velocity.norm() > 0.0;
    start = pressed(buttons_, message.buttons, kStartButton);
    stop = pressed(buttons_, message.buttons, kStopButton);
    buttons_.assign(message.buttons.begin(), message.buttons.end());
  }
  moveTarget(velocity);
  // stop wins over start
  if (stop && actions_.stop)
    ROS_INFO("stop button: %s", actions_.stop().c_str());
  else if (start && actions_.start)
    ROS_INFO("start button: %s", actions_.start().c_str());
}

std::string JoyHand::waitingFor()
{
  const bool fresh = held();
  const std::lock_guard<std::mutex> lock(mutex_);
  if (fresh && deflected_)
    return "";
  const double silent = 1e-9 * (monotonicNs() - std::max(received_ns_, asked_since_ns_));
  if (silent < kSilence || subscriber_.getNumPublishers() > 0)
    return "move the stick to start";
  char text[160];
  std::snprintf(text, sizeof(text), "no message on %s for %.0f s: is joy_node.py running?",
                subscriber_.getTopic().c_str(), silent);
  return text;
}
}  // namespace phri_sim
