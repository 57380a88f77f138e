#pragma once
#include <array>

#include "phri_control/whole_body.hpp"
#include "phri_sim/transport_stage.hpp"

namespace phri_sim
{
/// What a tick's TickRecord does not say of a robot stage; plain data of fixed size, so that it may leave the tick
/// through a preallocated ring. Like there, motion is that at the start of the tick, and the wrenches act during it.
/// Of a planar stage: nothing, `joints` is 0.
struct StageSample
{
  static constexpr int kMaxJoints = 32, kMaxContacts = 8;
  using Joints = Eigen::Matrix<double, kMaxJoints, 1>;
  struct ContactPoint
  {
    Eigen::Vector3d point, force;  ///< world [m], exerted BY the environment ON robot or object [N]
  };

  int joints = 0;                                                    ///< number of joints of the world
  Joints q = Joints::Zero(), qd = q;                                 ///< real [rad, m; rad/s, m/s]
  phri_control::BaseState odometry;                                  ///< believed
  Eigen::Vector3d base = { 0, 0, 0 };                                ///< where it really is, world [m, m, rad]
  Eigen::Isometry3d tip = Eigen::Isometry3d::Identity(), far = tip;  ///< robot's grasp, object's far one; world
  Vector6 raw = Vector6::Zero();                                     ///< of the wrist sensor, in its frame [N, Nm]
  Vector6 sensed = raw;               ///< without payload, about the robot's grasp, axes of odom [N, Nm]
  Vector6 person = raw;               ///< BY the person ON the far grasp, about it, world axes [N, Nm]
  Eigen::Vector2d walked = { 0, 0 };  ///< [m] the person's place on the route, world
  double way = 0.0;                   ///< [m] along the route
  int contacts = 0;                   ///< points below that count
  std::array<ContactPoint, kMaxContacts> contact;
};

/// Fills samples of one trial's stage, around each step of it:
///
///   sampler.before(sample);  trial.step();  sampler.after(sample);
class StageSampler
{
public:
  /// The stage must outlive it. Throws std::length_error for a robot of more joints than a sample holds.
  StageSampler(const Stage& stage, const Experiment& experiment);

  void before(StageSample& sample) const noexcept;
  void after(StageSample& sample) const noexcept;

private:
  const TransportStage* stage_;  // null: planar, nothing to sample
  int tip_ = 0, far_ = 0;
};
}  // namespace phri_sim
