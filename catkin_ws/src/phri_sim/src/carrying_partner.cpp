#include "phri_sim/carrying_partner.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace phri_sim
{
namespace
{
using Eigen::Vector2d;
using Eigen::Vector3d;
constexpr double kDt = 0.001;
constexpr double kGravity = 9.81;
constexpr double kTissue = 0.005;  // [s] M6 over the dashpot that carries it
const double kTissueBlend = 1.0 - std::exp(-kDt / kTissue);
constexpr double kLateralMass = 0.65;                 // of the fore-aft reflected mass
constexpr double kYawInertia = 0.5;                   // of that about roll and pitch
constexpr double kVisualTime = 0.25;                  // [s] D_v / K_v
constexpr double kReach = 0.25;                       // [m] of the hand around where the body carries it
constexpr double kReachTime = 0.5;                    // [s] in which the body gets used to where the load is
constexpr double kLow = 0.9, kHigh = 1.1;             // [m] comfortable heights of the grasp
constexpr double kTorqueLag = 0.010;                  // [s] torques come later than forces
constexpr double kHelpMemory = 0.5;                   // [s] in which a steady help becomes expected
constexpr double kVariationTime = 0.12;               // [s] correlation time of the signal-dependent noise
constexpr double kFollowDamping = 40.0;               // D_f [Ns/m]
constexpr double kFollowTurnDamping = 1.0;            // D_f [Nms/rad]
constexpr double kFollowGain = 0.3;                   // K_f
constexpr double kFollowMemory = 0.1;                 // [s]
constexpr double kTriggerTime = 0.3;                  // [s] before setting off
constexpr double kFastest = 1.15;                     // of the pace, when the load runs ahead
constexpr double kSpeedUp = 0.1, kSlowDown = 0.3;     // [m/s2] along the path
constexpr double kPaceTime = 0.3, kStrideTime = 0.1;  // [s] speed and its rate follow what is wanted
constexpr double kTolerated = 0.04;                   // [m] of lag that bothers nobody
constexpr double kNormalWalk = 0.5;  // [m/s] at which the gait has the amplitudes of the traits; slower is less
constexpr double kArrived = 0.002;   // [m] before the end of the path
constexpr double kFirstBend = 0.2;   // [1/m] of curvature count as a bend

std::size_t ticks(double seconds)
{
  return std::size_t(std::clamp(std::lround(seconds / kDt), 0L, 511L));
}

double blend(double seconds)
{
  return std::min(1.0, kDt / std::max(seconds, 1e-9));
}

/// Rotation vector of a rotation matrix [rad].
Vector3d rotationVector(const Eigen::Matrix3d& rotation)
{
  const Eigen::AngleAxisd turn(rotation);
  return std::remainder(turn.angle(), 2.0 * M_PI) * turn.axis();
}

/// Both halves of a 6-vector turned by `yaw` about z.
Vector6 turned(const Vector6& v, double yaw)
{
  const double c = std::cos(yaw), s = std::sin(yaw);
  Vector6 w;
  w << c * v(0) - s * v(1), s * v(0) + c * v(1), v(2), c * v(3) - s * v(4), s * v(3) + c * v(4), v(5);
  return w;
}
}  // namespace

void CarryingPartner::Line::push(const Vector6& value) noexcept
{
  newest = (newest + 1) % values.size();
  values[newest] = value;
}

const Vector6& CarryingPartner::Line::before(std::size_t steps) const noexcept
{
  return values[(newest + values.size() - steps) % values.size()];
}

CarryingPartner::CarryingPartner(CarryingPlan plan, const CarriedObject& object, const CarryingPerson& person,
                                 std::uint64_t trial_seed)
  : plan_(std::move(plan)),
    object_(object),
    person_(person),
    random_(phri_core::Random::stream(trial_seed, "carrying partner"))
{
  std::ostringstream errors;
  if (!plan_.path)
    errors << "; no path";
  if (!(object.grasp_distance > 0.0))
    errors << "; grasps " << object.grasp_distance << " m apart: expected more than 0";
  if (!(object.mass >= 0.0) || !(object.rendered_mass >= 0.0) || !(object.rendered_inertia >= 0.0))
    errors << "; mass " << object.mass << " kg, rendered mass " << object.rendered_mass << " kg, rendered inertia "
           << object.rendered_inertia << " kgm2: expected none below 0";
  if (!errors.str().empty())
    throw std::invalid_argument("carrying partner: " + errors.str().substr(2));

  mood_ = std::exp(0.03 * random_.normal());  // nobody is equally fast in every trial
  pace_ = paceAlong(*plan_.path, { mood_ * person.speed, person.curvature_exponent });
  yaw_ = trailingYaw(*plan_.path, object.grasp_distance, plan_.initial_yaw);
  for (double s = 0.0; s < plan_.path->length() && side_ == 0.0; s += WalkingPath::kStep)
    if (const double bend = plan_.path->at(s).curvature; std::abs(bend) > kFirstBend)
      side_ = bend > 0.0 ? 1.0 : -1.0;

  const double forward = person.stiffness_forward, about = person.stiffness_yaw;
  stiffness_ << forward, forward * person.stiffness_lateral, forward * person.stiffness_vertical,
      about * person.stiffness_roll, about * person.stiffness_pitch, about;
  inertia_ << person.hand_mass, kLateralMass * person.hand_mass, person.hand_mass, person.hand_inertia,
      person.hand_inertia, kYawInertia * person.hand_inertia;
  damping_ = 2.0 * person.damping_ratio * (stiffness_.array() * inertia_.array()).sqrt();
  reflex_ticks_ = ticks(person.reflex_delay);
  visual_ticks_ = ticks(person.visual_delay);
  for (Vector6* state : { &muscle_first_, &muscle_, &hand_velocity_, &variation_, &felt_, &heard_, &last_ })
    state->setZero();
  gait_phase_ = random_.uniform(0.0, 2.0 * M_PI);
  tremor_rate_ = 2.0 * M_PI * random_.uniform(8.0, 12.0);
  tremor_phase_ = random_.uniform(0.0, 2.0 * M_PI);
  intention_.role = person.leading;
}

/// Where body and hand want to be now.
void CarryingPartner::walk(double t, const FarEnd& end) noexcept
{
  Intention& now = intention_;
  const Vector6& seen = place_.before(visual_ticks_);  // and carried forward over the delay
  const Vector2d load = seen.head<2>() + double(visual_ticks_) * kDt * seen.segment<2>(3);
  const PathPoint place = plan_.path->at(now.s);
  const Vector2d tangent(std::cos(place.heading), std::sin(place.heading)), left(-tangent(1), tangent(0));
  const Vector2d away = load - place.position;

  now.arrived = now.s > plan_.path->length() - kArrived;
  double wanted = 0.0;
  if (t >= plan_.go && !now.arrived)
  {
    const double lead = tangent.dot(away), noticed = lead > 0.0 ? lead : std::min(0.0, lead + kTolerated);
    wanted = pace_.at(now.s) * std::clamp(1.0 + noticed / person_.patience, 0.0, kFastest);
  }
  const double change = std::clamp((wanted - now.speed) / kPaceTime, -kSlowDown, kSpeedUp);
  rate_ += kDt / kStrideTime * (change - rate_);
  now.speed = std::max(0.0, now.speed + kDt * rate_);
  now.s = std::min(plan_.path->length(), now.s + kDt * now.speed);

  // the body gives way to where the load is as far as it follows, and no farther than the arms reach
  Vector2d reach = (1.0 - std::min(1.0, now.role)) * away;
  if (reach.norm() > kReach)
    reach *= kReach / reach.norm();
  const Vector2d reach_rate = (reach - reach_) / kReachTime;
  reach_ += kDt * reach_rate;

  const double stride = M_PI * person_.gait_rate, vigour = std::min(1.0, now.speed / kNormalWalk);
  gait_phase_ += kDt * stride;
  const double sway = vigour * person_.gait_sway, bob = vigour * person_.gait_bob;
  const PathMotion walked = plan_.path->motion(now.s, now.speed, rate_);
  now.walked = walked.position;
  now.position << walked.position + reach_ + sway * std::sin(gait_phase_) * left,
      height_ + bob * std::sin(2.0 * gait_phase_);
  now.velocity << walked.velocity + reach_rate + sway * stride * std::cos(gait_phase_) * left,
      2.0 * bob * stride * std::cos(2.0 * gait_phase_);
  const double yaw_rate = yaw_.slope(now.s) * now.speed;
  yaw_acceleration_ += kDt / 0.03 * ((yaw_rate - now.yaw_rate) / kDt - yaw_acceleration_);
  now.yaw = yaw_.at(now.s);
  now.yaw_rate = yaw_rate;
  acceleration_ = walked.acceleration;
  walking_ = walked.velocity;

  const double strength = last_.head<2>().norm();
  const double counter =
      strength > 0.1 ? std::max(0.0, -last_.head<2>().dot(end.robot_wrench.head<2>()) / strength) : 0.0;
  role_ += blend(person_.decision_delay) * (std::min(1.0, counter / person_.yield_force) - role_);
}

/// The person's share of what moves object and rendered object as intended, by force alone: it turns the object by its
/// lever.
Vector2d CarryingPartner::feedForward() const noexcept
{
  const double yaw = intention_.yaw, rate = intention_.yaw_rate, lever = object_.grasp_distance;
  const Vector2d axis(std::cos(yaw), std::sin(yaw)), left(-axis(1), axis(0));
  const Vector2d near_velocity = walking_ - lever * rate * left;
  const Vector2d near_acceleration = acceleration_ - lever * yaw_acceleration_ * left + lever * rate * rate * axis;
  const double turning = object_.rendered_inertia * yaw_acceleration_ + object_.rendered_turn_damping * rate;
  return object_.rendered_mass * near_acceleration + object_.rendered_damping * near_velocity +
         0.5 * object_.mass * acceleration_ + turning / lever * left;
}

Vector6 CarryingPartner::withNoise(const Vector6& wrench, double t) noexcept
{
  const double decay = kDt / kVariationTime, drive = std::sqrt(2.0 * decay);
  const double force = person_.force_variation * wrench.head<3>().norm(),
               torque = person_.force_variation * wrench.tail<3>().norm();
  Vector6 noisy = wrench;
  for (int i = 0; i < 6; ++i)
  {
    variation_(i) += -decay * variation_(i) + drive * random_.normal();
    noisy(i) += (i < 3 ? force : torque) * variation_(i) +
                (i < 3 ? person_.force_noise : person_.torque_noise) * random_.normal();
  }
  const double phase = tremor_rate_ * t + tremor_phase_;
  noisy.head<3>() += person_.tremor * Vector3d(std::sin(phase), std::sin(phase + 1.0), std::sin(phase + 2.0));
  return noisy;
}

Vector6 CarryingPartner::bounded(const Vector6& wrench, const Vector3d& axis) noexcept
{
  Vector6 held = wrench;
  const double pull = axis.dot(held.head<3>());
  intention_.slipping = std::abs(pull) > person_.grip_max;
  if (intention_.slipping)
    held.head<3>() += (std::copysign(person_.grip_max, pull) - pull) * axis;
  const double force = held.head<3>().norm(), torque = held.tail<3>().norm();
  if (force > person_.force_max)
    held.head<3>() *= person_.force_max / force;
  if (torque > person_.torque_max)
    held.tail<3>() *= person_.torque_max / torque;
  return held;
}

Vector6 CarryingPartner::step(double t, const FarEnd& end) noexcept
{
  Vector6 place, weight = Vector6::Zero();
  place << end.position, end.velocity.head<3>();
  weight(2) = person_.weight_share * object_.mass * kGravity;
  if (!started_)  // takes the object where it is, and has its weight
  {
    height_ = std::clamp(end.position(2), kLow, kHigh);
    place_.values.fill(place);
    muscle_first_ = muscle_ = weight;
    hand_velocity_ = end.velocity;
  }
  place_.push(place);
  walk(t, end);
  felt_ += kDt / kHelpMemory * (end.robot_wrench - felt_);
  heard_ += kDt / kFollowMemory * (end.robot_wrench - heard_);

  // all in the axes of the intended yaw
  const double yaw = intention_.yaw;
  Vector6 error, rate;
  error << intention_.position - end.position,
      rotationVector(Eigen::AngleAxisd(yaw, Vector3d::UnitZ()) * end.rotation.transpose());
  rate << intention_.velocity, 0.0, 0.0, intention_.yaw_rate;
  error = turned(error, -yaw);
  rate = turned(rate - end.velocity, -yaw);
  if (!started_)
  {
    error_.values.fill(error);
    error_rate_.values.fill(rate);
    started_ = true;
  }
  error_.push(error);
  error_rate_.push(rate);

  const double given = role_ * person_.yielding;
  Vector6 leads, firm;  // per axis; nobody follows with the height
  leads << person_.leading, person_.leading, 1.0, 1.0, 1.0, person_.turning;
  firm << 1.0 - given, 1.0 - given, 1.0, 1.0, 1.0, 1.0 - given;
  leads = leads.cwiseProduct(firm);
  intention_.role = leads(0);

  Vector6 lead = person_.reflex_share * stiffness_.cwiseProduct(error_.before(reflex_ticks_));
  lead.head<2>() += person_.visual_stiffness *
                    (error_.before(visual_ticks_) + kVisualTime * error_rate_.before(visual_ticks_)).head<2>();
  Vector6 load = Vector6::Zero();
  const double share = 0.3 + 0.4 * std::min(1.0, leads(0));  // beta_h: .3 of a follower, .7 of a leader
  load.head<2>() = share * (feedForward() - felt_.head<2>());
  lead += turned(load, -yaw);
  Vector6 follow = kFollowGain * turned(heard_, -yaw);
  const Vector6 moving = turned(end.velocity, -yaw);
  follow.head<3>() -= kFollowDamping * moving.head<3>();
  follow.tail<3>() -= kFollowTurnDamping * moving.tail<3>();
  Vector6 effort = leads.cwiseProduct(lead) + (Vector6::Ones() - leads).cwiseMax(0.0).cwiseProduct(follow);
  if (const double before = plan_.go - t; before > 0.0 && before < kTriggerTime)
    effort(5) += side_ * person_.trigger * std::pow(std::sin(M_PI * before / kTriggerTime), 2);

  const Vector6 drive = turned(effort, yaw) + weight;
  const double lag = blend(person_.muscle_lag),
               slow = blend(person_.muscle_lag > 0.0 ? person_.muscle_lag + kTorqueLag : 0.0);
  for (int i = 0; i < 6; ++i)
  {
    muscle_first_(i) += (i < 3 ? lag : slow) * (drive(i) - muscle_first_(i));
    muscle_(i) += (i < 3 ? lag : slow) * (muscle_first_(i) - muscle_(i));
  }

  Vector6 arm = (1.0 - person_.reflex_share) * stiffness_.cwiseProduct(error) + damping_.cwiseProduct(rate);
  arm = firm.cwiseProduct(arm);
  const Vector6 dragged = kTissueBlend * (end.velocity - hand_velocity_);  // impulse = change of the hand's momentum
  hand_velocity_ += dragged;
  arm -= inertia_.cwiseProduct(turned(dragged, -yaw)) / kDt;
  last_ = turned(arm, yaw) + muscle_;
  return bounded(turned(withNoise(turned(last_, -yaw), t), yaw), end.rotation.col(0));
}
}  // namespace phri_sim
