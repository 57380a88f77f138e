#pragma once
#include <ros/callback_queue.h>
#include <ros/spinner.h>

#include <mutex>

#include "hand_source.hpp"

namespace phri_sim
{
/// A thread for the callbacks of one hand, so that no service that takes its time delays them. Its owner declares it
/// before the subscribers that use it, starts it last in the constructor and stops it first in the destructor.
class CallbackThread
{
public:
  CallbackThread() : spinner_(1, &queue_) {}
  /// `node` with its callbacks in this thread.
  ros::NodeHandle handle(const ros::NodeHandle& node)
  {
    ros::NodeHandle own(node);
    own.setCallbackQueue(&queue_);
    return own;
  }
  void start() { spinner_.start(); }
  void stop() { spinner_.stop(); }

private:
  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_;
};

/// What a marker and a stick share: a target, and one spring per trial that is tied to it.
class SpringSource : public HandSource
{
public:
  std::unique_ptr<Hand> hand(const TrialSpec& spec) override;
  bool autostart() const override { return true; }

protected:
  SpringSource(const HandSettings& settings, double dt);

  void setTarget(const Eigen::Vector2d& position);
  void moveTarget(const Eigen::Vector2d& velocity);
  void releaseTarget();
  /// The hand holds the handle: it has wished something else than to let go within the timeout.
  bool held() const;
  /// The same hold has already been in a trial: who still drags the marker of the last goal must let go first, or the
  /// next trial would begin with a jerk towards it.
  bool heldSinceLastTrial() const;

  const HandSettings settings_;

private:
  void give(SpringTarget::Wish::Kind kind, const Eigen::Vector2d& value);
  void pass();
  bool fresh() const;

  const double dt_;
  mutable std::mutex mutex_;  // guards what follows; never taken in the tick
  std::shared_ptr<SpringTarget> target_;
  SpringTarget::Wish wish_;
  bool used_ = false;  // the present hold, in a trial
};
}  // namespace phri_sim
