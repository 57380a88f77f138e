#pragma once
#include <sensor_msgs/Joy.h>

#include "joy_mapping.hpp"
#include "spring_source.hpp"

namespace phri_sim
{
/// A person with a stick: `joy` (sensor_msgs/Joy) moves the spring's target at up to `hand/joy_speed`, signs as in
/// joy_mapping.hpp; button 0 starts, button 1 stops. In the middle the hand holds still; when messages stop (the
/// device's node repeats them only while the stick is out of the middle) it lets go after the timeout.
class JoyHand : public SpringSource
{
public:
  JoyHand(const HandSettings& settings, double dt, ros::NodeHandle& node, const OperatorActions& actions);
  ~JoyHand() override;
  std::string waitingFor() override;
  void show(const Eigen::Vector2d& /*position*/, const ros::Time& /*stamp*/, const std::string& /*state*/) override {}

private:
  void receive(const sensor_msgs::Joy& message);

  const OperatorActions actions_;
  std::mutex mutex_;  // guards what follows
  std::vector<int> buttons_;
  std::int64_t asked_since_ns_, received_ns_ = 0;
  bool deflected_ = false;

  CallbackThread thread_;
  ros::Subscriber subscriber_;
};
}  // namespace phri_sim
