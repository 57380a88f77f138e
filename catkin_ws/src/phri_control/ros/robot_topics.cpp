#include "robot_topics.hpp"

#include <algorithm>

#include "tick_thread.hpp"

namespace phri_control
{
namespace
{
constexpr double kWarnPeriod = 5.0;  // [s]
constexpr double kShortest = 1e-4;   // [s] between joint states that a velocity is formed from
constexpr int kReadings = 20;        // a raw reading must not be lost: the low-pass counts them

Vector6d toVector(const geometry_msgs::Wrench& w)
{
  return (Vector6d() << w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z).finished();
}
}  // namespace

RobotTopics::RobotTopics(const ros::NodeHandle& node, const InteractionSetup& setup, RobotTick& tick,
                         std::int64_t start_ns)
  : setup_(setup),
    tick_(tick),
    start_ns_(start_ns),
    chain_(setup.sensor_chain.front()),
    sensor_(setup.force_sensor),
    spinner_(1, &queue_)
{
  joints_.position = joints_.velocity = VectorJoints::Zero(chain_.joints());
  ros::NodeHandle own(node);
  own.setCallbackQueue(&queue_);
  const auto hints = ros::TransportHints().tcpNoDelay();
  const std::string prefix = setup.settings.arm + "/ft_sensor/";
  const bool raw = setup.settings.ft_input == "raw";
  if (raw)
  {
    clean_publisher_ = own.advertise<geometry_msgs::WrenchStamped>(prefix + "wrench", 10);
    pose_publisher_ = own.advertise<geometry_msgs::PoseStamped>(setup.settings.arm + "/ft_link", 10);
    pose_.header.frame_id = setup.settings.base_link;
  }
  wrench_ = own.subscribe(prefix + (raw ? "wrench_raw" : "wrench"), kReadings, &RobotTopics::wrench, this, hints);
  joint_subscriber_ = own.subscribe("joint_states", 10, &RobotTopics::joints, this, hints);
  if (setup.settings.mobile())
    odometry_ = own.subscribe("odom", 1, &RobotTopics::odometry, this, hints);
  spinner_.start();
}

std::int64_t RobotTopics::now() const
{
  return monotonicNs() - start_ns_;
}

void RobotTopics::tare()
{
  const std::lock_guard<std::mutex> lock(mutex_);
  tare_asked_ = true;
  health_.tare.state = TareState::Running;
}

TopicHealth RobotTopics::health() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  TopicHealth health = health_;
  health.wrench_publishers = wrench_.getNumPublishers();
  return health;
}

void RobotTopics::joints(const sensor_msgs::JointStateConstPtr& message)
{
  const std::int64_t arrived = now();
  const std::vector<std::string>& wanted = chain_.jointNames();
  JointSample sample = joints_;
  std::string missing;
  int found = 0, with_velocity = 0;
  for (int i = 0; i < chain_.joints(); ++i)
  {
    const std::size_t k =
        std::find(message->name.begin(), message->name.end(), wanted[std::size_t(i)]) - message->name.begin();
    if (k >= message->name.size() || k >= message->position.size())
    {
      missing = wanted[std::size_t(i)];
      continue;
    }
    ++found;
    sample.position(i) = message->position[k];
    if (k < message->velocity.size())
    {
      sample.velocity(i) = message->velocity[k];
      ++with_velocity;
    }
  }
  if (found == 0)
    return;  // of the gripper, the base, another arm
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    health_.missing_joint = missing;
  }
  if (found < chain_.joints())
  {
    ROS_ERROR_THROTTLE(kWarnPeriod, "E_JOINTS topic=%s missing=%s action=DROP", joint_subscriber_.getTopic().c_str(),
                       missing.c_str());
    return;
  }
  const double elapsed = (arrived - joints_.receive_ns) * 1e-9;
  if (with_velocity < found)
    sample.velocity = joints_.receive_ns == 0
                          ? VectorJoints(VectorJoints::Zero(found))
                          : VectorJoints((sample.position - joints_.position) / std::max(elapsed, kShortest));
  sample.receive_ns = arrived;
  joints_ = sample;
  tick_.post(sample);
}

Vector6d RobotTopics::compensate(const Vector6d& raw)
{
  ArmJacobian jacobian;
  SensorMotion motion;
  const Eigen::Isometry3d pose = chain_.forward(joints_.position, jacobian);
  motion.orientation = pose.linear();
  const Eigen::Quaterniond turn(pose.linear());
  pose_.pose.position.x = pose.translation().x();
  pose_.pose.position.y = pose.translation().y();
  pose_.pose.position.z = pose.translation().z();
  pose_.pose.orientation.x = turn.x();
  pose_.pose.orientation.y = turn.y();
  pose_.pose.orientation.z = turn.z();
  pose_.pose.orientation.w = turn.w();
  const Twist twist = jacobian * joints_.velocity;
  motion.velocity = twist.head<3>();
  motion.angular_velocity = twist.tail<3>();
  bool begin = false;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    begin = std::exchange(tare_asked_, false);
  }
  if (begin)
    sensor_.tare();
  const ForceReading reading = sensor_.update(raw, motion);
  const std::lock_guard<std::mutex> lock(mutex_);
  health_.saturated = reading.saturated;
  if (!tare_asked_)
    health_.tare = sensor_.tareReport();
  return reading.wrench;
}

void RobotTopics::wrench(const geometry_msgs::WrenchStampedConstPtr& message)
{
  if (wrench_.getNumPublishers() > 1)
  {
    ROS_ERROR_THROTTLE(kWarnPeriod, "E_PUBLISHERS topic=%s publishers=%u expected=1 action=DROP",
                       wrench_.getTopic().c_str(), wrench_.getNumPublishers());
    return;
  }
  if (joints_.receive_ns == 0)
    return;  // where the sensor points is not known yet
  sample_.receive_ns = sample_.stamp_ns = now();
  if (setup_.settings.ft_stamps == "header")
    sample_.stamp_ns -= (ros::Time::now() - message->header.stamp).toNSec();
  ++sample_.sequence;
  sample_.right_frame = message->header.frame_id == setup_.settings.ft_frame;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    health_.wrench_frame = message->header.frame_id;
  }
  if (!sample_.right_frame)
    ROS_ERROR_THROTTLE(kWarnPeriod, "E_FRAME topic=%s frame_id=\"%s\" expected=\"%s\" action=REFUSE",
                       wrench_.getTopic().c_str(), message->header.frame_id.c_str(), setup_.settings.ft_frame.c_str());
  else if (setup_.settings.ft_input == "raw")
  {
    sample_.wrench = compensate(toVector(message->wrench));
    clean_.header = message->header;
    clean_.wrench.force.x = sample_.wrench(0);
    clean_.wrench.force.y = sample_.wrench(1);
    clean_.wrench.force.z = sample_.wrench(2);
    clean_.wrench.torque.x = sample_.wrench(3);
    clean_.wrench.torque.y = sample_.wrench(4);
    clean_.wrench.torque.z = sample_.wrench(5);
    clean_publisher_.publish(clean_);
    pose_.header.stamp = message->header.stamp;
    pose_publisher_.publish(pose_);
  }
  else
    sample_.wrench = toVector(message->wrench);
  tick_.post(sample_);
}

void RobotTopics::odometry(const nav_msgs::OdometryConstPtr& message)
{
  const auto& o = message->pose.pose.orientation;
  OdometrySample sample;
  sample.receive_ns = now();
  sample.state.pose << message->pose.pose.position.x, message->pose.pose.position.y,
      std::atan2(2.0 * (o.w * o.z + o.x * o.y), 1.0 - 2.0 * (o.y * o.y + o.z * o.z));
  sample.state.twist << message->twist.twist.linear.x, message->twist.twist.linear.y, message->twist.twist.angular.z;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    health_.odometry_frame = message->header.frame_id;
  }
  tick_.post(sample);
}
}  // namespace phri_control
