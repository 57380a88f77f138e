#pragma once
#include <string>
#include <vector>

#include "node_settings.hpp"
#include "phri_sim/trial.hpp"

namespace phri_sim
{
/// Something that was switched or tuned while a trial ran.
struct Change
{
  double t = 0.0;    ///< [s] since the start of the trial
  std::string what;  ///< "controller = lqr", "pd/stiffness = 400"
};

/// What the analysis must know of a trial besides its numbers, as JSON: experiment, task, scene, participant,
/// controller, trial, evaluated, practice, seed (of the study), trial_seed, completed, start, goal, obstacles, units,
/// git_revision (environment variable PHRI_GIT_REVISION), human, simulated_participants, changes, every parameter in
/// force at the start. Of a planar task also turning_point_x, path and pace where there are any; of a transport room,
/// object, route (name, waypoints, passes), turning_radius, robot.
/// Written twice: at the start of a bag with completed = false, and at its end with the truth; the last one counts.
std::string metadata(const NodeSetup& setup, const TrialSpec& spec, bool completed, int failed_plans,
                     const std::vector<Change>& changes);
}  // namespace phri_sim
