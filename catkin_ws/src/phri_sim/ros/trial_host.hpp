#pragma once
#include <phri_msgs/RunTrial.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "hand_source.hpp"
#include "metadata.hpp"
#include "node_settings.hpp"
#include "prediction_inbox.hpp"
#include "realtime_loop.hpp"
#include "trial_output.hpp"
#include "tuning_server.hpp"

namespace phri_sim
{
/// A model node did not answer.
class PeerLost : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};
/// The operator, or the end of the node.
class Interrupted : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// [s] that a model may take for one answer, before the trial is given up.
constexpr double kModelWait = 2.0;

/// How the host is doing, for diagnostics.
struct HostStatus
{
  bool running = false;
  std::string trial;                ///< which one, in words
  phri_control::TickRecord record;  ///< newest
  double real_time_factor = 0.0;    ///< simulated time per time on the wall, of this trial so far
  unsigned failed_plans = 0, ticks = 0;
  std::uint32_t limits = 0;  ///< since the last look
  std::string lateness;      ///< real time only
  std::string refused;       ///< what the system refused to a real-time thread
  std::string error;         ///< of the last trial
};

/// What came of a request of the operator.
struct Reply
{
  bool success = false;
  std::string text;
};

/// Hosts trials, one at a time, on the session's clock: session time = start of the trial + trial time, and it only
/// rises. In lockstep a tick that is followed by an observation waits for the answer of the model (2 s, then the trial
/// is given up); in real time the newest answer counts and nothing waits. With a real hand a trial begins when the hand
/// is there, and where the hand does not start it by itself, when the operator does.
class TrialHost
{
public:
  TrialHost(ros::NodeHandle& node, ros::NodeHandle& private_node, const NodeSetup& setup);

  /// Runs one trial; returns when it has ended, and never throws.
  phri_msgs::RunTrialResponse run(const phri_msgs::RunTrialRequest& request);

  /// The operator's requests, from any thread.
  Reply start();
  Reply stop();
  Reply clearFault();
  /// Ends the running trial as aborted: the session repeats it.
  Reply reset();
  Reply switchController(const std::string& name);
  /// What may be tuned, with the values in force.
  TuningServer::Entries tunables() const;
  /// Puts values in force for the running trial and all later ones. Throws phri_core::ParameterError.
  void tune(const TuningServer::Values& values);

  /// Repeats /clock between trials, so that who comes late knows the time.
  void idle();
  std::string runningController() const;
  HostStatus status();

private:
  struct Run
  {
    Trial& trial;
    TrialOutput& output;
    bool use_model = false;
    std::uint32_t observations = 0;
    unsigned failed_plans = 0, ticks = 0;
    std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
  };

  void check(const phri_msgs::RunTrialRequest& request) const;
  void waitForModel() const;
  void waitForHand(const TrialSpec& spec);
  void conduct(const phri_msgs::RunTrialRequest& request, TrialSpec spec, phri_msgs::RunTrialResponse& response);
  void lockstep(Run& run);
  void realtime(Run& run);
  void observe(Run& run, const phri_core::Observation& observation, std::int64_t time_ns);
  void tick(Run& run, const phri_control::TickRecord& record, const StageSample& sample);
  void show(const phri_control::TickRecord& record, const std::string& text, const ros::Time& stamp);
  void announce(const TrialSpec& spec, std::uint8_t phase, bool completed, std::uint32_t observations);
  NodeSetup inForce() const;
  std::vector<Change> changes() const;
  void changed(const std::string& what);
  OperatorActions actions();
  void enter(Trial& trial, const Experiment& experiment);
  Reply ask(const std::string& done, const std::function<void(phri_control::InteractionLoop&)>& request);
  bool interrupted() const { return abort_ || !ros::ok(); }
  ros::Time sessionTime() const;

  NodeSetup setup_;  // its experiment changes when something is tuned
  TopicNames names_;
  LiveView live_;
  PredictionInbox inbox_;
  ros::Publisher observations_, trials_;
  std::atomic<std::int64_t> session_ns_;
  std::atomic<bool> abort_{ false }, waiting_{ false }, start_asked_{ false };
  std::chrono::steady_clock::time_point next_show_{};

  std::mutex busy_;           // held while a trial runs
  mutable std::mutex mutex_;  // guards the rest, and setup_.experiment
  Trial* trial_ = nullptr;
  HostStatus status_;
  std::string chosen_;           // controller that a real person chose; empty: the one asked for
  std::vector<Change> changes_;  // of the running trial

  std::unique_ptr<HandSource> hands_;  // null: a simulated hand. Last, because its thread calls everything above
};
}  // namespace phri_sim
