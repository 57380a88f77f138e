// The InteractionLoop on a real robot, over standard topics: see RobotTopics for what it reads, RobotOutputs for what
// it publishes, interaction_settings.hpp for its private parameters (and robot_description, the URDF's text).
//
// `interaction_node --parameters` prints the parameters, with units, ranges and defaults, and ends.
//
// Services (std_srvs/Trigger): ~start ~stop ~clear_fault ~tare, and <arm>/ft_sensor/tare. Exit codes: 0 ended by a
// signal, 70 internal error, 71 no lock file, 76 a node of this name runs already, 78 bad parameters.

#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <csignal>
#include <cstdio>
#include <system_error>

#include "instance_lock.hpp"
#include "interaction_host.hpp"

namespace
{
using phri_control::InteractionHost;
using phri_control::Reply;
using std_srvs::Trigger;

constexpr int kInternal = 70, kRefusedBySystem = 71, kNameTaken = 76, kConfiguration = 78;
constexpr unsigned kThreads = 2;  // a stop is heard while a tare is under way
constexpr double kLateShare = 0.01;
volatile std::sig_atomic_t asked_to_end = 0;

class InteractionNode
{
public:
  InteractionNode(ros::NodeHandle node, ros::NodeHandle private_node, const phri_control::InteractionSetup& setup)
    : host_(node, private_node, setup), updater_(node, private_node)
  {
    trigger(private_node, "start", &InteractionHost::start);
    trigger(private_node, "stop", &InteractionHost::stop);
    trigger(private_node, "clear_fault", &InteractionHost::clearFault);
    trigger(private_node, "tare", &InteractionHost::tare);
    trigger(node, setup.settings.arm + "/ft_sensor/tare", &InteractionHost::tare);
    updater_.setHardwareID(setup.settings.arm);
    updater_.add("interaction loop", this, &InteractionNode::diagnose);
    timer_ =
        node.createWallTimer(ros::WallDuration(1.0), [this](const ros::WallTimerEvent&) { updater_.force_update(); });
  }

private:
  void trigger(ros::NodeHandle& node, const std::string& name, Reply (InteractionHost::*act)())
  {
    services_.push_back(node.advertiseService<Trigger::Request, Trigger::Response>(
        name, [this, act, name](Trigger::Request&, Trigger::Response& response) {
          const Reply reply = (host_.*act)();
          response.success = reply.success;
          response.message = reply.text;
          ROS_INFO("%s: %s", name.c_str(), reply.text.c_str());
          return true;
        }));
  }

  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& out)
  {
    using Level = diagnostic_msgs::DiagnosticStatus;
    const InteractionHost::Status now = host_.status();
    const auto& record = now.output.record;
    if (record.state == phri_core::LoopState::Fault)
      out.summary(Level::ERROR, std::string("FAULT ") + phri_core::faultName(record.fault) + ": " + now.message);
    else if (!now.refused.empty())
      out.summary(Level::WARN, "degraded: the system refused " + now.refused);
    else if (now.late_cycles > kLateShare * now.cycles)
      out.summary(Level::WARN, "the loop comes late");
    else
      out.summary(Level::OK, now.message.empty() ? phri_core::stateName(record.state) : now.message);
    out.add("state", phri_core::stateName(record.state));
    out.add("cycles published", now.cycles);
    out.add("cycles that came a period late", now.late_cycles);
    out.add("latest cycle [s]", now.worst_lateness);
    out.add("age of the wrench [s]", record.wrench_age);
    out.add("age of joint_states [s]", now.output.joint_age);
    out.add("age of odom [s]", now.output.odometry_age);
    out.add("error of following [m]", now.output.error);
    out.add("sensor saturated", now.health.saturated);
    out.add("tare", phri_control::describe(now.health.tare));
  }

  InteractionHost host_;
  diagnostic_updater::Updater updater_;
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer timer_;
};

int run(const std::string& name)
{
  ros::NodeHandle node, private_node("~");
  XmlRpc::XmlRpcValue parameters;
  private_node.getParam("", parameters);
  std::string key, urdf;
  if (node.searchParam("robot_description", key))
    node.getParam(key, urdf);
  phri_control::InteractionSetup setup;
  try
  {
    setup = phri_control::loadInteraction(parameters, urdf, name);
  }
  catch (const phri_core::ParameterError& error)
  {
    ROS_FATAL("%s", error.what());
    return kConfiguration;
  }
  ros::AsyncSpinner spinner(kThreads);
  {
    InteractionNode interaction(node, private_node, setup);
    ROS_INFO("arm %s, %s coordinates, %s; call %s/start", setup.settings.arm.c_str(),
             setup.settings.coordinates.c_str(), setup.settings.output.c_str(), name.c_str());
    spinner.start();
    while (!asked_to_end && ros::ok())
      ros::WallDuration(0.02).sleep();
    spinner.stop();
  }  // the robot comes to rest while the topics still stand
  ros::shutdown();
  return 0;
}
}  // namespace

int main(int argc, char** argv)
{
  if (argc == 2 && std::string(argv[1]) == "--parameters")
  {
    std::fputs(phri_control::interactionParameters().c_str(), stdout);
    return 0;
  }
  ros::init(argc, argv, "interaction_node", ros::init_options::NoSigintHandler);
  for (const int signal : { SIGINT, SIGTERM, SIGHUP })
    std::signal(signal, [](int) { asked_to_end = 1; });
  const std::string name = ros::this_node::getName();
  try
  {
    // before the first NodeHandle: that is what registers with the master
    const phri_control::InstanceLock lock(ros::master::getURI(), name);
    if (!lock.held())
    {
      ROS_FATAL(
          "E_NAME_TAKEN node=%s pid=%s action=EXIT hint=\"a node of this name runs on %s; end it, or give this one "
          "another name (__name:=...)\"",
          name.c_str(), lock.holder().c_str(), ros::master::getURI().c_str());
      return kNameTaken;
    }
    return run(name);
  }
  catch (const std::system_error& error)
  {
    ROS_FATAL("%s: %s", name.c_str(), error.what());
    return kRefusedBySystem;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL("%s: %s", name.c_str(), error.what());
    return kInternal;
  }
}
