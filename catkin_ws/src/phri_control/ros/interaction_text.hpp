#pragma once
#include <string>

#include "robot_topics.hpp"

namespace phri_control
{
/// For people: what stands in the way of a start, and what helps; empty if nothing does.
std::string obstacleText(const RobotOutput& output, const TopicHealth& health, const InteractionSetup& setup);
/// For people: why it is in FAULT, or what it waits for; empty when all is well.
std::string operatorText(const RobotOutput& output, const TopicHealth& health, const InteractionSetup& setup);
}  // namespace phri_control
