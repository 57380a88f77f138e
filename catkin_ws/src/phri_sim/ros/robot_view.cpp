#include "robot_view.hpp"

#include "recorder.hpp"

namespace phri_sim
{
namespace
{
constexpr int kQueue = 10;
constexpr double kTrailStep = 0.02;                                            // [m] between points of the trails
constexpr std::int64_t kMotionPeriod = 10000000, kTransformPeriod = 20000000;  // [ns] in a bag

geometry_msgs::WrenchStamped inOwnAxes(const StageSample& sample, const ros::Time& stamp)
{
  Vector6 wrench;
  const Eigen::Matrix3d turn = sample.far.linear().transpose();
  wrench << turn * sample.person.head<3>(), turn * sample.person.tail<3>();
  return toWrench(wrench, "object_human", stamp);
}
}  // namespace

RobotView::RobotView(ros::NodeHandle& node, std::shared_ptr<const Experiment> experiment, const ros::Time& now)
  : experiment_(std::move(experiment)),
    tip_frame_(experiment_->robot.arm + "_gripper_tcp"),
    sensor_frame_(experiment_->robot.arm + "_ft_link"),
    joints_(node.advertise<sensor_msgs::JointState>("joint_states", kQueue)),
    odom_(node.advertise<nav_msgs::Odometry>("odom", kQueue)),
    raw_(node.advertise<geometry_msgs::WrenchStamped>(experiment_->robot.arm + "/ft_sensor/wrench_raw", kQueue)),
    wrench_(node.advertise<geometry_msgs::WrenchStamped>(experiment_->robot.arm + "/ft_sensor/wrench", kQueue)),
    person_(node.advertise<geometry_msgs::WrenchStamped>("person_wrench", kQueue)),
    lab_(node.advertise<visualization_msgs::MarkerArray>("lab", 1, true))
{
  picture_.lab = experiment_->lab.get();
  lab_.publish(labMarkers(*experiment_->lab, now));
}

void RobotView::begin(const TrialSpec& spec, const Stage* stage)
{
  const auto* carrying = dynamic_cast<const TransportStage*>(stage);
  if (!carrying)
    return;
  const World& world = carrying->world();
  joint_message_.name.clear();
  for (const TreeJoint& joint : world.model().joints())
    joint_message_.name.push_back(joint.description.name);
  object_ = world.linkPose(world.model().link(tip_frame_)).inverse() * world.linkPose(world.model().link("object"));
  static_transforms_.sendTransform(objectInHand(ros::Time::now()));
  picture_.route = &carrying->route();
  picture_.title = "participant " + std::to_string(spec.participant) + "     trial " + std::to_string(spec.trial);
  picture_.real.clear();
  picture_.believed.clear();
}

geometry_msgs::TransformStamped RobotView::objectInHand(const ros::Time& stamp) const
{
  return toTransform(object_, tip_frame_, "object", stamp);
}

void RobotView::follow(const Moment& moment)
{
  const Eigen::Vector2d real = moment.sample.tip.translation().head<2>();
  if (!picture_.real.empty() && (real - picture_.real.back()).norm() < kTrailStep)
    return;
  picture_.real.push_back(real);
  picture_.believed.push_back((odomInWorld(moment.sample).inverse() * moment.sample.tip.translation()).head<2>());
}

void RobotView::fill(const Moment& moment)
{
  raw_message_ = toWrench(moment.sample.raw, sensor_frame_, moment.stamp);
  wrench_message_ = toWrench(moment.sample.sensed, "grasp", moment.stamp);
  person_message_ = inOwnAxes(moment.sample, moment.stamp);
}

void RobotView::publish(const Moment& moment)
{
  fill(moment);
  fillJoints(moment.sample, moment.stamp, joint_message_);
  joints_.publish(joint_message_);
  odom_.publish(odometry(moment.sample, moment.stamp));
  raw_.publish(raw_message_);
  wrench_.publish(wrench_message_);
  person_.publish(person_message_);
  transforms_.sendTransform(robotTransforms(moment.sample, moment.stamp));
}

visualization_msgs::MarkerArray RobotView::markers(const Moment& moment, const phri_core::Prediction* prediction,
                                                   const std::string& controller) const
{
  return carryingMarkers(picture_, moment, prediction, controller);
}

nav_msgs::Path RobotView::predictedPath(const phri_core::Prediction& prediction, const ros::Time& stamp) const
{
  nav_msgs::Path path;
  path.header.frame_id = "odom";
  path.header.stamp = stamp;
  for (std::size_t k = 0; k < prediction.desired_state.size(); ++k)
  {
    geometry_msgs::PoseStamped pose;
    pose.header = path.header;
    pose.header.stamp += ros::Duration(double(k) * prediction.dt);
    pose.pose = toPose(planarPose(prediction.desired_state[k].mean.head<3>()));
    path.poses.push_back(pose);
  }
  return path;
}

void RobotView::recordFirst(Recorder& recorder, const ros::Time& start) const
{
  recorder.writeLatched("/tf_static", start, transforms({ objectInHand(start) }));
  recorder.writeLatched(lab_.getTopic(), start, labMarkers(*experiment_->lab, start));
}

void RobotView::record(Recorder& recorder, const Moment& moment)
{
  fill(moment);
  recorder.write(raw_.getTopic(), moment.stamp, raw_message_);
  recorder.write(wrench_.getTopic(), moment.stamp, wrench_message_);
  recorder.write(person_.getTopic(), moment.stamp, person_message_);
  if (moment.record.time_ns % kMotionPeriod == 0)
  {
    fillJoints(moment.sample, moment.stamp, joint_message_);
    recorder.write(joints_.getTopic(), moment.stamp, joint_message_);
    recorder.write(odom_.getTopic(), moment.stamp, odometry(moment.sample, moment.stamp));
  }
  if (moment.record.time_ns % kTransformPeriod == 0)
    recorder.write("/tf", moment.stamp, transforms(robotTransforms(moment.sample, moment.stamp)));
}
}  // namespace phri_sim
