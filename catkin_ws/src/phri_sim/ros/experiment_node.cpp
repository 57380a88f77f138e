// Hosts trials of an experiment in ROS: the same phri_sim::Trial that runs without ROS, on topics, with a bag.
//
// Services: ~run_trial (phri_msgs/RunTrial), ~start ~stop ~clear_fault (of the running trial's loop), ~reset (ends the
// running trial, to be repeated), ~switch_controller, ~list_controllers, ~set_parameters (dynamic_reconfigure). Topics:
// see LiveView, HandSource, TuningServer; private parameters: see NodeSettings. Exit codes: 0 ended by
// a signal, 65 unusable picture, 70 internal error, 71 no lock file, 76 a node of this name runs already, 78 bad
// parameters.

#include <diagnostic_updater/diagnostic_updater.h>
#include <phri_msgs/ListControllers.h>
#include <phri_msgs/SwitchController.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <limits>
#include <sstream>
#include <system_error>

#include "instance_lock.hpp"
#include "trial_host.hpp"

namespace
{
using phri_sim::HostStatus;
using phri_sim::Reply;
using phri_sim::TrialHost;
using std_srvs::Trigger;

constexpr int kBadData = 65, kInternal = 70, kRefusedBySystem = 71, kNameTaken = 76, kConfiguration = 78;
constexpr unsigned kThreads = 3;  // one of them busy with a trial

class ExperimentNode
{
public:
  ExperimentNode(ros::NodeHandle node, ros::NodeHandle private_node, const phri_sim::NodeSetup& setup)
    : setup_(setup),
      host_(node, private_node, setup),
      tuning_(
          private_node, [this] { return host_.tunables(); }, [this](const auto& values) { host_.tune(values); }),
      updater_(node, private_node)
  {
    using phri_msgs::ListControllers;
    using phri_msgs::RunTrial;
    services_.push_back(private_node.advertiseService<RunTrial::Request, RunTrial::Response>(
        "run_trial", [this](RunTrial::Request& request, RunTrial::Response& response) {
          response = host_.run(request);
          return true;
        }));
    services_.push_back(private_node.advertiseService<ListControllers::Request, ListControllers::Response>(
        "list_controllers", [this](ListControllers::Request&, ListControllers::Response& response) {
          response.experiment = setup_.experiment->controllers;
          response.available = phri_control::assistanceNames();
          response.running = host_.runningController();
          return true;
        }));
    using phri_msgs::SwitchController;
    services_.push_back(private_node.advertiseService<SwitchController::Request, SwitchController::Response>(
        "switch_controller", [this](SwitchController::Request& request, SwitchController::Response& response) {
          const Reply reply = host_.switchController(request.controller);
          response.success = reply.success;
          response.message = reply.text;
          return true;
        }));
    trigger(private_node, "start", &TrialHost::start);
    trigger(private_node, "stop", &TrialHost::stop);
    trigger(private_node, "clear_fault", &TrialHost::clearFault);
    trigger(private_node, "reset", &TrialHost::reset);

    updater_.setHardwareID("simulated " + setup.experiment->name);
    updater_.add("interaction loop", this, &ExperimentNode::diagnose);
    // by the clock on the wall: session time stands still between trials
    timers_.push_back(
        node.createWallTimer(ros::WallDuration(1.0), [this](const ros::WallTimerEvent&) { updater_.force_update(); }));
    timers_.push_back(
        node.createWallTimer(ros::WallDuration(0.1), [this](const ros::WallTimerEvent&) { host_.idle(); }));
  }

private:
  void trigger(ros::NodeHandle& node, const std::string& name, Reply (TrialHost::*act)())
  {
    services_.push_back(node.advertiseService<Trigger::Request, Trigger::Response>(
        name, [this, act](Trigger::Request&, Trigger::Response& response) {
          const Reply reply = (host_.*act)();
          response.success = reply.success;
          response.message = reply.text;
          return true;
        }));
  }

  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& out)
  {
    using Level = diagnostic_msgs::DiagnosticStatus;
    const HostStatus now = host_.status();
    const std::string doing = now.running ? now.trial : "no trial is running";
    if (!now.error.empty())
      out.summary(Level::ERROR, now.error);
    else if (now.running && now.record.state == phri_core::LoopState::Fault)
      out.summary(Level::ERROR, std::string("FAULT ") + phri_core::faultName(now.record.fault) + ": " + doing);
    else if (!now.refused.empty())
      out.summary(Level::WARN, doing + "; degraded: the system refused " + now.refused);
    else
      out.summary(Level::OK, doing);
    out.add("clock", setup_.settings.clock);
    out.add("state", phri_core::stateName(now.record.state));
    out.add("ticks of this trial", now.ticks);
    out.add("real-time factor", now.real_time_factor);
    out.add("loop rate [Hz]", now.real_time_factor / setup_.experiment->loop.dt);
    out.add("lateness", now.lateness.empty() ? "lockstep" : now.lateness);
    out.add("age of the force/torque sample [s]", now.record.wrench_age);
    out.add("plans that failed", now.failed_plans);
    std::string limits;
    for (std::size_t bit = 0; bit < phri_core::limitNames().size(); ++bit)
      if (now.limits & (1u << bit))
        limits += (limits.empty() ? "" : " ") + phri_core::limitNames()[bit];
    out.add("limits that acted", limits);
  }

  const phri_sim::NodeSetup setup_;
  TrialHost host_;
  phri_sim::TuningServer tuning_;
  diagnostic_updater::Updater updater_;
  std::vector<ros::ServiceServer> services_;
  std::vector<ros::WallTimer> timers_;
};

/// The experiment's model settings as private parameters of the node that learns; it reads them with each new block.
void handModelSettings(const phri_sim::NodeSetup& setup)
{
  if (setup.settings.model_node.empty())
    return;
  const phri_sim::ModelSettings& model = setup.experiment->model;
  const ros::NodeHandle learner(setup.settings.model_node);
  learner.setParam("states", model.states);
  learner.setParam("reference", model.reference);
  learner.setParam("time", model.time);
  learner.setParam("recognition", model.recognition);
  learner.setParam("adapt_pace", model.adapt_pace);
  learner.setParam("window", model.window);
  learner.setParam("horizon", model.horizon);
  learner.setParam("dt", model.dt);
  learner.setParam("dof", model.dof);
  learner.setParam("frame", phri_sim::loopFrame(*setup.experiment).motion);
  const phri_learning::EmergingOptions& learning = model.learning;
  learner.setParam("kind", model.kind);
  learner.setParam("learning_dt", learning.dt);
  learner.setParam("members", learning.primitives.members);
  learner.setParam("cutoff", learning.primitives.cutoff);
  learner.setParam("window_states", learning.window_states);
  learner.setParam("segment_window", learning.segmentation.window);
  learner.setParam("switch_cost", learning.segmentation.switch_cost);
  learner.setParam("lag", learning.segmentation.lag);
  std::ostringstream scale;  // node_parameters knows no lists
  scale.precision(std::numeric_limits<double>::max_digits10);
  for (const double size : learning.segmentation.scale)
    scale << size << ' ';
  learner.setParam("scale", scale.str());
  learner.setParam("threaded", setup.settings.realtime());
}

int run(const std::string& name)
{
  ros::NodeHandle node, private_node("~");
  XmlRpc::XmlRpcValue parameters;
  private_node.getParam("", parameters);
  phri_sim::NodeSetup setup;
  try
  {
    setup = phri_sim::loadSetup(parameters, name);
  }
  catch (const phri_core::ParameterError& error)
  {
    ROS_FATAL("%s", error.what());
    return kConfiguration;
  }
  catch (const phri_sim::PictureError& error)
  {
    ROS_FATAL("E_PICTURE %s", error.what());
    return kBadData;
  }
  handModelSettings(setup);
  std::unique_ptr<ExperimentNode> experiment;
  try
  {
    experiment = std::make_unique<ExperimentNode>(node, private_node, setup);
  }
  catch (const std::invalid_argument& error)  // a recording that cannot be replayed
  {
    ROS_FATAL("E_HAND %s", error.what());
    return kBadData;
  }
  ROS_INFO("experiment %s, %s, at the service of %s/run_trial", setup.experiment->name.c_str(),
           setup.settings.clock.c_str(), name.c_str());
  ros::AsyncSpinner spinner(kThreads);
  spinner.start();
  ros::waitForShutdown();
  spinner.stop();  // waits for the running trial to close its bag
  return 0;
}
}  // namespace

int main(int argc, char** argv)
{
  ros::init(argc, argv, "experiment_node");
  const std::string name = ros::this_node::getName();
  try
  {
    // before the first NodeHandle: that is what registers with the master
    const phri_sim::InstanceLock lock(ros::master::getURI(), name);
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
