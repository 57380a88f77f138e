#pragma once
#include <phri_msgs/Prediction.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>

#include <condition_variable>
#include <functional>
#include <mutex>

namespace phri_sim
{
/// Receives the predictions of a model node in a thread of its own, so that a service that waits for one gets it.
class PredictionInbox
{
public:
  PredictionInbox(const ros::NodeHandle& node, const std::string& topic);

  /// Blocks until the prediction with this stamp is here; null after `timeout` [s] on the wall, or as soon as
  /// `give_up`.
  phri_msgs::PredictionConstPtr wait(const ros::Time& stamp, double timeout, const std::function<bool()>& give_up);
  /// The newest prediction; null before the first.
  phri_msgs::PredictionConstPtr newest() const;
  /// Nodes that publish predictions and are connected.
  unsigned publishers() const { return subscriber_.getNumPublishers(); }
  const std::string& topic() const { return topic_; }

private:
  void receive(const phri_msgs::PredictionConstPtr& message);

  std::string topic_;
  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  phri_msgs::PredictionConstPtr newest_;
  ros::CallbackQueue queue_;
  ros::Subscriber subscriber_;
  ros::AsyncSpinner spinner_;
};
}  // namespace phri_sim
