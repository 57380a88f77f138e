#include "phri_learning/time_tracker.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "phri_core/check.hpp"

namespace phri_learning
{
TimeTracker::TimeTracker(std::shared_ptr<const TimeHmm> model, int window, int recognised)
  : model_(std::move(model)), window_(window)
{
  if (!model_)
    throw std::invalid_argument("model: none given, expected a trained TimeHmm");
  phri_core::requireRange("window", window_, 1, 1e5, "samples");
  const Eigen::Index states = model_->states(), d = model_->dimension();
  scratch_ = model_->scratch();
  phri_core::requireRange("recognised dimensions", recognised, 0, static_cast<double>(d), "");
  const bool all = recognised == 0 || recognised == d;
  recogniser_ = all ? model_ : std::make_shared<const TimeHmm>(model_->leading(recognised));
  recogniser_scratch_ = recogniser_->scratch();
  emission_.resize(states, window_);
  best_.resize(states);
  run_.resize(states);
  x_.resize(d);
  slope_.resize(d);
  now_.resize(d);
}

void TimeTracker::reset()
{
  samples_ = 0;
  head_ = 0;
  state_ = -1;
  since_entry_ = 0;
}

void TimeTracker::observe(const Eigen::Ref<const Eigen::VectorXd>& x)
{
  if (x.size() != model_->dimension() || !x.allFinite())
  {
    phri_core::requireShape("sample", x, model_->dimension(), 1);
    phri_core::requireFinite("sample", x);
  }
  x_ = x;
  recogniser_->logEmission(x.head(recogniser_->dimension()), &recogniser_scratch_, emission_.col(head_));
  head_ = (head_ + 1) % window_;
  samples_ = std::min(samples_ + 1, window_);

  const int states = model_->states();
  const double* stay = model_->logStay().data();
  const double* next = model_->logNext().data();
  double* best = best_.data();
  int* run = run_.data();
  const int oldest = head_ - samples_ + window_;
  best_ = emission_.col(oldest % window_);
  run_.setZero();
  for (int k = 1; k < samples_; ++k)
  {
    const double* emission = emission_.col((oldest + k) % window_).data();
    for (int i = states - 1; i > 0; --i)
    {
      const double held = best[i] + stay[i], entered = best[i - 1] + next[i - 1];
      run[i] = entered > held ? 0 : run[i] + 1;
      best[i] = std::max(held, entered) + emission[i];
    }
    best[0] += stay[0] + emission[0];
    ++run[0];
  }
  Eigen::Index last = 0;
  best_.maxCoeff(&last);
  const bool fills_window = run[last] == samples_ - 1;
  since_entry_ = fills_window && static_cast<int>(last) == state_ ? since_entry_ + 1 : run[last];
  state_ = static_cast<int>(last);
}

double TimeTracker::time(TimeEstimate estimate, double* variance)
{
  if (!started())
    throw std::invalid_argument("time: no sample observed yet, expected at least 1");
  const double dt = model_->dt(), duration = model_->durations()(state_), center = model_->stateTime(state_);
  double spread = dt * dt * std::max(1.0, duration * duration) / 12.0, time = center + dt * since_entry_;
  if (estimate == TimeEstimate::kEntryCorrected)
  {
    const int successor = std::min(state_ + 1, model_->states() - 1);
    const double limit = model_->stateTime(successor) + 0.5 * dt * (model_->durations()(successor) - 1.0);
    time = std::min(center + dt * (since_entry_ - 0.5 * (duration - 1.0)), limit);
  }
  else if (estimate == TimeEstimate::kRegressed)
  {
    constexpr double kReach = 0.75;  // of a state's length: beyond, its line says nothing
    recogniser_->timeWithin(state_, x_.head(recogniser_->dimension()), &recogniser_scratch_, &time, &spread);
    time = std::min(std::max(time, center - kReach * dt * duration), center + kReach * dt * duration);
  }
  if (variance)
    *variance = spread;
  return time;
}

double TimeTracker::pace(const ForecastSettings& settings)
{
  if (settings.velocity_count == 0)
    return 1.0;
  constexpr double kPrior = 0.05;  // squared speed, in units of the data's, below which 1 is believed rather
  constexpr double kFastest = 3.0;
  const Eigen::Index first = settings.velocity_first, count = settings.velocity_count;
  if (first < 0 || count < 0 || first + count > model_->dimension())
    throw std::invalid_argument("velocity dimensions " + std::to_string(first) + " to " +
                                std::to_string(first + count - 1) + ", expected within 0 to " +
                                std::to_string(model_->dimension() - 1));
  model_->regressMean(std::min(std::max(time(settings.time), 0.0), model_->length()), &scratch_);
  double along = 0.0, square = 0.0;
  for (Eigen::Index j = first; j < first + count; ++j)
  {
    const double scale = model_->parameters().scale(j), modelled = scratch_.mean(j) / scale;
    along += modelled * (x_(j) / scale - modelled);
    square += modelled * modelled;
  }
  return std::min(std::max(1.0 + along / (square + kPrior), 0.0), kFastest);
}

void TimeTracker::forecast(double horizon, const ForecastSettings& settings, phri_core::Gaussian* result)
{
  phri_core::requireRange("horizon", horizon, 0.0, 1e9, "s");
  const TimeHmmParameters& p = model_->parameters();
  const auto within = [this](double t) { return std::min(std::max(t, 0.0), model_->length()); };
  double variance = 0.0;
  const double now = time(settings.time, &variance), rate = pace(settings);
  const double then = within(now + rate * horizon);
  const double growth = p.pace_variance * horizon * horizon;
  if (settings.reference == Reference::kPath)
  {
    model_->regressUncertain(then, variance + growth, &scratch_);
    result->mean = scratch_.mean;
    result->mean.segment(settings.velocity_first, settings.velocity_count) *= rate;
    result->covariance = scratch_.covariance;
  }
  else
  {
    model_->regressMean(within(now), &scratch_);
    now_ = scratch_.mean;
    model_->regressMean(then + model_->dt(), &scratch_);
    slope_ = scratch_.mean;
    model_->regressMean(then - model_->dt(), &scratch_);
    slope_ = (slope_ - scratch_.mean) / (2.0 * model_->dt());
    model_->regressUncertain(then, 0.0, &scratch_);
    result->mean = x_ + scratch_.mean - now_;
    // a stationary deviation with correlation exp(-h / memory) changes by 2 (1 - exp(-h / memory)) of its covariance
    scratch_.other = (2.0 * (1.0 - (-horizon / p.memory.array()).exp())).sqrt();
    const Eigen::VectorXd& change = scratch_.other;
    result->covariance = scratch_.covariance;
    for (Eigen::Index i = 0; i < change.size(); ++i)
      for (Eigen::Index j = 0; j < change.size(); ++j)
        result->covariance(i, j) =
            result->covariance(i, j) * (change(i) * change(j)) + growth * (slope_(i) * slope_(j));
    result->covariance.diagonal().array() += p.covariance_floor * p.scale.array().square();
  }
}
}  // namespace phri_learning
