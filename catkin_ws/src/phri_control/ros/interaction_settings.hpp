#pragma once
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

#include "phri_control/assistance.hpp"
#include "phri_control/force_sensor.hpp"
#include "robot_tick.hpp"

namespace phri_control
{
/// Private parameters of the interaction node, as they stand in its YAML.
struct InteractionSettings
{
  std::string arm = "arm";                ///< prefix of the sensor's topics, links and joints
  std::string base_link = "base_link";    ///< where the arm's chain begins; z points up
  std::string tip_link;                   ///< the point that is moved; empty: <arm>_tool0
  std::string coordinates = "point";      ///< "planar" [x, y, yaw] or "point" [x, y, z]
  std::string base = "fixed";             ///< "fixed" or "omni": odometry in, cmd_vel out
  std::string output = "joint_velocity";  ///< or "twist" of the tool
  std::string ft_input = "raw";           ///< or "compensated": bias and payload are removed already
  std::string ft_frame;                   ///< of the wrench, a link; empty: <arm>_ft_link
  std::string ft_stamps = "header";       ///< or "arrival", where the sensor's clock is another one
  double ft_rate = 1000.0;                ///< [Hz] of the raw readings
  std::string controller = "none";        ///< of assistanceNames()
  std::string model;                      ///< predictions come on prediction/<model>; empty: none
  double gate = 0.1;                      ///< [m] see withinGate

  bool planar() const { return coordinates == "planar"; }
  bool mobile() const { return base == "omni"; }
};

/// Everything that the node is made from, checked.
struct InteractionSetup
{
  InteractionSettings settings;
  RobotTickSettings tick;
  LoopSettings loop;
  WholeBodySettings body;
  ForceSensorSettings force_sensor;
  AssistanceSettings assistance;
  std::vector<ArmKinematics> arm;                            ///< one: base_link to tip_link
  std::vector<ArmKinematics> sensor_chain;                   ///< one: base_link to the sensor's frame
  Eigen::Isometry3d sensor = Eigen::Isometry3d::Identity();  ///< the sensor's frame in the tip's
};

/// Reads the tree of private parameters and the URDF's text. Throws phri_core::ParameterError listing everything that
/// is wrong anywhere, at once; `where` names the node.
InteractionSetup loadInteraction(const XmlRpc::XmlRpcValue& parameters, const std::string& urdf,
                                 const std::string& where);
/// Key, unit, range and default of every parameter as Markdown, for the documentation.
std::string interactionParameters();
}  // namespace phri_control
