#include "live_view.hpp"

#include <geometry_msgs/WrenchStamped.h>
#include <rosgraph_msgs/Clock.h>

namespace phri_sim
{
namespace
{
constexpr int kQueue = 10;
}  // namespace

TopicNames::TopicNames(const ros::NodeHandle& node, const ros::NodeHandle& private_node, const LoopFrame& frame)
  : tick(private_node.resolveName("tick")),
    joints(node.resolveName(frame.topic)),
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
  : frame_(loopFrame(*experiment)),
    clock_(node.advertise<rosgraph_msgs::Clock>("/clock", kQueue)),
    tick_(private_node.advertise<phri_msgs::Tick>("tick", kQueue)),
    joints_(node.advertise<sensor_msgs::JointState>(frame_.topic, kQueue)),
    human_(node.advertise<geometry_msgs::WrenchStamped>("human_wrench", kQueue)),
    environment_(node.advertise<geometry_msgs::WrenchStamped>("environment_wrench", kQueue)),
    assistance_(node.advertise<geometry_msgs::WrenchStamped>("assistance_wrench", kQueue)),
    requested_(node.advertise<geometry_msgs::WrenchStamped>("requested_wrench", kQueue)),
    state_(private_node.advertise<phri_msgs::ControllerState>("state", kQueue)),
    path_(node.advertise<nav_msgs::Path>("predicted_path", kQueue)),
    markers_(private_node.advertise<visualization_msgs::MarkerArray>("markers", kQueue)),
    stage_(makeStageView(node, std::move(experiment), now))
{
}

void LiveView::begin(const TrialSpec& spec, const Stage* stage)
{
  stage_->begin(spec, stage);
  prediction_.reset();
  visualization_msgs::MarkerArray clear;
  clear.markers.resize(1);
  clear.markers[0].header.frame_id = frame_.motion;
  clear.markers[0].action = visualization_msgs::Marker::DELETEALL;
  markers_.publish(clear);
  nav_msgs::Path no_path;
  no_path.header.frame_id = frame_.motion;
  path_.publish(no_path);
}

void LiveView::tick(const Moment& moment, const TickMessages& messages, const TrialMonitor& monitor)
{
  stage_->follow(moment);
  const auto now = WallClock::now();
  if (!fast_.due(now))
    return;
  clock(moment.stamp);
  tick_.publish(messages.tick);
  joints_.publish(messages.joints);
  human_.publish(messages.human);
  environment_.publish(messages.environment);
  assistance_.publish(messages.assistance);
  requested_.publish(messages.requested);
  state_.publish(controllerState(moment.record, monitor, moment.stamp, frame_));
  stage_->publish(moment);
  if (slow_.due(now))
    draw(moment, monitor.controller);
}

void LiveView::draw(const Moment& moment, const std::string& controller)
{
  if (markers_.getNumSubscribers() > 0)
    markers_.publish(stage_->markers(moment, prediction_ ? &*prediction_ : nullptr, controller));
  if (prediction_)
    path_.publish(stage_->predictedPath(*prediction_, moment.stamp));
}

void LiveView::clock(const ros::Time& stamp) const
{
  rosgraph_msgs::Clock message;
  message.clock = stamp;
  clock_.publish(message);
}
}  // namespace phri_sim
