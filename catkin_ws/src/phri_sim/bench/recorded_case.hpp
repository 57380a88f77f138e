#pragma once
/// What all benchmarks work on: the last trial of person 0 (seed 7) of the experiment `maze_assistance` under
/// `mahalanobis`, with the model learned from the two trials before it. The simulation is deterministic, so every run
/// of a build measures the same numbers.

#include <memory>
#include <string>
#include <vector>

#include "phri_control/lq_solver.hpp"
#include "phri_learning/behavior_models.hpp"
#include "phri_sim/trial.hpp"

namespace phri_sim_bench
{
struct RecordedCase
{
  std::shared_ptr<const phri_sim::Experiment> experiment;
  phri_sim::TrialSpec spec;                                ///< of the trial that is measured
  std::shared_ptr<phri_learning::TimeHmmModel> model;      ///< learned from the trials before it
  std::vector<phri_core::Observation> observations;        ///< of the trial, every model.dt, up to its middle
  phri_core::Prediction prediction;                        ///< made from the last one of them
  phri_control::LinearQuadraticProblem<4, 2> lqr;          ///< what `lqr` solves for `prediction`
  phri_control::LinearQuadraticProblem<4, 2> mahalanobis;  ///< what `mahalanobis` solves for it

  const phri_learning::TimeHmm& hmm() const { return model->tracker().model(); }
  const phri_core::Observation& now() const { return observations.back(); }
  /// Windows of `model.window` samples [x; xdot; u_h] (window, 6) all along the trial, the newest one first.
  std::vector<Eigen::MatrixXd> windows() const;
};

/// Simulates, learns, and checks what the peers will be compared with: the problems above have the first gains of the
/// policies that AssistanceController::plan returns. Throws std::runtime_error if one differs.
RecordedCase recordCase();

/// The case as JSON for programs in other languages: the LQ problems with the first gain, the HMM, the windows with the
/// paths through them, the prediction; numbers are written so that they read back to the last bit. Throws
/// std::runtime_error if the file cannot be written.
void writeCase(const RecordedCase& recorded, const std::string& path);
}  // namespace phri_sim_bench
