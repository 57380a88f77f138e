#pragma once
#include <phri_msgs/Prediction.h>
#include <ros/ros.h>

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "interaction_text.hpp"
#include "phri_control/assistance_planner.hpp"
#include "robot_outputs.hpp"
#include "tick_thread.hpp"

namespace phri_control
{
struct Reply
{
  bool success = false;
  std::string text;
};

/// A robot's topics, the tick, what is published, the planner, and what an operator may ask for. Threads: the tick
/// (real-time, no ROS), one for readings, one for what is published, one for predictions and plans, the caller's.
class InteractionHost
{
public:
  InteractionHost(const ros::NodeHandle& node, const ros::NodeHandle& private_node, const InteractionSetup& setup);
  /// Stops the robot by its ramp, then ends with zero velocities on the wire.
  ~InteractionHost();

  /// Each waits until it has happened and says why it has not. From any thread.
  Reply start();
  Reply stop();
  Reply clearFault();
  /// In IDLE only.
  Reply tare();

  struct Status
  {
    RobotOutput output;
    TopicHealth health;
    std::string message, refused;
    double worst_lateness = 0.0;
    std::uint64_t late_cycles = 0, cycles = 0;
  };
  Status status() const;

private:
  void publish();
  void plan(const phri_msgs::PredictionConstPtr& message);
  RobotOutput newest() const;
  bool until(double timeout, const std::function<bool(const RobotOutput&)>& reached) const;
  InteractionMonitor monitor() const;

  const InteractionSetup setup_;
  const std::int64_t start_ns_ = monotonicNs();
  RobotTick tick_;
  RobotOutputs outputs_;
  RobotTopics topics_;
  std::unique_ptr<AssistancePlanner> planner_;  // null: no model
  ros::CallbackQueue prediction_queue_;
  ros::Subscriber predictions_;

  mutable std::mutex mutex_;  // guards the next three
  RobotOutput newest_;
  std::uint64_t cycles_ = 0;
  double prediction_t0_ = -1.0;

  std::atomic<bool> done_{ false };
  TickThread thread_;
  std::thread publisher_;
  ros::AsyncSpinner prediction_spinner_;
};
}  // namespace phri_control
