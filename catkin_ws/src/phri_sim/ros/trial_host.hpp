#pragma once
#include <phri_msgs/RunTrial.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>

#include "node_settings.hpp"
#include "prediction_inbox.hpp"
#include "realtime_loop.hpp"
#include "trial_output.hpp"

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

/// Hosts trials, one at a time, on the session's clock: session time = start of the trial + trial time, and it only
/// rises. In lockstep a tick that is followed by an observation waits for the answer of the model (2 s, then the trial
/// is given up); in real time the newest answer counts and nothing waits.
class TrialHost
{
public:
  TrialHost(ros::NodeHandle& node, ros::NodeHandle& private_node, const NodeSetup& setup);

  /// Runs one trial; returns when it has ended, and never throws.
  phri_msgs::RunTrialResponse run(const phri_msgs::RunTrialRequest& request);
  /// Ends the running trial as aborted; false when none runs.
  bool abort();
  /// Calls `request` with the loop of the running trial; false when none runs.
  bool ask(const std::function<void(phri_control::InteractionLoop&)>& request);
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
  void conduct(const phri_msgs::RunTrialRequest& request, const TrialSpec& spec, phri_msgs::RunTrialResponse& response);
  void lockstep(Run& run);
  void realtime(Run& run);
  void observe(Run& run, const phri_core::Observation& observation, std::int64_t time_ns);
  void tick(Run& run, const phri_control::TickRecord& record, unsigned failed_plans);
  void announce(const TrialSpec& spec, std::uint8_t phase, bool completed, std::uint32_t observations);
  bool interrupted() const { return abort_ || !ros::ok(); }
  ros::Time sessionTime() const;

  const NodeSetup setup_;
  TopicNames names_;
  LiveView live_;
  PredictionInbox inbox_;
  ros::Publisher observations_, trials_;
  std::atomic<std::int64_t> session_ns_;
  std::atomic<bool> abort_{ false };

  std::mutex busy_;           // held while a trial runs
  mutable std::mutex mutex_;  // guards the rest
  Trial* trial_ = nullptr;
  HostStatus status_;
};
}  // namespace phri_sim
