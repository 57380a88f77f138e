#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "phri_core/parameters.hpp"
#include "phri_core/random.hpp"

namespace phri_sim
{
/// A leg of an intended motion: minimum jerk from where the leg before ended.
struct TaughtLeg
{
  Eigen::Vector3d to;     ///< of the tool's tip, world [m]
  double duration = 1.0;  ///< [s]
  double force = 0.0;  ///< to be pressed with at its end, along the press direction [N]; above 0: by feel, see Teacher
  double scatter = 0.0;  ///< [m] standard deviation of `to` between demonstrations, per axis
};

/// What a teacher intends.
struct TaughtMotion
{
  Eigen::Vector3d press{ 0, 0, -1 };  ///< unit: into the environment
  std::vector<TaughtLeg> legs;
};

/// How a teacher's hand acts, and how one demonstration differs from the next. All values are assumptions.
struct TeacherHabits
{
  double stiffness = 500.0;    ///< of the hand about where it wants to be [N/m]
  double damping = 40.0;       ///< [Ns/m]
  double force_max = 60.0;     ///< [N]
  double force_onset = 0.5;    ///< [s] in which the pressing force changes
  double pace = 0.05;          ///< [-] coefficient of variation of the pace of a demonstration
  double duration = 0.05;      ///< [-] likewise of each leg beside that
  double force = 0.08;         ///< [-] likewise of the pressing force
  double start = 0.005;        ///< [m] standard deviation of where the tip is at first, per axis
  double tremor = 0.001;       ///< [m] of a slow wandering of the hand
  double force_tremor = 0.04;  ///< [-] of the pressing force
  double tremor_time = 0.7;    ///< [s] correlation time of both
};
/// Keys under `teacher/`.
void addParameters(phri_core::ParameterTable& table, TeacherHabits& habits);

/// A person who guides the tip of a compliant robot by hand, holding it before the wrist sensor, which therefore feels
/// the environment alone. The hand is a spring and damper about the intended place, and carries the robot's rendered
/// damping along. Where it presses it goes by feel: along the press direction it exerts the intended force instead,
/// less its damping. It knows nothing of the environment: whether and where there is contact is the world's business.
class Teacher
{
public:
  /// `drag` [Ns/m]: what the robot renders. `start`: of the tip [m]. Demonstrations `index` of one seed differ.
  Teacher(const TaughtMotion& motion, const TeacherHabits& habits, double drag, const Eigen::Vector3d& start,
          std::uint64_t seed, int index);

  /// By the hand ON the robot at the tip [N], at `t` [s] since the start; once per tick of `dt` [s].
  Eigen::Vector3d force(double t, double dt, const Eigen::Vector3d& position, const Eigen::Vector3d& velocity) noexcept;
  double duration() const { return end_; }  ///< [s]
  /// Where the hand wants to be [m].
  Eigen::Vector3d intended(double t) const noexcept;
  /// With what force it wants to press [N].
  double pressure(double t) const noexcept;

private:
  struct Leg
  {
    double begin, duration;
    Eigen::Vector3d from, to;
    double force_before, force;
  };
  const Leg& legAt(double t) const noexcept;

  Eigen::Vector3d press_;
  TeacherHabits habits_;
  double drag_;
  std::vector<Leg> legs_;
  double end_ = 0.0;
  phri_core::Random random_;
  Eigen::Vector3d wander_ = Eigen::Vector3d::Zero();
  double force_wander_ = 0.0;
};
}  // namespace phri_sim
