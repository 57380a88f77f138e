#pragma once
#include <string>

#include "phri_control/interaction_loop.hpp"

namespace phri_sim
{
/// What the operator should know and do about the state of the loop; empty when all is well.
std::string operatorText(const phri_control::TickRecord& record);
}  // namespace phri_sim
