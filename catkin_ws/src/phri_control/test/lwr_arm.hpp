#pragma once
/// An arm with the public dimensions of the KUKA LWR 4+ (DH d1 = .3105, d3 = .400, d5 = .390, d7 = .078 m), as URDF
/// text on a base, and its forward kinematics written down a second time, from the DH table. Straight up at q = 0.

#include <Eigen/Geometry>
#include <cmath>
#include <sstream>
#include <string>

#include "phri_control/kinematics.hpp"
#include "phri_core/random.hpp"

namespace lwr
{
constexpr double kD1 = 0.3105, kD3 = 0.400, kD5 = 0.390, kD7 = 0.078;
constexpr double kTool = 0.20;  ///< [m] flange to tool0: sensor and gripper
constexpr double kDegree = M_PI / 180.0;
constexpr double kLimit[7] = { 170, 120, 170, 120, 170, 120, 170 };     // [deg]
constexpr double kVelocity[7] = { 110, 110, 128, 128, 204, 184, 184 };  // [deg/s]

inline Eigen::Isometry3d mount()
{
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() << 0.2, 0.2, 0.6;
  pose.linear() = Eigen::AngleAxisd(-0.3, Eigen::Vector3d::UnitX()).toRotationMatrix();
  return pose;
}

/// `speed` multiplies the largest velocities.
inline std::string urdf(double speed = 1.0)
{
  const double height[7] = { 0.11, kD1 - 0.11, 0.2, kD3 - 0.2, 0.2, kD5 - 0.2, kD7 };
  const char* axis[7] = { "0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1" };
  std::ostringstream text;
  text.precision(17);
  text << "<robot name=\"lwr\"><link name=\"base_link\"/><link name=\"arm_base_link\"/>"
       << "<joint name=\"arm_mount\" type=\"fixed\"><parent link=\"base_link\"/><child link=\"arm_base_link\"/>"
       << "<origin xyz=\"0.2 0.2 0.6\" rpy=\"-0.3 0 0\"/></joint>";
  std::string parent = "arm_base_link";
  for (int i = 0; i < 7; ++i)
  {
    const std::string child = "arm_" + std::to_string(i + 1) + "_link";
    text << "<link name=\"" << child << "\"/><joint name=\"arm_" << i << "_joint\" type=\"revolute\"><parent link=\""
         << parent << "\"/><child link=\"" << child << "\"/><origin xyz=\"0 0 " << height[i] << "\"/><axis xyz=\""
         << axis[i] << "\"/><limit lower=\"" << -kLimit[i] * kDegree << "\" upper=\"" << kLimit[i] * kDegree
         << "\" velocity=\"" << speed * kVelocity[i] * kDegree << "\" effort=\"100\"/></joint>";
    parent = child;
  }
  text << "<link name=\"arm_tool0\"/><joint name=\"arm_tool0_joint\" type=\"fixed\"><parent link=\"" << parent
       << "\"/><child link=\"arm_tool0\"/><origin xyz=\"0 0 " << kTool << "\"/></joint></robot>";
  return text.str();
}

inline phri_control::ArmKinematics arm(double speed = 1.0)
{
  return { urdf(speed), "base_link", "arm_tool0" };
}

/// Rotations about the vertical and the pitch axes of a straight arm, between its four lengths.
inline Eigen::Isometry3d forward(const phri_control::VectorJoints& q)
{
  using Eigen::AngleAxisd;
  using Eigen::Translation3d;
  const Eigen::Vector3d y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  return mount() * Translation3d(0, 0, kD1) * AngleAxisd(q(0), z) * AngleAxisd(-q(1), y) * AngleAxisd(q(2), z) *
         Translation3d(0, 0, kD3) * AngleAxisd(q(3), y) * AngleAxisd(q(4), z) * Translation3d(0, 0, kD5) *
         AngleAxisd(-q(5), y) * AngleAxisd(q(6), z) * Translation3d(0, 0, kD7 + kTool);
}

/// A posture well within the limits and well away from singularities; the tool points ahead.
inline phri_control::VectorJoints posture()
{
  phri_control::VectorJoints q(7);
  q << 0.0, -0.6, 0.0, 1.6, 0.0, 0.6, 0.0;
  return q;
}

/// Uniform within the limits less `margin` [rad].
inline phri_control::VectorJoints randomPosture(const phri_control::ArmKinematics& arm, phri_core::Random& random,
                                                double margin = 0.0)
{
  phri_control::VectorJoints q(arm.joints());
  for (int i = 0; i < arm.joints(); ++i)
    q(i) = random.uniform(arm.lower()(i) + margin, arm.upper()(i) - margin);
  return q;
}

/// Normal, scaled by the two deviations.
inline phri_control::Twist randomTwist(phri_core::Random& random, double linear, double angular)
{
  phri_control::Twist twist;
  for (int i = 0; i < 6; ++i)
    twist(i) = random.normal(0.0, i < 3 ? linear : angular);
  return twist;
}
}  // namespace lwr
