#include "phri_sim/planar_stage.hpp"

#include <cmath>

#include "phri_sim/human_partner.hpp"

namespace phri_sim
{
namespace
{
constexpr double kReach = 0.02;         // [m] along a path that one may be ahead or back within a tick
constexpr double kSettledSpeed = 0.02;  // [m/s] at the goal: arrived, not passing through

std::shared_ptr<const Route> routeOf(const Experiment& experiment, const Participant& person)
{
  return std::make_shared<const Route>(planRoute(*experiment.scene, person.clearance));
}

class SimulatedHand : public Hand
{
public:
  SimulatedHand(const Experiment& experiment, const Participant& person, const TrialSpec& spec)
    : human_(experiment.scene, routeOf(experiment, person), person, spec.practice, experiment.loop.mass(0),
             experiment.loop.damping(0), spec.seed, experiment.pace),
      let_go_(experiment.letsGo(spec.trial))
  {
  }
  HandForce act(const HandleState& handle) noexcept override
  {
    HandForce out;
    if (handle.t >= let_go_)
      return out;
    out.force = human_.step(handle.t, handle.position, handle.velocity, handle.robot_force, *handle.obstacles);
    return out;
  }

private:
  HumanPartner human_;
  double let_go_;  // [s]
};
}  // namespace

PlanarStage::PlanarStage(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec,
                         std::unique_ptr<Hand> hand)
  : experiment_(std::move(experiment)),
    obstacles_(obstaclesOfTrial(*experiment_->scene, spec.seed)),
    device_(experiment_->sensors, experiment_->scene->start, spec.seed),
    hand_(std::move(hand))
{
  const Participant person = experiment_->population.person(spec.study_seed, spec.participant);
  if (!hand_)
    hand_ = std::make_unique<SimulatedHand>(*experiment_, person, spec);
  if (!experiment_->scene->path.empty())
    path_ = planRoute(*experiment_->scene, person.clearance);
}

phri_core::Measurement PlanarStage::read(std::int64_t now_ns, const phri_core::VectorDof& assistance) noexcept
{
  const double dt = experiment_->loop.dt, t = std::llround(now_ns / (1e9 * dt)) * dt;
  const Eigen::Vector2d x = device_.position(), v = device_.velocity();
  const HandForce hand = hand_->act({ t, x, v, assistance, &obstacles_ });
  const Eigen::Vector2d contact = contactForce(*experiment_->scene, obstacles_, x, v, t);
  phri_core::Measurement measurement = device_.read(hand.force, contact, now_ns);
  if (hand.sensed)
  {
    measurement.human_wrench = hand.force;
    measurement.receive_ns = now_ns - hand.age_ns;
    measurement.stamp_ns = now_ns - hand.stamp_age_ns;
    measurement.sequence = hand.sequence;
    measurement.frame = hand.frame;
  }
  return measurement;
}

void PlanarStage::write(const phri_core::Command& command) noexcept
{
  device_.write(command);
  const Scene& scene = *experiment_->scene;
  arrived_ = (device_.position() - scene.goal).norm() < scene.goal_radius && device_.velocity().norm() < kSettledSpeed;
  if (path_)
  {
    progress_ = path_->project(device_.position(), progress_, kReach);
    arrived_ = arrived_ && path_->length() - progress_ < kReach;
  }
}
}  // namespace phri_sim
