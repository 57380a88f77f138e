#include "prediction_inbox.hpp"

#include <chrono>

namespace phri_sim
{
namespace
{
constexpr auto kLook = std::chrono::milliseconds(50);  // between looks at `give_up`
constexpr int kQueue = 100;
}  // namespace

PredictionInbox::PredictionInbox(const ros::NodeHandle& node, const std::string& topic)
  : topic_(topic), spinner_(1, &queue_)
{
  ros::NodeHandle own(node);
  own.setCallbackQueue(&queue_);
  subscriber_ = own.subscribe(topic, kQueue, &PredictionInbox::receive, this, ros::TransportHints().tcpNoDelay());
  spinner_.start();
}

void PredictionInbox::receive(const phri_msgs::PredictionConstPtr& message)
{
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    newest_ = message;
  }
  arrived_.notify_all();
}

phri_msgs::PredictionConstPtr PredictionInbox::wait(const ros::Time& stamp, double timeout,
                                                    const std::function<bool()>& give_up)
{
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout);
  std::unique_lock<std::mutex> lock(mutex_);
  while (!newest_ || newest_->header.stamp != stamp)
  {
    if (give_up() || std::chrono::steady_clock::now() > deadline)
      return nullptr;
    arrived_.wait_for(lock, kLook);
  }
  return newest_;
}

phri_msgs::PredictionConstPtr PredictionInbox::newest() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return newest_;
}
}  // namespace phri_sim
