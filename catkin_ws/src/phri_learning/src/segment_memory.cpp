#include <algorithm>
#include <cmath>

#include "partner_state.hpp"

namespace phri_learning
{
namespace
{
SegmentationOptions unscaled(SegmentationOptions options)
{
  options.scale.resize(0);
  return options;
}

Eigen::Index capacity(const EmergingOptions& o)
{
  const SegmentationOptions& s = o.segmentation;
  // a boundary is at most a horizon and half a window's span old, and the segment it ends began `longest` before
  const int span = s.window + (s.embedding - 1) * s.delay;
  return std::max(o.longest + s.horizon + span + o.scale_samples + s.sigma_samples, o.recogniser.window) + 8;
}
}  // namespace

SegmentMemory::SegmentMemory(const EmergingOptions& options)
  : options_(options),
    window_(options.recogniser.window),
    segmentation_(unscaled(options.segmentation), recognisedDimensions(options.segmented, options.dof)),
    scale_(options.segmentation.scale),
    scaled_(recognisedDimensions(options.segmented, options.dof)),
    scale_known_(scale_.size() > 0),
    ring_(Eigen::MatrixXd::Zero(3 * options.dof, capacity(options))),
    queue_(static_cast<std::size_t>(options.queue))
{
  if (!scale_known_)
    scale_ = Eigen::VectorXd::Ones(scaled_.size());
  for (Slot& slot : queue_)
    slot.samples.setZero(3 * options_.dof, options_.longest);
}

void SegmentMemory::push(const Eigen::VectorXd& sample, double time)
{
  if (samples_ == 0)
    start_ = time;
  ring_.col(place(samples_)) = sample;
  ++samples_;
}

void SegmentMemory::setScale()
{
  const Eigen::Index d = scaled_.size();
  const double count = static_cast<double>(samples_);
  for (Eigen::Index j = 0; j < d; ++j)
  {
    const auto values = ring_.row(j).head(static_cast<Eigen::Index>(samples_)).array();
    const double mean = values.sum() / count, deviation = std::sqrt((values - mean).square().sum() / count);
    scale_(j) = deviation > 0.0 ? deviation : 1.0;
  }
  scale_known_ = true;
}

void SegmentMemory::segment(int count)
{
  if (!scale_known_ && samples_ >= options_.scale_samples)
    setScale();
  for (int i = 0; scale_known_ && i < count && segmented_ < samples_; ++i)
    feed();
}

void SegmentMemory::feed()
{
  scaled_ = ring_.col(place(segmented_)).head(scaled_.size()).cwiseQuotient(scale_);
  ++segmented_;
  if (const auto boundary = segmentation_.push(scaled_))
    commit(boundary->index, boundary->ended, boundary->margin);
}

void SegmentMemory::commit(std::int64_t end, int ended, double margin)
{
  const std::int64_t begin = std::max(begin_, end - options_.longest);
  const bool whole = begin == begin_, enough = end - begin >= options_.shortest;
  if (enough)
  {
    if (waiting_ == options_.queue)
    {
      first_ = (first_ + 1) % options_.queue;
      --waiting_;
      ++lost_;
      queue_[static_cast<std::size_t>(first_)].follows = false;  // its predecessor is gone
    }
    Slot& slot = queue_[static_cast<std::size_t>((first_ + waiting_) % options_.queue)];
    slot.count = static_cast<Eigen::Index>(end - begin);
    for (Eigen::Index t = 0; t < slot.count; ++t)
      slot.samples.col(t) = ring_.col(place(begin + t));
    slot.begin = start_ + static_cast<double>(begin) * options_.dt;
    slot.follows = whole && follows_;
    slot.ended = ended;
    slot.margin = margin;
    ++waiting_;
  }
  follows_ = enough;
  begin_ = end;
}

void SegmentMemory::finish()
{
  if (!scale_known_ && samples_ >= options_.shortest)
    setScale();  // a short trial, but all there is
  while (scale_known_ && segmented_ < samples_)
    feed();
  for (const Boundary& boundary : segmentation_.finish())
    commit(boundary.index, boundary.ended, boundary.margin);
  commit(samples_, -1, 0.0);
  samples_ = segmented_ = begin_ = 0;
  follows_ = false;
}

std::vector<CommittedSegment> SegmentMemory::takeSegments()
{
  std::vector<CommittedSegment> result;
  for (; waiting_ > 0; --waiting_)
  {
    const Slot& slot = queue_[static_cast<std::size_t>(first_)];
    result.push_back(
        { slot.samples.leftCols(slot.count).transpose(), slot.begin, slot.follows, slot.ended, slot.margin });
    first_ = (first_ + 1) % options_.queue;
  }
  return result;
}
}  // namespace phri_learning
