#pragma once
/// For tests: a rigid bar at constant height, its near end rendered by a planar admittance, its far end in a person's
/// hand. No robot, no Bullet.
#include <Eigen/Geometry>
#include <cmath>

#include "phri_sim/carrying_partner.hpp"

namespace carried_bar
{
constexpr double kDt = 0.001;

/// M(yaw) [a; alpha] + D [v; omega] = [F; F x lever + torque], near end; damping implicit, the rest explicit.
struct Bar
{
  phri_sim::CarriedObject object;
  double length = 1.2;           // [m] of a thin rod, grasped symmetrically
  Eigen::Vector3d q{ 0, 0, 0 };  // near end [m, m, rad]
  Eigen::Vector3d v{ 0, 0, 0 };
  double height = 1.0;
  phri_sim::Vector6 assistance = phri_sim::Vector6::Zero();  // BY the robot ON the object, about the far grasp

  Eigen::Vector2d axis() const { return { std::cos(q(2)), std::sin(q(2)) }; }
  void placeFarEnd(const Eigen::Vector2d& far, double yaw)
  {
    q << far - object.grasp_distance * Eigen::Vector2d(std::cos(yaw), std::sin(yaw)), yaw;
    v.setZero();
  }
  phri_sim::FarEnd farEnd() const
  {
    const Eigen::Vector2d u = axis(), n(-u(1), u(0));
    phri_sim::FarEnd end;
    end.position << q.head<2>() + object.grasp_distance * u, height;
    end.rotation = Eigen::AngleAxisd(q(2), Eigen::Vector3d::UnitZ()).toRotationMatrix();
    end.velocity << v.head<2>() + object.grasp_distance * v(2) * n, 0.0, 0.0, 0.0, v(2);
    end.robot_wrench = assistance;
    return end;
  }
  void step(const phri_sim::Vector6& wrench)
  {
    const phri_sim::Vector6 w = wrench + assistance;
    const double m = object.mass, c = 0.5 * object.grasp_distance, lever = object.grasp_distance;
    const Eigen::Vector2d u = axis(), n(-u(1), u(0));
    Eigen::Matrix3d mass = Eigen::Vector3d(object.rendered_mass + m, object.rendered_mass + m,
                                           object.rendered_inertia + m * (length * length / 12.0 + c * c))
                               .asDiagonal();
    mass.topRightCorner<2, 1>() = m * c * n;
    mass.bottomLeftCorner<1, 2>() = m * c * n.transpose();
    const Eigen::Vector3d damping(object.rendered_damping, object.rendered_damping, object.rendered_turn_damping);
    Eigen::Vector3d force;
    force << w.head<2>() + m * c * v(2) * v(2) * u, w(5) + lever * n.dot(w.head<2>());
    const Eigen::Matrix3d implicit = mass + kDt * Eigen::Matrix3d(damping.asDiagonal());
    v = implicit.inverse() * (mass * v + kDt * force);
    q += kDt * v;
  }
};
}  // namespace carried_bar
