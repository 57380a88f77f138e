#include "phri_learning/primitive_recogniser.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "phri_core/check.hpp"

namespace phri_learning
{
void checkOptions(const RecogniserOptions& o)
{
  phri_core::requireRange("recogniser window", o.window, 1, 1000, "samples");
  phri_core::requireRange("leak", o.leak, 0.0, 0.5, "");
  phri_core::requireRange("confirm", o.confirm, 1, 100, "samples");
  phri_core::requireRange("gate", o.gate, 1e-6, 1e6, "nat");
  phri_core::requireRange("outlier", o.outlier, o.gate, 1e9, "nat");
  phri_core::requireRange("least", o.least, 1, o.window, "samples");
}

namespace
{
/// A forward filter of one model.
struct Filter
{
  explicit Filter(const TimeHmm& hmm)
    : scratch(hmm.scratch()),
      probability(hmm.states()),
      emission(hmm.states()),
      stay(hmm.logStay().array().exp()),
      next(hmm.logNext().array().exp()),
      times(hmm.states())
  {
    for (int i = 0; i < hmm.states(); ++i)
      times(i) = hmm.stateTime(i);
  }
  TimeHmm::Scratch scratch;
  Eigen::VectorXd probability, emission, stay, next, times;
};

/// The increment of the next sample; `first`: of a new series.
double step(const TimeHmm& hmm, double leak, bool first, const Eigen::Ref<const Eigen::VectorXd>& x, Filter* f)
{
  const int states = hmm.states();
  Eigen::VectorXd& p = f->probability;
  const double anywhere = 1.0 / states;
  if (first)
    p.setConstant(anywhere);
  else
  {
    const double kept = 1.0 - leak, leaked = leak * anywhere;
    for (int i = states - 1; i > 0; --i)
      p(i) = kept * (p(i) * f->stay(i) + p(i - 1) * f->next(i - 1)) + leaked;
    p(0) = kept * p(0) * f->stay(0) + leaked;
  }
  hmm.logEmission(x, &f->scratch, f->emission);
  // relative to the likeliest of the states that can be reached: without a leak the others may be infinitely unlikely
  double highest = -std::numeric_limits<double>::infinity();
  for (int i = 0; i < states; ++i)
    if (p(i) > 0.0)
      highest = std::max(highest, f->emission(i));
  double sum = 0.0;
  for (int i = 0; i < states; ++i)
    sum += p(i) = p(i) > 0.0 ? p(i) * std::exp(f->emission(i) - highest) : 0.0;
  p /= sum;
  return highest + std::log(sum);
}
}  // namespace

struct PrimitiveRecogniser::Filters : std::vector<Filter>
{
};

double typicalIncrement(const TimeHmm& hmm, const std::vector<Eigen::MatrixXd>& examples, double leak)
{
  phri_core::requireRange("leak", leak, 0.0, 0.5, "");
  Filter filter(hmm);
  double sum = 0.0, count = 0.0;
  for (const Eigen::MatrixXd& example : examples)
  {
    phri_core::requireShape("example", example, example.rows(), hmm.dimension());
    phri_core::requireFinite("example", example);
    for (Eigen::Index t = 0; t < example.rows(); ++t)
      sum += step(hmm, leak, t == 0, example.row(t).transpose(), &filter);
    count += static_cast<double>(example.rows());
  }
  if (count == 0.0)
    throw std::invalid_argument("examples have 0 samples, expected at least 1");
  return sum / count;
}

PrimitiveRecogniser::PrimitiveRecogniser(std::vector<RecognisedModel> models, const RecogniserOptions& options)
  : models_(std::move(models)), options_(options), filters_(std::make_unique<Filters>())
{
  checkOptions(options_);
  for (std::size_t i = 0; i < models_.size(); ++i)
  {
    const std::string name = "model " + std::to_string(i);
    if (!models_[i].hmm)
      throw std::invalid_argument(name + ": none given, expected a trained TimeHmm");
    if (models_[i].hmm->dimension() != models_[0].hmm->dimension())
      throw std::invalid_argument(name + " has " + std::to_string(models_[i].hmm->dimension()) +
                                  " dimensions, expected " + std::to_string(models_[0].hmm->dimension()) +
                                  " as the first");
    filters_->emplace_back(*models_[i].hmm);
  }
  entries_.resize(models_.size());
  increments_.resize(options_.window, static_cast<Eigen::Index>(models_.size()));
}

PrimitiveRecogniser::~PrimitiveRecogniser() = default;
PrimitiveRecogniser::PrimitiveRecogniser(PrimitiveRecogniser&&) noexcept = default;
PrimitiveRecogniser& PrimitiveRecogniser::operator=(PrimitiveRecogniser&&) noexcept = default;

void PrimitiveRecogniser::reset()
{
  head_ = samples_ = rival_samples_ = 0;
  known_ = false;
  winner_ = rival_ = -1;
  std::fill(entries_.begin(), entries_.end(), Entry());
}

const std::vector<PrimitiveRecogniser::Entry>& PrimitiveRecogniser::filter(const Eigen::Ref<const Eigen::VectorXd>& x)
{
  if (models_.empty())
    return entries_;
  const int dimension = models_[0].hmm->dimension();
  if (x.size() != dimension || !x.allFinite())
  {
    phri_core::requireShape("sample", x, dimension, 1);
    phri_core::requireFinite("sample", x);
  }
  const bool first = samples_ == 0;
  samples_ = std::min(samples_ + 1, options_.window);
  for (std::size_t i = 0; i < models_.size(); ++i)
  {
    const TimeHmm& hmm = *models_[i].hmm;
    Filter& filter = (*filters_)[i];
    auto column = increments_.col(static_cast<Eigen::Index>(i));
    column(head_) =
        std::max(step(hmm, options_.leak, first, x, &filter), models_[i].typical - options_.outlier * dimension);
    Entry& entry = entries_[i];
    // summed anew: a running sum would keep the rounding of what has left the window
    entry.log_likelihood = column.head(samples_).sum();
    Eigen::Index likeliest = 0;
    filter.probability.maxCoeff(&likeliest);
    entry.state = static_cast<int>(likeliest);
    entry.time = filter.probability.dot(filter.times);
    entry.progress = std::clamp(entry.time / hmm.length(), 0.0, 1.0);
  }
  head_ = (head_ + 1) % options_.window;
  choose();
  return entries_;
}

double PrimitiveRecogniser::excess(int model) const
{
  const std::size_t i = static_cast<std::size_t>(model);
  if (samples_ == 0)
    return -std::numeric_limits<double>::infinity();
  return (entries_.at(i).log_likelihood / samples_ - models_[i].typical) / models_[i].hmm->dimension();
}

void PrimitiveRecogniser::choose()
{
  int best = winner_ < 0 ? 0 : winner_;  // of equal ones the one in force
  for (std::size_t i = 0; i < entries_.size(); ++i)
    if (entries_[i].log_likelihood > entries_[static_cast<std::size_t>(best)].log_likelihood)
      best = static_cast<int>(i);
  if (winner_ < 0)
    winner_ = best;  // nobody to be defended
  if (best == winner_)
    rival_samples_ = 0;
  else
  {
    rival_samples_ = best == rival_ ? rival_samples_ + 1 : 1;
    rival_ = best;
    if (!known_ || rival_samples_ >= options_.confirm)
    {
      winner_ = best;
      rival_samples_ = 0;
    }
  }
  known_ = samples_ >= options_.least && excess(winner_) >= -options_.gate;
}
}  // namespace phri_learning
