#pragma once
#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "phri_control/assistance.hpp"
#include "phri_control/force_sensor.hpp"
#include "phri_control/interaction_loop.hpp"
#include "phri_learning/emerging_options.hpp"
#include "phri_sim/carrying_person.hpp"
#include "phri_sim/configuration.hpp"
#include "phri_sim/haptic_device.hpp"
#include "phri_sim/lab.hpp"
#include "phri_sim/participant.hpp"
#include "phri_sim/robot_settings.hpp"
#include "phri_sim/scene.hpp"

namespace phri_sim
{
/// What the robot learns and how it predicts. Kind "time_hmm": one time-based HMM over [x; xdot; u_h] of the whole
/// trial, learned between trials. Kind "emerging": movement primitives, found and learned during the trials (5.1.1).
struct ModelSettings
{
  std::string kind = "time_hmm";
  int states = 40;                       ///< of the HMM, of each primitive
  std::string reference = "path";        ///< "path" (absolute) or "displacement"
  std::string time = "entry_corrected";  ///< "thesis" (3.8), "entry_corrected" or "regressed": progress in the model
  std::string recognition = "position";  ///< "position", "motion" or "all" (thesis): what tells the progress
  bool adapt_pace = false;               ///< model time passes at the observed pace
  double gate = 0.0;  ///< [m] a prediction farther away from where the object is than this is ignored (5.1.1); 0: none
  int window = 30;    ///< [samples] that recognition looks back
  double dt = 0.02;   ///< [s] sampling of the observations, step of the predictions, replanning period
  double horizon = 0.2;                     ///< [s] of the predictions
  int dof = 2;                              ///< of the task
  phri_learning::EmergingOptions learning;  ///< of kind "emerging"; what stands above as well goes by that

  bool emerging() const { return kind == "emerging"; }
  phri_learning::EmergingOptions emergingOptions() const;
};

/// Everything that defines an experiment but the people and the seeds. Immutable once loaded.
struct Experiment
{
  std::string name, path;
  std::string task = "planar";         ///< "planar", "transport"
  std::shared_ptr<const Scene> scene;  ///< of a planar task; else null
  std::shared_ptr<const Lab> lab;      ///< of a transport; else null
  phri_control::LoopSettings loop;
  phri_control::AssistanceSettings assistance;
  SensorSettings sensors;  ///< of the planar device
  RobotSettings robot;     ///< of the other tasks, as the next
  phri_control::ForceSensorSettings force_sensor;
  ModelSettings model;
  Population population;
  CarryingPopulation carriers;      ///< of a transport
  std::vector<std::string> routes;  ///< of a transport: trial k takes number k - 1, from the first again after the last
  std::vector<std::string> controllers;
  int participants = 1, trials = 3;
  int seed = 7;
  double pace = 0.0;  ///< [s] of an exemplary run along the scene's path that the person follows; 0: at one's own pace
  std::vector<double> assistance_off;  ///< trials of a block in which the robot predicts, but u_r = 0
  std::vector<double> let_go_in;       ///< trials of a block in which the simulated person lets the handle go
  double let_go_after = 10.0;          ///< [s]
  double timeout = 60.0;               ///< [s] after which a trial ends without having reached the goal

  bool planar() const { return task == "planar"; }
  bool assists(int trial) const
  {
    return std::find(assistance_off.begin(), assistance_off.end(), double(trial)) == assistance_off.end();
  }
  /// [s] after which the simulated person lets go; infinite: never.
  double letsGo(int trial) const
  {
    const bool here = std::find(let_go_in.begin(), let_go_in.end(), double(trial)) != let_go_in.end();
    return here ? let_go_after : std::numeric_limits<double>::infinity();
  }
  /// Ticks between two observations of the model, and between two plans.
  int replanTicks() const { return int(std::lround(model.dt / loop.dt)); }
};

/// Loads `config/experiments/<name>.yaml` or a path and the scene, robot, safety profile and population that it names.
/// `overrides` replace keys of the experiment file; its keys "override/robot/...", "override/safety/..." and
/// "override/participants/..." replace keys of the files named. Throws phri_core::ParameterError listing all errors of
/// all files at once, or PictureError when the scene's picture is all that is wrong.
Experiment loadExperiment(const std::string& name_or_path, const Parameters& overrides = {});

/// Reference of every parameter of every file, as Markdown.
std::string parameterReference();

/// One trial of the plan. `seed` belongs to participant and trial alone, so that noise and obstacles are the same under
/// every controller.
struct TrialSpec
{
  int participant = 0;
  std::string controller;
  int trial = 1;           ///< 1.. within the block
  int practice = 0;        ///< trials that this person has done before, in any block
  bool evaluated = false;  ///< the last trial of the block
  std::uint64_t seed = 0;
  std::uint64_t study_seed = 0;  ///< that the person is drawn from
};

/// The trials of one person under one controller, in order; the robot starts with nothing learned.
struct Block
{
  int participant = 0;
  std::string controller;
  std::uint64_t seed = 0;  ///< of the study
  std::vector<TrialSpec> trials;
};

TrialSpec trialSpec(int participant, const std::string& controller, int trial, int trials, int practice,
                    std::uint64_t study_seed);

/// Participants 0 .. participants - 1, each under every controller in the order of a balanced Latin square (Williams
/// 1949), `trials` trials per block. Zero or negative numbers: those of the experiment.
std::vector<Block> schedule(const Experiment& experiment, int participants, int trials, std::uint64_t seed);
}  // namespace phri_sim
