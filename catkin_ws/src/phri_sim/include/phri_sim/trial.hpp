#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "phri_control/assistance_planner.hpp"
#include "phri_control/interaction_loop.hpp"
#include "phri_sim/experiment.hpp"
#include "phri_sim/stage.hpp"
#include "phri_sim/transport_stage.hpp"

namespace phri_sim
{
/// What a prediction said about the position at its horizon's end: `time` = t0 + horizon.
struct PredictedPosition
{
  std::int64_t known_from_ns = 0;  ///< of the tick after which it was made
  double t0 = 0.0, horizon = 0.0;  ///< [s]
  Eigen::Vector2d mean;            ///< [m]
  Eigen::Matrix2d covariance;      ///< [m^2]
};

/// One trial, from the start to the goal (or the timeout), a millisecond at a time, without ROS: stage (person, device,
/// scene), interaction loop and assistance. The same object runs inside the ROS node. Bit-identical for one TrialSpec.
///
///   while (!trial.finished()) { trial.step(); if (trial.planDue()) trial.plan(prediction, or nothing); }
class Trial
{
public:
  /// `hand`: whose force moves the handle; without one, the simulated participant's.
  Trial(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec, std::unique_ptr<Hand> hand = nullptr);

  /// One tick of 1 ms. `lateness` [s]: by how much a real-time driver missed the tick's deadline.
  void step(double lateness = 0.0);
  /// After the step at t = 0, model.dt, 2 model.dt, ...: models may observe, and `plan` is expected.
  bool planDue() const { return (tick_ - 1) % replan_ticks_ == 0; }
  /// Lets the controller plan on `prediction`, from `observation` on; a failed plan, or no prediction, keeps the old
  /// policy. May be called from another thread than `step`; observation() may not.
  void plan(const phri_core::Observation& observation, const std::optional<phri_core::Prediction>& prediction);
  void plan(const std::optional<phri_core::Prediction>& prediction) { plan(observation(), prediction); }
  bool finished() const { return completed_ || timed_out_; }
  bool completed() const { return completed_; }

  phri_core::Observation observation() const { return loop_.observation(); }
  const phri_control::TickRecord& record() const { return loop_.record(); }
  phri_control::InteractionLoop& loop() { return loop_; }
  /// Where another controller or other settings are asked for, from any thread.
  phri_control::AssistancePlanner& planner() { return planner_; }
  const TrialSpec& spec() const { return spec_; }
  const Experiment& experiment() const { return *experiment_; }
  const Stage& stage() const { return *stage_; }
  double time() const { return tick_ * experiment_->loop.dt; }
  int failedPlans() const { return planner_.failures(); }

  /// Replaces the reading of the device before the loop sees it; for fault injection.
  std::function<void(phri_core::Measurement&, std::int64_t now_ns)> tamper;

private:
  std::shared_ptr<const Experiment> experiment_;
  TrialSpec spec_;
  std::unique_ptr<Stage> stage_;
  phri_control::InteractionLoop loop_;
  phri_control::AssistancePlanner planner_;
  std::int64_t tick_ = 0;
  int replan_ticks_;
  bool completed_ = false, timed_out_ = false;
};

/// A finished trial.
struct TrialLog
{
  TrialSpec spec;
  bool completed = false;
  int failed_plans = 0;
  int plans = 0;        ///< times at which the model was asked
  int primitives = -1;  ///< known at the end; -1: the model has none
  std::vector<phri_control::TickRecord> ticks;
  std::vector<PredictedPosition> predictions;
  /// Samples [x; xdot; u_h] every `model.dt`, (T, 3 dof): what the learner sees of it.
  Eigen::MatrixXd demonstration;
  std::vector<TransportSample> transport;  ///< every `model.dt` as well, of a transport; else empty
  /// Generalised outputs (T, 3 dof) of the primitives known at the end of a block; only its last trial has them.
  std::vector<Eigen::MatrixXd> primitive_outputs;
};

/// Runs a trial with a model (may be null) in lockstep. `learn`, if given, is called before the first tick and after
/// each plan: there the model may learn from what it has observed.
TrialLog runTrial(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec,
                  std::shared_ptr<phri_core::BehaviorModel> model, const std::function<void()>& learn = nullptr);

/// Learns a model from the demonstrations of a block so far, as the learner node does; null without any.
std::shared_ptr<phri_core::BehaviorModel> learn(const ModelSettings& settings,
                                                const std::vector<Eigen::MatrixXd>& demonstrations);

/// All trials of a block in order, learning in between (the first trial runs without a model), or, model kind
/// "emerging", during them.
std::vector<TrialLog> runBlock(std::shared_ptr<const Experiment> experiment, const Block& block);
}  // namespace phri_sim
