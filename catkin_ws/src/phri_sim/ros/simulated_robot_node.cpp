// A robot in a process of its own that speaks topics only, as a real one does: what interaction_node is proved with,
// and what a bring-up can be rehearsed on. 1 kHz of real time.
//
//   in   joint_velocity_command     std_msgs/Float64MultiArray [rad/s] of the acting arm, base to tip
//        cmd_vel                    geometry_msgs/Twist of the base, where the model has one
//        hand/force                 geometry_msgs/WrenchStamped: a hand's force ON the tip, axes of the world [N]
//   out  joint_states               sensor_msgs/JointState of the whole robot, 1 kHz
//        <arm>/ft_sensor/wrench_raw geometry_msgs/WrenchStamped in <arm>_ft_link, 1 kHz
//        odom                       nav_msgs/Odometry, 1 kHz, where the model has a base
//        hand/wrench                geometry_msgs/WrenchStamped: what the hand really exerts, axes of the world, 100 Hz
//        hand/tip                   nav_msgs/Odometry: how the tip really moves, all in the world, 100 Hz
//   ~joint_states_on, ~wrench_on    std_srvs/SetBool: a cable that breaks
//
// The hand is soft: it reaches its force within some 50 ms and gives way by `hand/damping`. Commands older than
// `command_timeout` [s] count as zero, as a robot's driver must hold it. `--check FILE` reads a URDF, lists all that is
// wrong with it, and ends. Exit codes: 0 ended by a signal, 70 internal error, 78 bad parameters or description.

#include <geometry_msgs/Twist.h>
#include <geometry_msgs/WrenchStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>
#include <sensor_msgs/JointState.h>
#include <std_msgs/Float64MultiArray.h>
#include <std_srvs/SetBool.h>

#include <cstdio>

#include "node_settings.hpp"
#include "phri_sim/monotonic.hpp"
#include "phri_sim/simulated_robot.hpp"

namespace phri_sim
{
namespace
{
constexpr int kInternal = 70, kConfiguration = 78;
constexpr double kDt = 0.001;
constexpr std::int64_t kPeriodNs = 1000000, kSlip = 20 * kPeriodNs;  // later than this, time is lost
constexpr double kRise = 0.05;                                       // [s] time constant of the hand's force
constexpr int kTruthEvery = 10;

struct Settings
{
  RobotSettings robot;
  Settings() { robot.model = robot.arm = "lwr"; }
  std::string tip = "lwr_tool0";
  int seed = 1;
  double command_timeout = 0.02, hand_damping = 5.0;
};

phri_core::ParameterTable table(Settings& s)
{
  phri_core::ParameterTable t;
  addParameters(t, s.robot);
  t.text("tip", &s.tip, {}, "link that the hand holds")
      .integer("seed", &s.seed, "", 0, 1000000, "of the sensors' noise and bias")
      .number("command_timeout", &s.command_timeout, "s", 0.002, 1.0, "older commands count as zero")
      .number("hand/damping", &s.hand_damping, "Ns/m", 0.0, 100.0, "by which the hand gives way");
  return t;
}

World buildWorld(const Settings& s)
{
  WorldOptions options;
  options.sensors = { s.robot.arm + "_ft_joint" };
  World world({ { loadRobot(s.robot.model), "", Eigen::Isometry3d::Identity() } }, {}, options);
  const std::map<std::string, double> natural = naturalPosture();
  Eigen::VectorXd q = Eigen::VectorXd::Zero(world.model().dofs());
  for (int i = 0; i < q.size(); ++i)
    if (const auto known = natural.find(world.model().joints()[std::size_t(i)].description.name);
        known != natural.end())
      q(i) = known->second;
  world.setState(q, Eigen::VectorXd::Zero(q.size()));
  return world;
}

geometry_msgs::Vector3 toMessage(const Eigen::Vector3d& v)
{
  geometry_msgs::Vector3 message;
  message.x = v.x();
  message.y = v.y();
  message.z = v.z();
  return message;
}

class RobotOverTopics
{
public:
  RobotOverTopics(ros::NodeHandle node, ros::NodeHandle private_node, const Settings& settings)
    : settings_(settings),
      world_(buildWorld(settings)),
      robot_(&world_, settings.robot, 0, kDt, std::uint64_t(settings.seed)),
      tip_(world_.model().link(settings.tip)),
      rates_(phri_control::VectorJoints::Zero(7))
  {
    const auto hints = ros::TransportHints().tcpNoDelay();
    subscribers_ = { node.subscribe("joint_velocity_command", 1, &RobotOverTopics::command, this, hints),
                     node.subscribe("cmd_vel", 1, &RobotOverTopics::drive, this, hints),
                     node.subscribe("hand/force", 1, &RobotOverTopics::push, this, hints) };
    joints_ = node.advertise<sensor_msgs::JointState>("joint_states", 10);
    wrench_ = node.advertise<geometry_msgs::WrenchStamped>(settings.robot.arm + "/ft_sensor/wrench_raw", 10);
    hand_ = node.advertise<geometry_msgs::WrenchStamped>("hand/wrench", 10);
    truth_ = node.advertise<nav_msgs::Odometry>("hand/tip", 10);
    if (robot_.mobile())
      odometry_ = node.advertise<nav_msgs::Odometry>("odom", 10);
    breakable(private_node, "joint_states_on", joints_on_);
    breakable(private_node, "wrench_on", wrench_on_);
    for (const TreeJoint& joint : world_.model().joints())
      joint_message_.name.push_back(joint.description.name);
    wrench_message_.header.frame_id = settings.robot.arm + "_ft_link";
  }

  void step()
  {
    const double age = (monotonicNs() - commanded_ns_) * 1e-9;
    const bool fresh = commanded_ns_ != 0 && age <= settings_.command_timeout;
    robot_.drive(fresh ? base_ : phri_control::BaseTwist(phri_control::BaseTwist::Zero()),
                 fresh ? rates_ : phri_control::VectorJoints(phri_control::VectorJoints::Zero(7)));
    asked_now_ += (1.0 - std::exp(-kDt / kRise)) * (asked_ - asked_now_);
    const Eigen::Vector3d velocity = world_.dynamics().linkVelocity(tip_).head<3>();
    // a hand that is not there does not damp
    const double contact = std::min(1.0, asked_now_.norm());
    exerted_ = asked_now_ - contact * settings_.hand_damping * velocity;
    world_.addForce(tip_, world_.linkPose(tip_).translation(), exerted_);
    world_.step(kDt, robot_.torques());
    robot_.sense();
    publish();
  }

private:
  void breakable(ros::NodeHandle& node, const std::string& name, bool& on)
  {
    services_.push_back(node.advertiseService<std_srvs::SetBool::Request, std_srvs::SetBool::Response>(
        name, [&on](std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response) {
          on = request.data;
          response.success = true;
          return true;
        }));
  }

  void command(const std_msgs::Float64MultiArrayConstPtr& message)
  {
    if (message->data.size() != 7)
    {
      ROS_ERROR_THROTTLE(5.0, "E_COMMAND topic=joint_velocity_command size=%zu expected=7 action=DROP",
                         message->data.size());
      return;
    }
    rates_ = Eigen::Map<const Eigen::VectorXd>(message->data.data(), 7);
    commanded_ns_ = monotonicNs();
  }
  void drive(const geometry_msgs::TwistConstPtr& message)
  {
    base_ << message->linear.x, message->linear.y, message->angular.z;
  }
  void push(const geometry_msgs::WrenchStampedConstPtr& message)
  {
    const Eigen::Vector3d force(message->wrench.force.x, message->wrench.force.y, message->wrench.force.z);
    if (force.allFinite())
      asked_ = force;
  }

  void publish()
  {
    const ros::Time stamp = ros::Time::now();
    joint_message_.header.stamp = wrench_message_.header.stamp = stamp;
    if (joints_on_)
    {
      joint_message_.position.assign(world_.q().data(), world_.q().data() + world_.q().size());
      joint_message_.velocity.assign(world_.qd().data(), world_.qd().data() + world_.qd().size());
      joints_.publish(joint_message_);
    }
    if (wrench_on_)
    {
      wrench_message_.wrench.force = toMessage(robot_.wrenchRaw().head<3>());
      wrench_message_.wrench.torque = toMessage(robot_.wrenchRaw().tail<3>());
      wrench_.publish(wrench_message_);
    }
    if (robot_.mobile())
      publishOdometry(stamp);
    if (++steps_ % kTruthEvery != 0)
      return;
    geometry_msgs::WrenchStamped hand;
    hand.header.stamp = stamp;
    hand.header.frame_id = "world";
    hand.wrench.force = toMessage(exerted_);
    hand_.publish(hand);
    nav_msgs::Odometry truth;
    truth.header = hand.header;
    truth.child_frame_id = "world";
    const Eigen::Isometry3d pose = world_.linkPose(tip_);
    const Eigen::Quaterniond turn(pose.linear());
    truth.pose.pose.position.x = pose.translation().x();
    truth.pose.pose.position.y = pose.translation().y();
    truth.pose.pose.position.z = pose.translation().z();
    truth.pose.pose.orientation.x = turn.x();
    truth.pose.pose.orientation.y = turn.y();
    truth.pose.pose.orientation.z = turn.z();
    truth.pose.pose.orientation.w = turn.w();
    const auto velocity = world_.dynamics().linkVelocity(tip_);
    truth.twist.twist.linear = toMessage(velocity.head<3>());
    truth.twist.twist.angular = toMessage(velocity.tail<3>());
    truth_.publish(truth);
  }

  void publishOdometry(const ros::Time& stamp)
  {
    const phri_control::BaseState& state = robot_.odometry();
    nav_msgs::Odometry message;
    message.header.stamp = stamp;
    message.header.frame_id = "odom";
    message.child_frame_id = "base_link";
    message.pose.pose.position.x = state.pose.x();
    message.pose.pose.position.y = state.pose.y();
    message.pose.pose.orientation.z = std::sin(0.5 * state.pose.z());
    message.pose.pose.orientation.w = std::cos(0.5 * state.pose.z());
    message.twist.twist.linear.x = state.twist.x();
    message.twist.twist.linear.y = state.twist.y();
    message.twist.twist.angular.z = state.twist.z();
    odometry_.publish(message);
  }

  const Settings settings_;
  World world_;
  SimulatedRobot robot_;
  int tip_;
  phri_control::VectorJoints rates_;
  phri_control::BaseTwist base_ = phri_control::BaseTwist::Zero();
  std::int64_t commanded_ns_ = 0;
  Eigen::Vector3d asked_{ 0, 0, 0 }, asked_now_{ 0, 0, 0 }, exerted_{ 0, 0, 0 };
  bool joints_on_ = true, wrench_on_ = true;
  unsigned steps_ = 0;
  sensor_msgs::JointState joint_message_;
  geometry_msgs::WrenchStamped wrench_message_;
  ros::Publisher joints_, wrench_, odometry_, hand_, truth_;
  std::vector<ros::Subscriber> subscribers_;
  std::vector<ros::ServiceServer> services_;
};

int run()
{
  ros::NodeHandle node, private_node("~");
  XmlRpc::XmlRpcValue parameters;
  private_node.getParam("", parameters);
  Settings settings;
  std::vector<std::string> errors;
  try
  {
    table(settings).assign(ros::this_node::getName(), flatten(parameters, errors));
  }
  catch (const phri_core::ParameterError& error)
  {
    errors.insert(errors.end(), error.errors().begin(), error.errors().end());
  }
  if (!errors.empty())
  {
    ROS_FATAL("%s", phri_core::ParameterError(ros::this_node::getName(), errors).what());
    return kConfiguration;
  }
  RobotOverTopics robot(node, private_node, settings);
  std::int64_t deadline = monotonicNs();
  while (ros::ok())
  {
    ros::spinOnce();
    const std::int64_t now = monotonicNs();
    if (now - deadline > kSlip)
      deadline = now;
    for (; deadline <= now; deadline += kPeriodNs)
      robot.step();
    const timespec until{ deadline / 1000000000, deadline % 1000000000 };
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
  }
  return 0;
}
}  // namespace
}  // namespace phri_sim

int main(int argc, char** argv)
{
  try
  {
    if (argc == 3 && std::string(argv[1]) == "--check")
    {
      const phri_sim::RobotDescription robot = phri_sim::loadRobot(argv[2]);
      std::printf("%s: %zu links, %zu joints\n", robot.name.c_str(), robot.links.size(), robot.joints.size());
      return 0;
    }
    ros::init(argc, argv, "simulated_robot");
    return phri_sim::run();
  }
  catch (const phri_sim::DescriptionError& error)
  {
    std::fprintf(stderr, "%s\n", error.what());
    return phri_sim::kConfiguration;
  }
  catch (const std::exception& error)
  {
    std::fprintf(stderr, "%s\n", error.what());
    return phri_sim::kInternal;
  }
}
