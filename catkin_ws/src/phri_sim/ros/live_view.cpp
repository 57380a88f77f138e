#include "live_view.hpp"

#include <geometry_msgs/WrenchStamped.h>
#include <rosgraph_msgs/Clock.h>

namespace phri_sim
{
namespace
{
constexpr double kTrailStep = 0.001;  // [m] between points of the trail
constexpr std::size_t kTrailPoints = 4000;
constexpr int kQueue = 10;
}  // namespace

TopicNames::TopicNames(const ros::NodeHandle& node, const ros::NodeHandle& private_node)
  : tick(private_node.resolveName("tick")),
    joints(node.resolveName("joint_states")),
    human(node.resolveName("human_wrench")),
    environment(node.resolveName("environment_wrench")),
    assistance(node.resolveName("assistance_wrench")),
    requested(node.resolveName("requested_wrench")),
    state(private_node.resolveName("state")),
    prediction(node.resolveName("prediction/time_hmm")),
    observation(node.resolveName("observation")),
    metadata(node.resolveName("metadata"))
{
}

bool LiveView::Throttle::due(WallClock::time_point now)
{
  if (now < next)
    return false;
  next = now + period;
  return true;
}

LiveView::LiveView(ros::NodeHandle& node, ros::NodeHandle& private_node, std::shared_ptr<const Experiment> experiment,
                   const ros::Time& now)
  : experiment_(std::move(experiment)),
    clock_(node.advertise<rosgraph_msgs::Clock>("/clock", kQueue)),
    tick_(private_node.advertise<phri_msgs::Tick>("tick", kQueue)),
    joints_(node.advertise<sensor_msgs::JointState>("joint_states", kQueue)),
    human_(node.advertise<geometry_msgs::WrenchStamped>("human_wrench", kQueue)),
    environment_(node.advertise<geometry_msgs::WrenchStamped>("environment_wrench", kQueue)),
    assistance_(node.advertise<geometry_msgs::WrenchStamped>("assistance_wrench", kQueue)),
    requested_(node.advertise<geometry_msgs::WrenchStamped>("requested_wrench", kQueue)),
    state_(private_node.advertise<phri_msgs::ControllerState>("state", kQueue)),
    path_(node.advertise<nav_msgs::Path>("predicted_path", kQueue)),
    markers_(private_node.advertise<visualization_msgs::MarkerArray>("markers", kQueue)),
    map_(node.advertise<nav_msgs::OccupancyGrid>("map", 1, true))
{
  if (experiment_->pace > 0.0)
  {
    route_ = planRoute(*experiment_->scene, 0.0);
    pace_.emplace(*route_, experiment_->pace);
  }
  map_.publish(occupancyGrid(*experiment_->scene, now));
  static_transforms_.sendTransform(mazeTransform(now));
}

void LiveView::begin(const TrialSpec& spec, const std::vector<MovingObstacle>& obstacles)
{
  obstacles_ = obstacles;
  prediction_.reset();
  trail_.clear();
  participant_ = "participant " + std::to_string(spec.participant);
  trial_ = "trial " + std::to_string(spec.trial);
  visualization_msgs::MarkerArray clear;
  clear.markers.resize(1);
  clear.markers[0].header.frame_id = kFrame;
  clear.markers[0].action = visualization_msgs::Marker::DELETEALL;
  markers_.publish(clear);
  nav_msgs::Path no_path;
  no_path.header.frame_id = kFrame;
  path_.publish(no_path);
}

void LiveView::tick(const phri_control::TickRecord& record, const TickMessages& messages, const TrialMonitor& monitor,
                    const ros::Time& stamp)
{
  const Eigen::Vector2d x = record.position;
  if (trail_.empty() || (x - trail_.back()).norm() > kTrailStep)
    trail_.push_back(x);
  if (trail_.size() > kTrailPoints)
    trail_.pop_front();

  const auto now = WallClock::now();
  if (!fast_.due(now))
    return;
  clock(stamp);
  tick_.publish(messages.tick);
  joints_.publish(messages.joints);
  human_.publish(messages.human);
  environment_.publish(messages.environment);
  assistance_.publish(messages.assistance);
  requested_.publish(messages.requested);
  state_.publish(controllerState(record, monitor, stamp));
  if (stamp > last_transform_)  // time stands still while a hand is waited for, and tf wants each stamp once
    transforms_.sendTransform(objectTransform(record, stamp));
  last_transform_ = stamp;
  if (slow_.due(now))
    draw(record, monitor.controller, stamp);
}

void LiveView::draw(const phri_control::TickRecord& record, const std::string& controller, const ros::Time& stamp)
{
  LivePicture picture;
  picture.record = &record;
  picture.obstacles = &obstacles_;
  picture.prediction = prediction_ ? &*prediction_ : nullptr;
  picture.trail = &trail_;
  const Eigen::Vector2d dot = pace_ ? route_->position(pace_->at(record.time_ns * 1e-9)) : Eigen::Vector2d(0, 0);
  picture.dot = pace_ ? &dot : nullptr;
  picture.title = participant_ + "     " + controller + "     " + trial_;
  if (markers_.getNumSubscribers() > 0)
    markers_.publish(markers(*experiment_->scene, picture, stamp));
  if (prediction_)
    path_.publish(predictedPath(*prediction_, stamp));
}

void LiveView::clock(const ros::Time& stamp) const
{
  rosgraph_msgs::Clock message;
  message.clock = stamp;
  clock_.publish(message);
}
}  // namespace phri_sim
