#pragma once
#include <geometry_msgs/WrenchStamped.h>
#include <ros/message_event.h>
#include <tf2_ros/transform_listener.h>

#include "phri_sim/sensed_hand.hpp"
#include "spring_source.hpp"

namespace phri_sim
{
/// A person at a real force/torque handle: `ft_sensor/wrench` (geometry_msgs/WrenchStamped), the wrench exerted BY the
/// person ON the handle, tared, at the rate of the tick or faster (20 ms of silence is a fault). Queue of 1: the newest
/// reading counts.
///
/// Frame: `maze`, or any that tf knows; its rotation to `maze` is looked up once, while waiting, and holds for the
/// trial. A force only rotates: where the sensor sits does not matter. Another frame during a trial is a fault. Stamps
/// are aged by the clock of `hand/stamps`. Two publishers: readings are dropped, which within 20 ms is a fault too.
///
/// Before a trial the sensor must have been still: more than `bias/force` within the last `bias/time` means that
/// somebody holds the handle, or that it wants taring.
class TopicHand : public HandSource
{
public:
  TopicHand(const HandSettings& settings, const phri_core::SafetySettings& safety, ros::NodeHandle& node);
  ~TopicHand() override;
  std::unique_ptr<Hand> hand(const TrialSpec& spec) override;
  std::string waitingFor() override;
  bool autostart() const override { return false; }
  void show(const Eigen::Vector2d& /*position*/, const ros::Time& /*stamp*/, const std::string& /*state*/) override {}

private:
  struct Frame
  {
    std::string id;  ///< empty: none yet
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  };
  void receive(const ros::MessageEvent<const geometry_msgs::WrenchStamped>& event);
  std::int64_t stampAge(const ros::Time& stamp) const;
  std::string lookUp(const std::string& frame);

  const bool wall_stamps_;
  const double rest_force_, rest_time_;  // [N], [s]
  tf2_ros::Buffer transforms_;
  tf2_ros::TransformListener listener_;

  std::mutex mutex_;                                // guards what follows; never taken in the tick
  std::shared_ptr<SensedHand::Readings> readings_;  // of the present trial
  Frame known_, trial_;                             // newest that waitingFor accepted; the trial's
  SensedForce newest_;
  std::string newest_frame_;
  double newest_force_ = 0.0;  // [N]
  std::uint32_t last_seq_ = 0;
  boost::shared_ptr<ros::M_string> connection_;
  std::int64_t calm_since_ns_ = 0;

  CallbackThread thread_;
  ros::Subscriber subscriber_;
};
}  // namespace phri_sim
