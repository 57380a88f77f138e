#include "phri_sim/human_partner.hpp"

#include <algorithm>
#include <cmath>

namespace phri_sim
{
namespace
{
using Eigen::Vector2d;
constexpr double kDt = 0.001;
constexpr double kReaction = 0.3;          // [s] after the go
constexpr double kReference = 10.0;        // k_1 [1/m] curvature at which the pace is the comfortable one
constexpr double kStraight = 5.0;          // k_0 [1/m] less curvature makes nobody faster
constexpr double kFastest = 1.8;           // of the comfortable speed
constexpr double kAcceleration = 0.15;     // [m/s2] along the route
constexpr double kCatchUp = 0.4;           // [s] in which a person is back at the dot of an exemplary run
constexpr double kSideRate = 7.0;          // [1/s] critically damped: a dodge takes about half a second
constexpr double kSideAcceleration = 0.4;  // [m/s2] nobody jerks 90 kg aside
constexpr double kLookAhead = 0.8;         // [s]
constexpr int kDecision = 200;             // [ticks] between decisions: 5 Hz
constexpr double kObstacleMargin = 0.008;  // [m] wanted between object and obstacle
constexpr double kObstacleSeen = 0.003;    // [m] standard deviation of a seen obstacle's place
constexpr double kHelpMemory = 0.5;        // [s] in which a steady help becomes expected
constexpr double kVariationTime = 0.12;    // [s] correlation time of the signal-dependent noise
constexpr double kFollowDamping = 40.0;    // [Ns/m] of a person who gives in

std::size_t ticks(double seconds)
{
  return std::size_t(std::lround(seconds / kDt));
}

Vector2d leftOf(const Vector2d& tangent)
{
  return { -tangent(1), tangent(0) };
}
}  // namespace

Intention::Intention(std::shared_ptr<const Scene> scene, std::shared_ptr<const Route> route, const Participant& person,
                     std::uint64_t trial_seed, double pace)
  : scene_(std::move(scene)),
    route_(std::move(route)),
    person_(person),
    random_(phri_core::Random::stream(trial_seed, "intention"))
{
  for (std::size_t k = 0; k < wander_phase_.size(); ++k)
  {
    wander_phase_[k] = random_.uniform(0.0, 2.0 * M_PI);
    wander_amplitude_[k] = person_.wander * random_.normal();
  }
  const double mood = std::exp(0.05 * random_.normal());  // nobody is equally fast in every trial
  const std::size_t n = route_->points.size();
  pace_.resize(n);
  for (std::size_t k = 0; k < n; ++k)
  {
    const double bend = std::max(std::abs(route_->curvature[k]), kStraight) / kReference;
    const double comfortable = mood * person_.speed * std::pow(bend, -person_.curvature_exponent);
    const double width = 2.0 * std::max(route_->clearance[k], 0.001);
    pace_[k] = std::min({ comfortable, kFastest * person_.speed, width / person_.steering });
  }
  pace_.front() = std::min(pace_.front(), 0.01);
  pace_.back() = 0.005;
  for (std::size_t k = n - 1; k-- > 0;)  // brake in time for what comes
    pace_[k] = std::min(pace_[k], std::sqrt(pace_[k + 1] * pace_[k + 1] + 2.0 * kAcceleration * route_->step));
  for (std::size_t k = 1; k < n; ++k)
    pace_[k] = std::min(pace_[k], std::sqrt(pace_[k - 1] * pace_[k - 1] + 2.0 * kAcceleration * route_->step));
  position = route_->points.front();
  if (pace > 0.0)
    dot_.emplace(*route_, pace);
}

double Intention::pace(double s) const
{
  return route_->interpolate(pace_, s);
}

void Intention::decide(double t, const std::vector<MovingObstacle>& obstacles)
{
  constexpr int kInstants = 8;
  constexpr std::array<double, 4> kPaces = { 1.0, 0.6, 0.25, 0.0 };
  const double seen_at = std::max(0.0, t - person_.decision_delay);
  std::vector<Vector2d> seen, moving;
  for (const MovingObstacle& obstacle : obstacles)
  {
    seen.push_back(obstacle.position(seen_at) + kObstacleSeen * Vector2d(random_.normal(), 0.0));
    moving.push_back(obstacle.velocity(seen_at));
  }
  double best = 1e30;
  for (int side = -4; side <= 4; ++side)
    for (const double factor : kPaces)
    {
      const double offset = 0.01 * side;
      double cost = 0.5 * side * side * 0.04 + 1.5 * (1.0 - factor) + 400.0 * std::pow(offset - chosen_offset_, 2);
      for (int k = 1; k <= kInstants; ++k)
      {
        const double ahead = kLookAhead * k / kInstants;
        const double s = s_ + factor * pace(s_) * ahead, blend = std::min(1.0, ahead / 0.4);
        const Vector2d x = route_->position(s) + leftOf(route_->tangent(s)) * (offset_ + blend * (offset - offset_));
        const double wall = scene_->clearance(x);
        // a wall is avoided as on the route itself: nearer than there, or than 4 mm, is bad
        const double wanted = std::min(0.004, route_->interpolate(route_->clearance, s));
        cost += 2e6 * std::pow(std::max(0.0, wanted - wall), 2);
        for (std::size_t i = 0; i < seen.size(); ++i)
        {
          const Vector2d relative =
              (x - seen[i] - moving[i] * (t - seen_at + ahead)).cwiseAbs() - obstacles[i].half_size;
          const double gap = relative.maxCoeff() > 0.0 ? relative.cwiseMax(0.0).norm() : relative.maxCoeff();
          cost += 3e5 * std::pow(std::max(0.0, kObstacleMargin + scene_->object_radius - gap), 2);
        }
      }
      if (cost < best)
      {
        best = cost;
        chosen_offset_ = offset;
        chosen_pace_ = factor;
      }
    }
}

void Intention::step(double t, const Vector2d& x, const std::vector<MovingObstacle>& obstacles)
{
  if (t < kReaction)
    return;
  // far from any obstacle there is nothing to decide
  if (tick_++ % kDecision == 0)
  {
    bool near = std::abs(chosen_offset_) > 0.0 || chosen_pace_ < 1.0;
    for (const MovingObstacle& obstacle : obstacles)
      near |= (position - obstacle.center).norm() < obstacle.amplitude + obstacle.half_size.norm() + 0.06;
    if (near)
      decide(t, obstacles);
  }
  pace_factor_ += kDt / 0.15 * (chosen_pace_ - pace_factor_);
  // the plan waits for an object that lags and follows one that is carried ahead
  const double lead = route_->project(x, s_, 0.05) - s_;
  double wanted = pace(s_) * pace_factor_ * std::clamp(1.0 + lead / 0.03, 0.0, kFastest);
  if (dot_)  // its speed is seen, its lead is made up for
    wanted = std::max(0.0, (dot_->at(t + 0.5 * kCatchUp) - dot_->at(t - 0.5 * kCatchUp) + dot_->at(t) - s_) / kCatchUp);
  const double change = std::clamp((wanted - s_dot_) / 0.1, -3.0 * kAcceleration, kAcceleration);
  s_dot_ = std::max(0.0, s_dot_ + kDt * change);
  s_ = std::min(route_->length(), s_ + kDt * s_dot_);

  double drift = person_.side_bias;
  for (std::size_t k = 0; k < wander_phase_.size(); ++k)
    drift += wander_amplitude_[k] * std::sin(2.0 * M_PI * (k + 1) * s_ / 0.35 + wander_phase_[k]);
  const double room = route_->interpolate(route_->clearance, s_), end = std::min(1.0, (route_->length() - s_) / 0.03);
  drift *= std::clamp(room / 0.02, 0.0, 1.0) * std::min({ 1.0, s_ / 0.03, end });
  const double pull = kSideRate * kSideRate * (chosen_offset_ + drift - offset_) - 2.0 * kSideRate * offset_dot_;
  offset_dot_ += kDt * std::clamp(pull, -kSideAcceleration, kSideAcceleration);
  offset_ += kDt * offset_dot_;

  const Vector2d tangent = route_->tangent(s_), last = velocity;
  position = route_->position(s_) + offset_ * leftOf(tangent);
  const double bend = route_->interpolate(route_->curvature, s_);
  velocity = s_dot_ * (1.0 - bend * offset_) * tangent + offset_dot_ * leftOf(tangent);
  acceleration += kDt / 0.03 * ((velocity - last) / kDt - acceleration);
}

HumanPartner::HumanPartner(std::shared_ptr<const Scene> scene, std::shared_ptr<const Route> route,
                           const Participant& person, int practice, double mass, double damping,
                           std::uint64_t trial_seed, double pace)
  : person_(person),
    intention_(scene, route, person, trial_seed, pace),
    random_(phri_core::Random::stream(trial_seed, "motor noise")),
    mass_(mass),
    damping_(damping),
    gain_(person.internalModelAfter(practice))
{
  const double stiffness = person.stiffnessAfter(practice);
  reflex_stiffness_ = 0.5 * stiffness;
  reflex_damping_ = 2.0 * person.damping_ratio * std::sqrt(stiffness * person.hand_mass);
  const double angle = M_PI / 2.0 + person.stiffness_angle;
  Eigen::Matrix2d axes;
  axes << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  intrinsic_ = 0.5 * stiffness * axes * Vector2d(1.0, person.stiffness_ratio).asDiagonal() * axes.transpose();
  x_.fill(intention_.position);
  x_desired_.fill(intention_.position);
  v_.fill(Vector2d::Zero());
  v_desired_.fill(Vector2d::Zero());
  tremor_rate_ = 2.0 * M_PI * random_.uniform(8.0, 12.0);
  tremor_phase_ = random_.uniform(0.0, 2.0 * M_PI);
}

Vector2d HumanPartner::noise(const Vector2d& force, double t)
{
  const double decay = kDt / kVariationTime, drive = std::sqrt(2.0 * decay);
  Vector2d noisy = force;
  for (int i = 0; i < 2; ++i)
  {
    variation_(i) += -decay * variation_(i) + drive * random_.normal();
    noisy(i) += person_.force_variation * variation_(i) * force.norm() + person_.force_noise * random_.normal();
  }
  const double phase = tremor_rate_ * t + tremor_phase_;
  return noisy + person_.tremor * Vector2d(std::sin(phase), std::sin(phase + 1.0));
}

Vector2d HumanPartner::step(double t, const Vector2d& x, const Vector2d& v, const Vector2d& robot_force,
                            const std::vector<MovingObstacle>& obstacles)
{
  x_.push(x);
  v_.push(v);
  const std::size_t reflex = ticks(person_.reflex_delay), visual = ticks(person_.visual_delay);
  const Vector2d seen = x_.before(visual) + person_.visual_delay * v_.before(visual);
  intention_.step(t, seen, obstacles);
  x_desired_.push(intention_.position);
  v_desired_.push(intention_.velocity);

  expected_help_ += kDt / kHelpMemory * (robot_force - expected_help_);
  const Vector2d feed_forward =
      gain_ * (damping_ * intention_.velocity + mass_ * intention_.acceleration - expected_help_);
  const Vector2d fast = reflex_stiffness_ * (x_desired_.before(reflex) - x_.before(reflex)) +
                        reflex_damping_ * (v_desired_.before(reflex) - v_.before(reflex));
  const Vector2d slow = person_.visual_stiffness * (x_desired_.before(visual) - x_.before(visual)) +
                        person_.visual_damping * (v_desired_.before(visual) - v_.before(visual));
  const double lag = kDt / person_.muscle_lag;
  muscle_first_ += lag * (feed_forward + fast + slow - muscle_first_);
  muscle_ += lag * (muscle_first_ - muscle_);
  Vector2d force = intrinsic_ * (intention_.position - x) + muscle_;

  // the partner's counter-pull changes the role: give in (kappa > 0) or fight (kappa < 0)
  const double strength = last_force_.norm();
  const double counter = strength > 0.1 ? std::max(0.0, -last_force_.dot(robot_force) / strength) : 0.0;
  role_ += kDt / person_.decision_delay * (std::min(1.0, counter / person_.yield_force) - role_);
  const double given = role_ * person_.yielding;
  force = (1.0 - given) * force - std::max(0.0, given) * kFollowDamping * v;

  const double norm = force.norm();
  if (norm > person_.force_max)
    force *= person_.force_max / norm;
  last_force_ = force;
  return noise(force, t);
}
}  // namespace phri_sim
