#pragma once
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>

#include <deque>
#include <optional>

#include "phri_sim/route.hpp"
#include "stage_view.hpp"

namespace phri_sim
{
/// The planar device from above: the scene as `map` (latched), transforms world -> maze (static) and maze -> object.
class PlanarView : public StageView
{
public:
  PlanarView(ros::NodeHandle& node, std::shared_ptr<const Experiment> experiment, const ros::Time& now);

  void begin(const TrialSpec& spec, const Stage* stage) override;
  void follow(const Moment& moment) override;
  void publish(const Moment& moment) override;
  visualization_msgs::MarkerArray markers(const Moment& moment, const phri_core::Prediction* prediction,
                                          const std::string& controller) const override;
  nav_msgs::Path predictedPath(const phri_core::Prediction& prediction, const ros::Time& stamp) const override;
  /// The picture of the scene, too: a report drawn elsewhere needs no file of this machine.
  void recordFirst(Recorder& recorder, const ros::Time& start) const override;
  void record(Recorder& recorder, const Moment& moment) override;

private:
  std::shared_ptr<const Experiment> experiment_;
  ros::Publisher map_;
  tf2_ros::TransformBroadcaster transforms_;
  tf2_ros::StaticTransformBroadcaster static_transforms_;
  std::optional<Route> route_;  // with a pace
  std::optional<Pace> pace_;
  std::vector<MovingObstacle> obstacles_;
  std::deque<Eigen::Vector2d> trail_;
  std::string participant_, trial_;  // in words
  ros::Time last_transform_;
};
}  // namespace phri_sim
