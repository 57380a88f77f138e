#include "planar_view.hpp"

#include "markers.hpp"
#include "recorder.hpp"

namespace phri_sim
{
namespace
{
constexpr double kTrailStep = 0.001;  // [m] between points of the trail
constexpr std::size_t kTrailPoints = 4000;
constexpr std::int64_t kTransformPeriod = 20000000;  // [ns] in a bag
}  // namespace

PlanarView::PlanarView(ros::NodeHandle& node, std::shared_ptr<const Experiment> experiment, const ros::Time& now)
  : experiment_(std::move(experiment)), map_(node.advertise<nav_msgs::OccupancyGrid>("map", 1, true))
{
  if (experiment_->pace > 0.0)
  {
    route_ = planRoute(*experiment_->scene, 0.0);
    pace_.emplace(*route_, experiment_->pace);
  }
  map_.publish(occupancyGrid(*experiment_->scene, now));
  static_transforms_.sendTransform(mazeTransform(now));
}

void PlanarView::begin(const TrialSpec& spec, const Stage* stage)
{
  obstacles_.clear();
  if (stage)
    obstacles_ = obstaclesOfTrial(*experiment_->scene, spec.seed);
  trail_.clear();
  participant_ = "participant " + std::to_string(spec.participant);
  trial_ = "trial " + std::to_string(spec.trial);
}

void PlanarView::follow(const Moment& moment)
{
  const Eigen::Vector2d x = moment.record.position;
  if (trail_.empty() || (x - trail_.back()).norm() > kTrailStep)
    trail_.push_back(x);
  if (trail_.size() > kTrailPoints)
    trail_.pop_front();
}

void PlanarView::publish(const Moment& moment)
{
  if (moment.stamp > last_transform_)  // time stands still while a hand is waited for, and tf wants each stamp once
    transforms_.sendTransform(objectTransform(moment.record, moment.stamp));
  last_transform_ = moment.stamp;
}

visualization_msgs::MarkerArray PlanarView::markers(const Moment& moment, const phri_core::Prediction* prediction,
                                                    const std::string& controller) const
{
  LivePicture picture;
  picture.record = &moment.record;
  picture.obstacles = &obstacles_;
  picture.prediction = prediction;
  picture.trail = &trail_;
  const double t = moment.record.time_ns * 1e-9;
  const Eigen::Vector2d dot = pace_ ? route_->position(pace_->at(t)) : Eigen::Vector2d(0, 0);
  picture.dot = pace_ ? &dot : nullptr;
  picture.title = participant_ + "     " + controller + "     " + trial_;
  return phri_sim::markers(*experiment_->scene, picture, moment.stamp);
}

nav_msgs::Path PlanarView::predictedPath(const phri_core::Prediction& prediction, const ros::Time& stamp) const
{
  return phri_sim::predictedPath(prediction, stamp);
}

void PlanarView::recordFirst(Recorder& recorder, const ros::Time& start) const
{
  recorder.writeLatched("/tf_static", start, transforms({ mazeTransform(start) }));
  recorder.writeLatched(map_.getTopic(), start, occupancyGrid(*experiment_->scene, start));
}

void PlanarView::record(Recorder& recorder, const Moment& moment)
{
  if (moment.record.time_ns % kTransformPeriod == 0)
    recorder.write("/tf", moment.stamp, transforms({ objectTransform(moment.record, moment.stamp) }));
}
}  // namespace phri_sim
