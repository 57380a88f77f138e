#pragma once
#include <string>
#include <vector>

#include "phri_sim/robot_description.hpp"

namespace phri_sim
{
/// URDF text to links and joints in the order of the file. What is missing, not a number or out of range is appended to
/// `errors`, one line each with the line of the text; numbers that could not be read are NaN. Whether they form a tree
/// of possible bodies is not judged here. False if the text is no URDF at all.
///
/// Reads the XML itself: urdfdom 3.0 gives up at the first error and prints it on the console, drops an <inertial> or
/// <collision> that it cannot read, takes missing bounds of a limit as 0, and lets loops, links with two parents, zero
/// or long axes, negative masses, reversed limits and sizes below 0 pass.
bool readUrdf(const std::string& urdf, RobotDescription& robot, std::vector<std::string>& errors);
}  // namespace phri_sim
