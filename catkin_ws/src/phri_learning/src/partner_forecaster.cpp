#include <algorithm>
#include <cmath>
#include <utility>

#include "partner_state.hpp"

namespace phri_learning
{
namespace
{
/// Grid steps of a forecast: the horizon, and one more for observations after the latest sample.
int gridSteps(const EmergingOptions& options)
{
  return static_cast<int>(std::ceil(options.horizon / options.dt - 1e-9)) + 1;
}
}  // namespace

PartnerForecaster::PartnerForecaster(const EmergingOptions& options)
  : options_(options), recogniser_({}, options.recogniser)
{
  const Eigen::Index d = 3 * options_.dof, count = gridSteps(options_) + 1;
  settings_.reference = Reference::kPath;
  settings_.time = options_.time;
  joint_ = { Eigen::VectorXd::Zero(d), Eigen::MatrixXd::Zero(d, d) };
  nodes_.assign(static_cast<std::size_t>(count), joint_);
  earlier_ = difference_ = Eigen::MatrixXd::Zero(d, count);
  offset_ = Eigen::VectorXd::Zero(d);
}

void PartnerForecaster::reset()
{
  recogniser_.reset();
  active_ = -1;
  fading_ = rival_samples_ = 0;
}

int PartnerForecaster::primitive() const
{
  return active_ < 0 ? -1 : learned_->primitives[static_cast<std::size_t>(active_)].node;
}

double PartnerForecaster::primitiveTime() const
{
  if (active_ < 0)
    return 0.0;
  const std::size_t i = static_cast<std::size_t>(active_);
  return recogniser_.entries()[i].time - learned_->primitives[i].window.begin;
}

void PartnerForecaster::observe(const SegmentMemory& memory)
{
  if (!learned_)
    return;
  const auto sample = memory.before(0);
  recogniser_.filter(sample.head(recognisedDimensions(options_.recognition, options_.dof)));
  const int winner = settled(current());
  const bool changed = winner != active_, was_known = active_ >= 0;
  fading_ = std::max(0, fading_ - 1);
  if (changed)
    follow(winner, memory);
  else if (active_ >= 0)
    track(sample);
  if (active_ < 0)
  {
    fading_ = 0;
    return;
  }
  forecast(changed && was_known ? 1 : -1);
}

void PartnerForecaster::adopt(std::shared_ptr<const LearnedPrimitives> learned, const SegmentMemory& memory)
{
  const bool was_known = active_ >= 0;
  std::vector<RecognisedModel> models;
  std::vector<TimeTracker> trackers;
  std::vector<DisplacementMixture> mixtures;
  const int recognised = recognisedDimensions(options_.recognition, options_.dof);
  for (const LearnedPrimitive& primitive : learned->primitives)
  {
    models.push_back({ primitive.recognised, primitive.typical });
    if (options_.reference == Reference::kDisplacement)
      mixtures.emplace_back(primitive.displacement);
    else
      trackers.emplace_back(primitive.window.hmm, options_.recogniser.window,
                            recognisedDimensions(options_.progress, options_.dof));
  }
  recogniser_ = PrimitiveRecogniser(std::move(models), options_.recogniser);
  trackers_ = std::move(trackers);
  mixtures_ = std::move(mixtures);
  learned_ = std::move(learned);
  for (int back = static_cast<int>(std::min<std::int64_t>(memory.samples(), memory.window())) - 1; back >= 0; --back)
    recogniser_.filter(memory.before(back).head(recognised));
  active_ = -1;
  rival_samples_ = 0;
  if (recogniser_.winner() < 0)
  {
    fading_ = 0;
    return;
  }
  follow(current(), memory);
  forecast(was_known ? 0 : -1);
}

/// The primitive that the likeliest state belongs to: the recognised one, or the neighbour whose end or beginning its
/// window HMM holds. Every forecast is then made by the window that is centred there, far from the ends of its model.
int PartnerForecaster::current() const
{
  const int winner = recogniser_.winner();
  if (winner < 0)
    return -1;
  const LearnedPrimitive& primitive = learned_->primitives[static_cast<std::size_t>(winner)];
  const int state = recogniser_.entries()[static_cast<std::size_t>(winner)].state - primitive.window.before;
  const int node = state < 0                          ? primitive.predecessor
                   : state >= primitive.own->states() ? primitive.successor
                                                      : primitive.node;
  const auto found = std::find_if(learned_->primitives.begin(), learned_->primitives.end(),
                                  [node](const LearnedPrimitive& p) { return p.node == node; });
  return static_cast<int>(found - learned_->primitives.begin());
}

/// Follows `now` once it has been the same for as long as a recognised model takes to be confirmed.
int PartnerForecaster::settled(int now)
{
  rival_samples_ = now == active_ ? 0 : now == rival_ ? rival_samples_ + 1 : 1;
  rival_ = now;
  return now < 0 || active_ < 0 || rival_samples_ >= options_.recogniser.confirm ? now : active_;
}

/// Another primitive: its model looks back at the samples of the window.
void PartnerForecaster::follow(int active, const SegmentMemory& memory)
{
  active_ = active;
  if (active_ < 0)
    return;
  const std::size_t i = static_cast<std::size_t>(active_);
  if (options_.reference == Reference::kDisplacement)
    mixtures_[i].reset();
  else
    trackers_[i].reset();
  for (int back = static_cast<int>(std::min<std::int64_t>(memory.samples(), memory.window())) - 1; back >= 0; --back)
    track(memory.before(back));
}

void PartnerForecaster::track(const Eigen::Ref<const Eigen::VectorXd>& sample)
{
  const std::size_t i = static_cast<std::size_t>(active_);
  if (options_.reference == Reference::kDisplacement)
    mixtures_[i].observe(sample, sample.segment(options_.dof, options_.dof));
  else
    trackers_[i].observe(sample);
}

/// `age`: samples since the earlier forecast that this one has to join smoothly; -1: there is none.
void PartnerForecaster::forecast(int age)
{
  const std::size_t i = static_cast<std::size_t>(active_), count = nodes_.size();
  const bool displacement = options_.reference == Reference::kDisplacement;
  const auto column = [](std::size_t k) { return static_cast<Eigen::Index>(k); };
  if (age >= 0)
    for (std::size_t k = 0; k < count; ++k)
      earlier_.col(column(k)) = nodes_[k].mean;
  for (std::size_t k = 0; k < count; ++k)
  {
    const double ahead = static_cast<double>(k) * options_.dt;
    if (displacement)
      mixtures_[i].forecast(ahead, &nodes_[k]);
    else
      trackers_[i].forecast(ahead, settings_, &nodes_[k]);
  }
  if (age >= 0)
  {
    const Eigen::Index last = column(count) - 1;
    for (Eigen::Index k = 0; k <= last; ++k)
    {
      if (k + age <= last)
        difference_.col(k) = earlier_.col(k + age);
      else  // the earlier one ends here: goes on as it ended
        difference_.col(k) = 2.0 * earlier_.col(last) - earlier_.col(last - 1);
      difference_.col(k) -= nodes_[static_cast<std::size_t>(k)].mean;
    }
    fading_ = options_.blend;
  }
  if (fading_ > 0)
  {
    const double share = static_cast<double>(fading_) / (options_.blend + 1);
    for (std::size_t k = 0; k < count; ++k)
      nodes_[k].mean += share * difference_.col(column(k));
  }
}

void PartnerForecaster::interpolate(double ahead, Eigen::VectorXd* mean) const
{
  const double k = std::clamp(ahead / options_.dt, 0.0, static_cast<double>(nodes_.size() - 1));
  const std::size_t below = std::min(static_cast<std::size_t>(k), nodes_.size() - 2);
  *mean = nodes_[below].mean + (k - static_cast<double>(below)) * (nodes_[below + 1].mean - nodes_[below].mean);
}

const phri_core::Gaussian& PartnerForecaster::at(double ahead, double elapsed, const Eigen::VectorXd& now)
{
  interpolate(ahead, &joint_.mean);
  const double k = std::clamp(ahead / options_.dt, 0.0, static_cast<double>(nodes_.size() - 1));
  const std::size_t below = std::min(static_cast<std::size_t>(k), nodes_.size() - 2);
  const double share = k - static_cast<double>(below);
  joint_.covariance = (1.0 - share) * nodes_[below].covariance + share * nodes_[below + 1].covariance;
  if (options_.reference == Reference::kDisplacement)
  {
    interpolate(elapsed, &offset_);
    joint_.mean += now - offset_;
  }
  return joint_;
}
}  // namespace phri_learning
