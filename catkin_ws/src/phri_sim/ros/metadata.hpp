#pragma once
#include <string>

#include "node_settings.hpp"
#include "phri_sim/trial.hpp"

namespace phri_sim
{
/// What the analysis must know of a trial besides its numbers, as JSON: experiment, scene, participant, controller,
/// trial, evaluated, practice, seed (of the study), trial_seed, completed, start, goal, obstacles, turning_point_x,
/// map, units, git_revision (environment variable PHRI_GIT_REVISION), simulated_participants, every parameter in force.
/// Written twice: at the start of a bag with completed = false, and at its end with the truth; the last one counts.
std::string metadata(const NodeSetup& setup, const TrialSpec& spec, bool completed, int failed_plans);
}  // namespace phri_sim
