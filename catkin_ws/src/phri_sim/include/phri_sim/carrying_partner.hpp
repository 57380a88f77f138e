#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>

#include "phri_core/random.hpp"
#include "phri_sim/carrying_person.hpp"
#include "phri_sim/walking_path.hpp"

namespace phri_sim
{
using Vector6 = Eigen::Matrix<double, 6, 1>;

/// What a person sees and feels of the grasp at the start of a tick, in world axes. The grasp frame: x along the object
/// from the robot's grasp to the person's, z up when it is carried level.
struct FarEnd
{
  Eigen::Vector3d position{ 0, 0, 0 };                     ///< [m] of the far grasp
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< of the grasp frame
  Vector6 velocity = Vector6::Zero();                      ///< [m/s, rad/s] of the grasp, linear first
  /// [N, Nm] assistance BY the robot ON the object, last tick, about the far grasp: what it does beyond following, so
  /// without the weight it holds and the object it renders.
  Vector6 robot_wrench = Vector6::Zero();
};

/// What is carried, as the person has learned to feel it.
struct CarriedObject
{
  double mass = 1.9;                   ///< [kg] real
  double grasp_distance = 1.1;         ///< [m] between the two grasps
  double rendered_mass = 15.0;         ///< [kg] the robot renders at its grasp, in the plane
  double rendered_damping = 80.0;      ///< [Ns/m]
  double rendered_inertia = 0.3;       ///< [kgm2] about the vertical through the robot's grasp
  double rendered_turn_damping = 7.0;  ///< [Nms/rad]
};

/// What the person wants: draw the far end along `path`, the robot trailing behind it at the other end.
///
/// In line and not side by side: in the thesis the person pulls the robot (figure 5.8), the object fits so through the
/// gap between car and trolley, and walking across the car's front leaves the bumper parallel to it. So the intended
/// yaw is that of a rod drawn along the path (trailingYaw). Nobody turns the robot about the own hand: the yaw at the
/// end is what the path makes of it.
struct CarryingPlan
{
  std::shared_ptr<const WalkingPath> path;  ///< of the far grasp [m], world
  double initial_yaw = 0.0;                 ///< [rad] of the object's x axis at the start
  double go = 0.5;                          ///< [s] when the person sets off
};

/// A simulated person who carries the far end: bounded reach around a walking body, stiffness and damping of two arms
/// (part of it intrinsic, part a delayed reflex through lagging muscles), reflected mass, feed-forward of the load, a
/// role between leading and following, noise, strength and grip. One call per millisecond. A model for testing, not
/// evidence about people.
///
///   W = sat( (1 - r) K6 e + D6 de - M6 a~ + muscle( a_w m g + alpha [ beta ff + r K6 e(t - d_p) + K_v e(t - d_v) ]
///            + (1 - alpha) [ -D_f V + K_f LP(robot wrench) ] ) + noise )
///
/// e = [p_d - p; log(R_d R^T)]; r: the share of the reflex; K6, D6, M6 in the axes of the intended yaw; alpha per axis.
/// Damping is all intrinsic: behind 80 ms of delay and 90 ms of muscle it would excite the light far end.
/// a~ is the acceleration behind a dashpot M6 / 5 ms (soft tissue): a mass that needs no measured acceleration, and
/// passive.
class CarryingPartner
{
public:
  /// Allocates here, never later. Throws std::invalid_argument without a path or with an impossible object.
  CarryingPartner(CarryingPlan plan, const CarriedObject& object, const CarryingPerson& person,
                  std::uint64_t trial_seed);

  /// [N, Nm] exerted BY the person ON the object at the far grasp, world axes; t [s] since the start of the trial.
  Vector6 step(double t, const FarEnd& end) noexcept;

  /// What the person is up to, as of the last step.
  struct Intention
  {
    Eigen::Vector3d position{ 0, 0, 0 }, velocity{ 0, 0, 0 };  ///< [m, m/s] hand reference, with gait
    Eigen::Vector2d walked{ 0, 0 };                            ///< [m] place on the path
    double yaw = 0.0, yaw_rate = 0.0;                          ///< [rad, rad/s]
    double s = 0.0, speed = 0.0;                               ///< [m, m/s] along the path
    double role = 1.0;                                         ///< alpha of translation
    bool arrived = false;                                      ///< stands at the end of the path
    bool slipping = false;                                     ///< the grip was at its bound
  };
  const Intention& intention() const noexcept { return intention_; }

private:
  void walk(double t, const FarEnd& end) noexcept;
  Eigen::Vector2d feedForward() const noexcept;
  Vector6 withNoise(const Vector6& wrench, double t) noexcept;
  Vector6 bounded(const Vector6& wrench, const Eigen::Vector3d& axis) noexcept;

  struct Line  ///< values of the last half second, one per millisecond
  {
    std::array<Vector6, 512> values;
    std::size_t newest = 0;
    void push(const Vector6& value) noexcept;
    const Vector6& before(std::size_t steps) const noexcept;
  };

  CarryingPlan plan_;
  CarriedObject object_;
  CarryingPerson person_;
  phri_core::Random random_;
  AlongPath pace_, yaw_;
  Intention intention_;
  Vector6 stiffness_, damping_, inertia_;  // diagonals, in the axes of the intended yaw
  Line error_, error_rate_, place_;
  std::size_t reflex_ticks_, visual_ticks_;
  Vector6 muscle_first_, muscle_, hand_velocity_, variation_, felt_, heard_, last_;
  Eigen::Vector2d reach_{ 0, 0 }, walking_{ 0, 0 }, acceleration_{ 0, 0 };
  double rate_ = 0.0, yaw_acceleration_ = 0.0, role_ = 0.0, side_ = 0.0, height_ = 1.0;
  double mood_, gait_phase_, tremor_rate_, tremor_phase_;
  bool started_ = false;
};
}  // namespace phri_sim
