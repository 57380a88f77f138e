#pragma once
#include <Eigen/Geometry>
#include <memory>
#include <string>
#include <vector>

#include "phri_control/contact_control.hpp"
#include "phri_control/force_sensor.hpp"
#include "phri_control/interaction_loop.hpp"
#include "phri_sim/configuration.hpp"
#include "phri_sim/robot_settings.hpp"
#include "phri_sim/teaching.hpp"
#include "phri_sim/whiteboard.hpp"

namespace phri_sim
{
/// Surroundings of a contact task and what is to be done in them. World frame: below the stand of the robot, x forward,
/// z up. A displacement moves what is pressed on along the press direction, away from the tool.
struct ContactScene
{
  std::string name;
  bool wipes = false;                                ///< else a button is pressed and a point shown
  double tilt = 0.0;                                 ///< [rad] of the tool from straight down toward x
  double tip = 0.0;                                  ///< [m] from the gripper's tcp along the tool
  Eigen::Vector3d start = Eigen::Vector3d::Zero();   ///< of the tip [m]
  Eigen::Vector3d button = Eigen::Vector3d::Zero();  ///< middle of the back of its plate, which looks up [m]
  Eigen::Vector3d point = Eigen::Vector3d::Zero();   ///< where the tip is to be in the end [m]
  WhiteboardParameters board;                        ///< upright, looks along -x
  TaughtMotion motion;

  /// Columns: axes of the tip, z out of the tool.
  Eigen::Matrix3d orientation() const;
  /// Way of what is pressed on [m].
  Eigen::Vector3d shift(double displacement) const { return displacement * motion.press; }
};

/// Loads `config/scenes/<name>.yaml`, or a path. Throws phri_core::ParameterError listing all errors.
ContactScene loadContactScene(const std::string& name_or_path);

/// All that defines a study of a contact task but the seeds (5.4.3). Immutable once loaded.
struct ContactTask
{
  std::string name, path;
  ContactScene scene;
  phri_control::LoopSettings loop;
  RobotSettings robot;
  phri_control::ForceSensorSettings force_sensor;
  phri_control::ContactSettings control;
  TeacherHabits teacher;
  int demonstrations = 12;
  int states = 60;    ///< of the time-based HMM
  double dt = 0.02;   ///< [s] between samples of a demonstration, and between plans
  double rest = 1.0;  ///< [s] that a reproduction goes on beyond the end of the learned motion
  std::vector<std::string> controllers;
  std::vector<double> displacements;  ///< [m] conditions
  int seeds = 10;
  int seed = 7;                       ///< of the study
  double pointing_tolerance = 0.005;  ///< [m]
  double wiped_success = 0.95;        ///< [-] share of the text
  double wiped_partial = 0.05;        ///< [-]
};

/// Loads `config/experiments/<name>.yaml`, or a path, and the scene, robot and safety profile that it names.
/// `overrides` replace keys of the experiment file. Throws phri_core::ParameterError listing all errors of all files.
ContactTask loadContactTask(const std::string& name_or_path, const Parameters& overrides = {});
}  // namespace phri_sim
