#include "phri_learning/emerging_partner.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "partner_state.hpp"
#include "phri_core/check.hpp"

namespace phri_learning
{
namespace
{
constexpr double kOnTime = 1e-6;  // [s] by which an observation may miss a sampling time and still be the sample
constexpr int kCatchUp = 4;       // samples that the segmentation takes per sample while it is behind

EmergingOptions checked(EmergingOptions options)
{
  checkOptions(options);
  options.primitives.training.dt = options.dt;
  options.segmentation.dt = options.dt;
  return options;
}
}  // namespace

EmergingPartner::EmergingPartner(const EmergingOptions& options)
  : options_(checked(options)),
    forecaster_(std::make_unique<PartnerForecaster>(options_)),
    memory_(std::make_unique<SegmentMemory>(options_)),
    latest_(Eigen::VectorXd::Zero(3 * options_.dof)),
    previous_(latest_),
    sample_(latest_)
{
}

EmergingPartner::~EmergingPartner() = default;
EmergingPartner::EmergingPartner(EmergingPartner&&) noexcept = default;

void EmergingPartner::reset()
{
  memory_->finish();
  forecaster_->reset();
  samples_ = 0;
}

void EmergingPartner::observe(const phri_core::Observation& observation)
{
  const int dof = options_.dof;
  // reads into place of observationVector, which would allocate
  if (observation.state.size() != 2 * dof || observation.human_wrench.size() != dof || !observation.state.allFinite() ||
      !observation.human_wrench.allFinite())
    observationVector(observation, dof);  // throws
  if (!std::isfinite(observation.t) || (samples_ > 0 && observation.t <= latest_time_))
    throw std::invalid_argument("observation at t = " + std::to_string(observation.t) + " s, expected later than " +
                                (samples_ > 0 ? std::to_string(latest_time_) + " s" : "never") + ", and finite");
  const double before = latest_time_;
  previous_.swap(latest_);
  latest_.head(2 * dof) = observation.state;
  latest_.tail(dof) = observation.human_wrench;
  latest_time_ = observation.t;
  if (samples_ == 0)
    start_time_ = latest_time_;
  for (;;)
  {
    const double next = start_time_ + static_cast<double>(samples_) * options_.dt;
    if (next > latest_time_ + kOnTime)
      return;
    if (next > latest_time_ - kOnTime)
      sample_ = latest_;
    else
      sample_ = previous_ + (next - before) / (latest_time_ - before) * (latest_ - previous_);
    take(next);
  }
}

void EmergingPartner::take(double time)
{
  sample_time_ = time;
  ++samples_;
  memory_->push(sample_, time);
  forecaster_->observe(*memory_);
  memory_->segment(kCatchUp);
}

bool EmergingPartner::predict(double horizon, double dt, phri_core::Prediction* result)
{
  phri_core::requireRange("dt", dt, 1e-6, 1e3, "s");
  phri_core::requireRange("horizon", horizon, 0.0, options_.horizon * (1.0 + 1e-9), "s");
  if (samples_ == 0 || !forecaster_->known())
    return false;
  const std::size_t count = static_cast<std::size_t>(std::lround(horizon / dt)) + 1;
  const Eigen::Index dof = options_.dof;
  result->t0 = latest_time_;
  result->dt = dt;
  result->model = "emerging";
  result->desired_state.resize(count);
  result->human_wrench.resize(count);
  const double ahead = latest_time_ - sample_time_;
  for (std::size_t k = 0; k < count; ++k)
  {
    const phri_core::Gaussian& joint =
        forecaster_->at(ahead + std::min(static_cast<double>(k) * dt, horizon), ahead, latest_);
    phri_core::Gaussian &state = result->desired_state[k], &wrench = result->human_wrench[k];
    state.mean = joint.mean.head(2 * dof);
    state.covariance = joint.covariance.topLeftCorner(2 * dof, 2 * dof);
    wrench.mean = joint.mean.tail(dof);
    wrench.covariance = joint.covariance.bottomRightCorner(dof, dof);
  }
  return true;
}

std::optional<phri_core::Prediction> EmergingPartner::predict(double horizon, double dt)
{
  phri_core::Prediction prediction;
  if (!predict(horizon, dt, &prediction))
    return std::nullopt;
  return prediction;
}

std::vector<CommittedSegment> EmergingPartner::takeSegments()
{
  return memory_->takeSegments();
}

void EmergingPartner::adopt(std::shared_ptr<const LearnedPrimitives> learned)
{
  if (!learned)
    throw std::invalid_argument("adopt: no snapshot given");
  const EmergingOptions& o = learned->options;
  if (o.dt != options_.dt || o.dof != options_.dof || o.reference != options_.reference ||
      o.recognition != options_.recognition)
    throw std::invalid_argument("adopt: the snapshot was learned with another dt, dof, reference or recognition");
  forecaster_->adopt(learned, *memory_);
  learned_ = std::move(learned);
}

int EmergingPartner::primitive() const
{
  return forecaster_->primitive();
}

double EmergingPartner::primitiveTime() const
{
  return forecaster_->primitiveTime();
}

const PrimitiveRecogniser& EmergingPartner::recogniser() const
{
  return forecaster_->recogniser();
}

int EmergingPartner::waitingSegments() const
{
  return memory_->waiting();
}

int EmergingPartner::lostSegments() const
{
  return memory_->lost();
}

int learn(EmergingPartner* partner, PrimitiveLearner* learner)
{
  const std::vector<CommittedSegment> segments = partner->takeSegments();
  for (const CommittedSegment& segment : segments)
    learner->add(segment);
  if (!segments.empty())
    partner->adopt(learner->snapshot());
  return static_cast<int>(segments.size());
}
}  // namespace phri_learning
