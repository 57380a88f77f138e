#include "phri_sim/teaching.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace phri_sim
{
namespace
{
using Eigen::Vector3d;

constexpr double kByFeel = 1.0;  // [N] of intended force from which on the hand goes by feel alone

double minimumJerk(double s)
{
  s = std::clamp(s, 0.0, 1.0);
  return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
}

double minimumJerkRate(double s)
{
  return s <= 0.0 || s >= 1.0 ? 0.0 : 30.0 * s * s * (1.0 - s) * (1.0 - s);
}

Vector3d scatter(phri_core::Random& random, double deviation)
{
  Vector3d value;
  for (int i = 0; i < 3; ++i)
    value(i) = random.normal(0.0, deviation);
  return value;
}
}  // namespace

void addParameters(phri_core::ParameterTable& table, TeacherHabits& h)
{
  table.number("teacher/stiffness", &h.stiffness, "N/m", 10.0, 5000.0, "of the hand about where it wants to be")
      .number("teacher/damping", &h.damping, "Ns/m", 0.0, 1000.0, "of the hand")
      .number("teacher/force_max", &h.force_max, "N", 1.0, 200.0, "of the hand")
      .number("teacher/force_onset", &h.force_onset, "s", 0.05, 5.0, "in which the pressing force changes")
      .number("teacher/pace", &h.pace, "-", 0.0, 0.5, "variation of the pace between demonstrations")
      .number("teacher/duration", &h.duration, "-", 0.0, 0.5, "variation of each leg's duration beside that")
      .number("teacher/force", &h.force, "-", 0.0, 0.5, "variation of the pressing force between demonstrations")
      .number("teacher/start", &h.start, "m", 0.0, 0.05, "scatter of the first position, per axis")
      .number("teacher/tremor", &h.tremor, "m", 0.0, 0.02, "slow wandering of the hand")
      .number("teacher/force_tremor", &h.force_tremor, "-", 0.0, 0.5, "slow wandering of the pressing force")
      .number("teacher/tremor_time", &h.tremor_time, "s", 0.05, 10.0, "correlation time of both");
}

Teacher::Teacher(const TaughtMotion& motion, const TeacherHabits& habits, double drag, const Vector3d& start,
                 std::uint64_t seed, int index)
  : press_(motion.press),
    habits_(habits),
    drag_(drag),
    random_(phri_core::Random::stream(seed, "teacher", std::uint64_t(index)))
{
  if (motion.legs.empty())
    throw std::invalid_argument("teacher: the motion has no leg; expected at least one");
  const double pace = random_.logNormal(1.0, habits.pace), vigour = random_.logNormal(1.0, habits.force);
  Vector3d from = start;
  double force = 0.0;
  for (std::size_t i = 0; i < motion.legs.size(); ++i)
  {
    const TaughtLeg& leg = motion.legs[i];
    const double duration = leg.duration * pace * random_.logNormal(1.0, habits.duration);
    // who presses or rests stays where he is
    const bool stays = i > 0 && leg.to == motion.legs[i - 1].to;
    const Vector3d to = stays ? from : Vector3d(leg.to + scatter(random_, leg.scatter));
    legs_.push_back({ end_, duration, from, to, force, vigour * leg.force });
    from = to;
    force = legs_.back().force;
    end_ += duration;
  }
}

const Teacher::Leg& Teacher::legAt(double t) const noexcept
{
  std::size_t i = 0;
  while (i + 1 < legs_.size() && t >= legs_[i + 1].begin)
    ++i;
  return legs_[i];
}

Vector3d Teacher::intended(double t) const noexcept
{
  const Leg& leg = legAt(t);
  return leg.from + (leg.to - leg.from) * minimumJerk((t - leg.begin) / leg.duration);
}

double Teacher::pressure(double t) const noexcept
{
  const Leg& leg = legAt(t);
  const double onset = std::min(habits_.force_onset, leg.duration);
  return leg.force_before + (leg.force - leg.force_before) * minimumJerk((t - leg.begin) / onset);
}

Vector3d Teacher::force(double t, double dt, const Vector3d& position, const Vector3d& velocity) noexcept
{
  const double keep = std::exp(-dt / habits_.tremor_time), fresh = std::sqrt(1.0 - keep * keep);
  for (int i = 0; i < 3; ++i)
    wander_(i) = keep * wander_(i) + fresh * random_.normal(0.0, habits_.tremor);
  force_wander_ = keep * force_wander_ + fresh * random_.normal(0.0, habits_.force_tremor);

  const Leg& leg = legAt(t);
  const Vector3d wanted_velocity = (leg.to - leg.from) / leg.duration * minimumJerkRate((t - leg.begin) / leg.duration);
  const Vector3d guiding = habits_.stiffness * (intended(t) + wander_ - position) +
                           habits_.damping * (wanted_velocity - velocity) + drag_ * wanted_velocity;
  const double wanted = pressure(t), feel = minimumJerk(wanted / kByFeel);
  const double pressing = wanted * (1.0 + force_wander_) - habits_.damping * velocity.dot(press_);
  const Vector3d hand = guiding + feel * (pressing - guiding.dot(press_)) * press_;
  const double norm = hand.norm();
  if (!(norm > habits_.force_max))
    return hand;
  return hand * (habits_.force_max / norm);
}
}  // namespace phri_sim
