#include "phri_learning/segmentation.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "phri_core/check.hpp"

namespace phri_learning
{
namespace
{
constexpr double kInfinity = std::numeric_limits<double>::infinity();

int embeddedSpan(const SegmentationOptions& o)
{
  return o.window + (o.embedding - 1) * o.delay;
}

std::optional<int> find(const std::vector<std::pair<int, int>>& pairs, int key)
{
  for (const auto& pair : pairs)
    if (pair.first == key)
      return pair.second;
  return std::nullopt;
}
}  // namespace

void checkOptions(const SegmentationOptions& o, int dimension)
{
  phri_core::requireRange("dimension", dimension, 1, 1000, "");
  phri_core::requireRange("window", o.window, 2, 1000, "samples");
  phri_core::requireRange("embedding", o.embedding, 1, 50, "");
  phri_core::requireRange("delay", o.delay, 1, 1000, "samples");
  phri_core::requireRange("switch_cost", o.switch_cost, 1e-9, 1e9, "");
  phri_core::requireRange("lag", o.lag, 1, 100000, "samples");
  phri_core::requireRange("slack", o.slack, 0, o.window, "samples");
  phri_core::requireRange("horizon", o.horizon, 2.0 * (o.lag + o.window) + 1.0, 300000, "samples");
  phri_core::requireRange("prototypes", o.prototypes, 2, 1000, "");
  phri_core::requireRange("sigma", o.sigma, 0.0, 1e9, "");
  if (o.sigma == 0.0)
    phri_core::requireRange("sigma_samples", o.sigma_samples, 2.0 * o.embedding * dimension, o.horizon, "samples");
  phri_core::requireRange("dt", o.dt, 1e-6, 1e3, "s");
  if (o.scale.size() != 0 && o.scale.size() != dimension)
    throw std::invalid_argument("scale has " + std::to_string(o.scale.size()) + " elements, expected " +
                                std::to_string(dimension) + " or none");
  for (Eigen::Index i = 0; i < o.scale.size(); ++i)
    if (!(o.scale(i) > 0.0) || !std::isfinite(o.scale(i)))
      throw std::invalid_argument("scale[" + std::to_string(i) + "] = " + std::to_string(o.scale(i)) +
                                  ", expected a finite number > 0");
}

double neighbourSigma(const Eigen::Ref<const Eigen::MatrixXd>& samples, int neighbours)
{
  const Eigen::Index count = samples.rows(), near = std::min<Eigen::Index>(neighbours, count - 1);
  if (near < 1)
    return 1.0;
  double sum = 0.0;
  Eigen::VectorXd distance(count);
  for (Eigen::Index t = 0; t < count; ++t)
  {
    distance = (samples.rowwise() - samples.row(t)).rowwise().norm();
    std::partial_sort(distance.begin(), distance.begin() + near + 1, distance.end());
    sum += distance.segment(1, near).mean();  // the first is the sample itself
  }
  return sum > 0.0 ? sum / static_cast<double>(count) : 1.0;
}

OnlineSegmentation::OnlineSegmentation(const SegmentationOptions& options, int dimension)
  : options_(options), dimension_(dimension), span_(embeddedSpan(options)), sigma_(options.sigma)
{
  checkOptions(options, dimension);
  if (options_.scale.size() == 0)
    options_.scale = Eigen::VectorXd::Ones(dimension);
  const Eigen::Index w = options.window, h = options.horizon, states = options.prototypes + h;
  const Eigen::Index size = static_cast<Eigen::Index>(options.embedding) * dimension;
  pending_.resize(dimension, options.sigma > 0.0 ? 0 : options.sigma_samples);
  recent_.resize(dimension, (options.embedding - 1) * options.delay + 1);
  embedded_.resize(size, h + w);
  row_.resize(h + w);
  kernel_.resize(w, w);
  row_sums_ = Eigen::MatrixXd::Zero(states, w);
  self_ = Eigen::VectorXd::Ones(states);
  cross_ = Eigen::VectorXd::Zero(states);
  distance_ = Eigen::MatrixXd::Constant(states, h, kInfinity);
  switched_.resize(states, h);
  best_.resize(static_cast<std::size_t>(h));
  start_ = Eigen::VectorXd::Zero(states);
  cost_.resize(states);
  starts_.reserve(static_cast<std::size_t>(h));
  states_.reserve(static_cast<std::size_t>(h) + 1);
  const std::size_t prototypes = static_cast<std::size_t>(options.prototypes);
  prototype_samples_.assign(prototypes, Eigen::MatrixXd(size, w));
  prototype_id_.assign(prototypes, -1);
  prototype_used_.assign(prototypes, -1);
  restart();
}

int OnlineSegmentation::knownPrototypes() const
{
  return static_cast<int>(std::count_if(prototype_id_.begin(), prototype_id_.end(), [](int id) { return id >= 0; }));
}

std::size_t OnlineSegmentation::memoryBytes() const
{
  std::size_t numbers = 0;
  for (const Eigen::MatrixXd* matrix : { &pending_, &recent_, &embedded_, &kernel_, &row_sums_, &distance_ })
    numbers += static_cast<std::size_t>(matrix->size());
  for (const Eigen::VectorXd* vector : { &row_, &self_, &cross_, &start_, &cost_ })
    numbers += static_cast<std::size_t>(vector->size());
  for (const Eigen::MatrixXd& samples : prototype_samples_)
    numbers += static_cast<std::size_t>(samples.size());
  return sizeof(double) * numbers + static_cast<std::size_t>(switched_.size()) +
         sizeof(std::int64_t) * (starts_.capacity() + prototype_used_.capacity()) +
         sizeof(int) * (best_.capacity() + states_.capacity() + prototype_id_.capacity());
}

std::optional<Boundary> OnlineSegmentation::push(const Eigen::Ref<const Eigen::VectorXd>& sample)
{
  if (!take(sample))
    return std::nullopt;
  solve();
  return advance();
}

std::vector<Boundary> OnlineSegmentation::finish()
{
  if (waiting_ > 0)
    applySigmaRule();
  std::vector<Boundary> result;
  if (openWindows() > 0)
  {
    solve();
    for (std::size_t i = 0; i < starts_.size(); ++i)
      result.push_back(describe(i, false));
    // keeping an open state takes the slot of an old prototype, so those of the path are marked as used first
    std::vector<std::pair<int, int>> ids;
    for (const bool open : { false, true })
      for (const int state : states_)
        if ((state >= options_.prototypes) == open && !find(ids, state))
          ids.emplace_back(state, prototype_id_[static_cast<std::size_t>(keep(state))]);
    for (std::size_t i = 0; i < starts_.size(); ++i)
      result[i].ended = *find(ids, states_[i]);
  }
  restart();
  return result;
}

void OnlineSegmentation::restart()
{
  samples_ = embedded_count_ = 0;
  first_ = 0;
  last_ = -1;
  waiting_ = rested_ = 0;
  anchor_ = -1;
  carried_ = -1;
  start_.setZero();
  distance_.bottomRows(options_.horizon).setConstant(kInfinity);
}

bool OnlineSegmentation::take(const Eigen::Ref<const Eigen::VectorXd>& sample)
{
  if (sample.size() != dimension_)
    throw std::invalid_argument("sample has " + std::to_string(sample.size()) + " elements, expected " +
                                std::to_string(dimension_));
  for (Eigen::Index i = 0; i < sample.size(); ++i)
    if (!std::isfinite(sample(i)))
      throw std::invalid_argument("sample " + std::to_string(samples()) + " element " + std::to_string(i) + " = " +
                                  std::to_string(sample(i)) + ", expected a finite number");
  if (sigma_ > 0.0)
  {
    recent_.col(samples_ % recent_.cols()) = sample.cwiseQuotient(options_.scale);
    ++samples_;
    return addEmbedded();
  }
  pending_.col(waiting_++) = sample;
  if (waiting_ < options_.sigma_samples)
    return false;
  applySigmaRule();
  return openWindows() > 0;
}

void OnlineSegmentation::applySigmaRule()
{
  const int count = waiting_, back = static_cast<int>(recent_.cols()) - 1;
  const Eigen::MatrixXd scaled = options_.scale.cwiseInverse().asDiagonal() * pending_.leftCols(count);
  Eigen::MatrixXd embedded(std::max(count - back, 0), embedded_.rows());
  for (Eigen::Index t = 0; t < embedded.rows(); ++t)
    for (int lag = 0; lag < options_.embedding; ++lag)
      embedded.row(t).segment(lag * dimension_, dimension_) = scaled.col(t + back - lag * options_.delay).transpose();
  sigma_ = neighbourSigma(embedded, static_cast<int>(embedded_.rows()));
  waiting_ = 0;
  for (int t = 0; t < count; ++t)
    take(pending_.col(t));
}

bool OnlineSegmentation::addEmbedded()
{
  if (samples_ < recent_.cols())
    return false;
  const std::int64_t newest = embedded_count_++;
  auto x = embedded_.col(place(newest));
  for (int lag = 0; lag < options_.embedding; ++lag)
    x.segment(lag * dimension_, dimension_) =
        recent_.col((samples_ - 1 - static_cast<std::int64_t>(lag) * options_.delay) % recent_.cols()) / sigma_;
  const std::int64_t oldest = std::max<std::int64_t>(0, std::min(first_, newest) - options_.window + 1);
  const auto ring = [&](std::int64_t sample) { return static_cast<Eigen::Index>(sample % options_.window); };
  for (std::int64_t t = oldest; t <= newest; ++t)
    row_(t - oldest) = std::exp(-0.25 * (embedded_.col(place(t)) - x).squaredNorm());
  for (std::int64_t t = std::max(oldest, newest - options_.window + 1); t <= newest; ++t)
    kernel_(ring(t), ring(newest)) = kernel_(ring(newest), ring(t)) = row_(t - oldest);
  double sum = 0.0;
  for (std::int64_t t = oldest; t <= newest; ++t)
  {
    sum += row_(t - oldest);
    if (t - oldest >= options_.window)
      sum -= row_(t - oldest - options_.window);
    if (t >= first_ && t <= last_)
      row_sums_(openState(t), ring(newest)) = sum;
  }
  for (int p = 0; p < options_.prototypes; ++p)
    if (prototype_id_[static_cast<std::size_t>(p)] >= 0)
    {
      const Eigen::MatrixXd& samples = prototype_samples_[static_cast<std::size_t>(p)];
      double total = 0.0;
      for (Eigen::Index w = 0; w < samples.cols(); ++w)
        total += std::exp(-0.25 * (samples.col(w) - x).squaredNorm());
      row_sums_(p, ring(newest)) = total;
    }
  if (embedded_count_ < options_.window)
    return false;
  addDistances();
  return true;
}

void OnlineSegmentation::addDistances()
{
  if (last_ < 0)
    first_ = embedded_count_ - 1;
  last_ = embedded_count_ - 1;
  const int state = openState(last_);
  row_sums_.row(state) = kernel_.colwise().sum();
  const double pairs = static_cast<double>(options_.window) * options_.window;
  cross_ = row_sums_.rowwise().sum() / pairs;
  self_(state) = cross_(state);
  const auto between = [&](int other) {
    const double both = self_(state) + self_(other);
    const double difference = std::max(0.0, both - 2.0 * cross_(other));  // rounding
    return options_.distance == WindowDistance::kSquared ? difference : difference / both;
  };
  for (std::int64_t t = first_; t <= last_; ++t)
    distance_(state, column(t)) = distance_(openState(t), column(last_)) = between(openState(t));
  for (int p = 0; p < options_.prototypes; ++p)
    distance_(p, column(last_)) = prototype_id_[static_cast<std::size_t>(p)] >= 0 ? between(p) : kInfinity;
}

void OnlineSegmentation::solve()
{
  Eigen::Index cheapest = 0;
  cost_ = distance_.col(column(first_)) + start_;
  for (std::int64_t t = first_ + 1; t <= last_; ++t)
  {
    const double enter = cost_.minCoeff(&cheapest) + options_.switch_cost;
    best_[static_cast<std::size_t>(column(t))] = static_cast<int>(cheapest);
    switched_.col(column(t)) = (cost_.array() > enter).matrix();
    cost_ = cost_.cwiseMin(enter) + distance_.col(column(t));
  }
  cost_.minCoeff(&cheapest);
  starts_.clear();
  states_.assign(1, static_cast<int>(cheapest));
  for (std::int64_t t = last_; t > first_; --t)
    if (switched_(states_.back(), column(t)))
    {
      starts_.push_back(t);
      states_.push_back(best_[static_cast<std::size_t>(column(t))]);
    }
  if (carried_ >= 0 && states_.back() != carried_)
  {
    starts_.push_back(first_);
    states_.push_back(carried_);
  }
  std::reverse(starts_.begin(), starts_.end());
  std::reverse(states_.begin(), states_.end());
}

std::optional<Boundary> OnlineSegmentation::advance()
{
  if (starts_.empty() || anchor_ < 0 || std::abs(starts_.front() - anchor_) > options_.slack)
  {
    anchor_ = starts_.empty() ? -1 : starts_.front();
    rested_ = 0;
  }
  else
    ++rested_;
  std::optional<Boundary> result;
  const bool full = openWindows() == options_.horizon;
  if (!starts_.empty() && last_ - starts_.front() >= options_.lag && (rested_ >= options_.lag || full))
  {
    result = describe(0, rested_ < options_.lag);
    const int ended = keep(states_.front());
    result->ended = prototype_id_[static_cast<std::size_t>(ended)];
    forget(starts_.front());
    carried_ = -1;
    start_.setZero();
    start_(ended) = kInfinity;  // the boundary stands
    anchor_ = -1;
    rested_ = 0;
  }
  if (openWindows() == options_.horizon)
  {
    carried_ = keep(states_[result ? 1 : 0]);
    start_.setConstant(options_.switch_cost);
    start_(carried_) = 0.0;
    forget(first_ + 1);
  }
  return result;
}

Boundary OnlineSegmentation::describe(std::size_t position, bool forced) const
{
  Boundary result;
  const std::int64_t window_end = starts_[position] + span_ - options_.window;  // as a sample
  result.index = window_end - (span_ - 1) / 2;
  result.time = static_cast<double>(result.index) * options_.dt;
  result.margin = margin(position);
  result.delay = static_cast<int>(samples_ - 1 - result.index);
  result.forced = forced;
  return result;
}

double OnlineSegmentation::margin(std::size_t position) const
{
  const std::int64_t begin = position > 0 ? starts_[position - 1] : first_, middle = starts_[position];
  const std::int64_t end = position + 1 < starts_.size() ? starts_[position + 1] : last_ + 1;
  const auto sum = [&](int state, std::int64_t from, std::int64_t until) {
    double total = 0.0;
    for (std::int64_t t = from; t < until; ++t)
      total += distance_(state, column(t));
    return total;
  };
  double together = kInfinity;
  for (int state = 0; state < distance_.rows(); ++state)
    if (std::isfinite(distance_(state, column(last_))))
      together = std::min(together, sum(state, begin, end));
  const double apart = sum(states_[position], begin, middle) + sum(states_[position + 1], middle, end);
  return std::max(0.0, together - apart - options_.switch_cost);
}

int OnlineSegmentation::keep(int state)
{
  std::size_t slot = static_cast<std::size_t>(state);
  if (state >= options_.prototypes)
  {
    slot = static_cast<std::size_t>(std::min_element(prototype_used_.begin(), prototype_used_.end()) -
                                    prototype_used_.begin());
    const Eigen::Index p = static_cast<Eigen::Index>(slot);
    const std::int64_t window =
        last_ - (column(last_) - (state - options_.prototypes) + options_.horizon) % options_.horizon;
    for (int w = 0; w < options_.window; ++w)
      prototype_samples_[slot].col(w) = embedded_.col(place(window - w));
    row_sums_.row(p) = row_sums_.row(state);
    distance_.row(p) = distance_.row(state);
    self_(p) = self_(state);
    prototype_id_[slot] = next_id_++;
  }
  prototype_used_[slot] = uses_++;
  return static_cast<int>(slot);
}

void OnlineSegmentation::forget(std::int64_t until)
{
  for (; first_ < until; ++first_)
    distance_.row(openState(first_)).setConstant(kInfinity);
}

std::vector<Boundary> segmentOffline(const Eigen::Ref<const Eigen::MatrixXd>& samples, SegmentationOptions options)
{
  const int dimension = static_cast<int>(samples.cols());
  checkOptions(options, dimension);
  options.lag = 1;
  options.horizon = std::max(static_cast<int>(samples.rows()), 2 * (options.window + options.lag) + 1);
  options.prototypes = 2;
  OnlineSegmentation whole(options, dimension);
  for (Eigen::Index t = 0; t < samples.rows(); ++t)
    whole.take(samples.row(t).transpose());
  return whole.finish();
}
}  // namespace phri_learning
