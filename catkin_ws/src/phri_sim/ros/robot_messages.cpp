#include "robot_messages.hpp"

#include <algorithm>
#include <array>

namespace phri_sim
{
namespace
{
const std::array<std::string, 3> kBaseJoints = { "base_x_joint", "base_y_joint", "base_yaw_joint" };

geometry_msgs::Quaternion toQuaternion(const Eigen::Matrix3d& rotation)
{
  const Eigen::Quaterniond q(rotation);
  geometry_msgs::Quaternion message;
  message.x = q.x();
  message.y = q.y();
  message.z = q.z();
  message.w = q.w();
  return message;
}
}  // namespace

Eigen::Isometry3d planarPose(const Eigen::Vector3d& pose)
{
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.linear() = Eigen::AngleAxisd(pose.z(), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  result.translation() << pose.head<2>(), 0.0;
  return result;
}

Eigen::Isometry3d odomInWorld(const StageSample& sample)
{
  return planarPose(sample.base) * planarPose(sample.odometry.pose).inverse();
}

geometry_msgs::Point toPoint(const Eigen::Vector3d& x)
{
  geometry_msgs::Point point;
  point.x = x(0);
  point.y = x(1);
  point.z = x(2);
  return point;
}

geometry_msgs::Pose toPose(const Eigen::Isometry3d& pose)
{
  geometry_msgs::Pose message;
  message.position = toPoint(pose.translation());
  message.orientation = toQuaternion(pose.linear());
  return message;
}

geometry_msgs::TransformStamped toTransform(const Eigen::Isometry3d& pose, const std::string& parent,
                                            const std::string& child, const ros::Time& stamp)
{
  geometry_msgs::TransformStamped message;
  message.header.stamp = stamp;
  message.header.frame_id = parent;
  message.child_frame_id = child;
  message.transform.translation.x = pose.translation().x();
  message.transform.translation.y = pose.translation().y();
  message.transform.translation.z = pose.translation().z();
  message.transform.rotation = toQuaternion(pose.linear());
  return message;
}

geometry_msgs::WrenchStamped toWrench(const Vector6& wrench, const std::string& frame, const ros::Time& stamp)
{
  geometry_msgs::WrenchStamped message;
  message.header.stamp = stamp;
  message.header.frame_id = frame;
  message.wrench.force.x = wrench(0);
  message.wrench.force.y = wrench(1);
  message.wrench.force.z = wrench(2);
  message.wrench.torque.x = wrench(3);
  message.wrench.torque.y = wrench(4);
  message.wrench.torque.z = wrench(5);
  return message;
}

void fillJoints(const StageSample& sample, const ros::Time& stamp, sensor_msgs::JointState& message)
{
  message.header.stamp = stamp;
  message.position.assign(sample.q.data(), sample.q.data() + sample.joints);
  message.velocity.assign(sample.qd.data(), sample.qd.data() + sample.joints);
  const Eigen::Vector3d& pose = sample.odometry.pose;
  const Eigen::Vector3d velocity = planarPose({ 0.0, 0.0, pose.z() }).linear() * sample.odometry.twist;
  for (std::size_t i = 0; i < kBaseJoints.size(); ++i)
  {
    const auto joint = std::find(message.name.begin(), message.name.end(), kBaseJoints[i]);
    if (joint == message.name.end())
      continue;
    message.position[std::size_t(joint - message.name.begin())] = pose(Eigen::Index(i));
    message.velocity[std::size_t(joint - message.name.begin())] = velocity(Eigen::Index(i));
  }
}

nav_msgs::Odometry odometry(const StageSample& sample, const ros::Time& stamp)
{
  nav_msgs::Odometry message;
  message.header.stamp = stamp;
  message.header.frame_id = "odom";
  message.child_frame_id = "base_link";
  message.pose.pose = toPose(planarPose(sample.odometry.pose));
  message.twist.twist.linear.x = sample.odometry.twist.x();
  message.twist.twist.linear.y = sample.odometry.twist.y();
  message.twist.twist.angular.z = sample.odometry.twist.z();
  return message;
}

std::vector<geometry_msgs::TransformStamped> robotTransforms(const StageSample& sample, const ros::Time& stamp)
{
  const Eigen::Isometry3d odom = odomInWorld(sample);
  Eigen::Isometry3d grasp = Eigen::Isometry3d::Identity();
  grasp.translation() = odom.inverse() * sample.tip.translation();
  return { toTransform(odom, "world", "odom", stamp), toTransform(grasp, "odom", "grasp", stamp) };
}
}  // namespace phri_sim
