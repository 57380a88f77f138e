#include "phri_learning/primitive_library.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <set>
#include <stdexcept>

#include "phri_core/check.hpp"

namespace phri_learning
{
namespace
{
constexpr double kSizeChange = 0.1;
constexpr double kResolution = 1e-9;         // [m, m/s, N] what moves less stands still
constexpr double kLongestOutput = 100000.0;  // [samples]

double scaled(CutRule rule, double distance)
{
  return rule == CutRule::kMean ? distance : std::log1p(std::max(0.0, distance));
}

/// Groups of indices by complete linkage: the two groups whose farthest members are closest are joined as long as that
/// distance is below `cut`.
std::vector<std::vector<std::size_t>> completeLinkage(const Eigen::MatrixXd& distance, double cut)
{
  std::vector<std::vector<std::size_t>> groups;
  for (Eigen::Index i = 0; i < distance.rows(); ++i)
    groups.push_back({ static_cast<std::size_t>(i) });
  for (;;)
  {
    double closest = cut;
    std::size_t first = 0, second = 0;
    for (std::size_t i = 0; i < groups.size(); ++i)
      for (std::size_t j = i + 1; j < groups.size(); ++j)
      {
        double farthest = -std::numeric_limits<double>::infinity();
        for (const std::size_t a : groups[i])
          for (const std::size_t b : groups[j])
            farthest = std::max(farthest, distance(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)));
        if (farthest < closest)
        {
          closest = farthest;
          first = i;
          second = j;
        }
      }
    if (first == second)
      return groups;
    groups[first].insert(groups[first].end(), groups[second].begin(), groups[second].end());
    groups.erase(groups.begin() + static_cast<std::ptrdiff_t>(second));
  }
}
}  // namespace

/// A child node or a segment of its parent.
struct PrimitiveLibrary::Item
{
  int child = -1;
  int segment = -1;
  const EncodedModel* model = nullptr;
};

Eigen::MatrixXd generalisedOutput(const TimeHmm& model)
{
  const double count = std::clamp(std::round(model.length() / model.dt()) + 1.0, 2.0, kLongestOutput);
  const Eigen::Index samples = static_cast<Eigen::Index>(count);
  return model.regress(Eigen::VectorXd::LinSpaced(samples, 0.0, model.dt() * (count - 1.0))).means;
}

namespace
{
double symmetricDistance(const TimeHmm& first, const Eigen::MatrixXd& first_output, const TimeHmm& second,
                         const Eigen::MatrixXd& second_output)
{
  if (&first == &second)
    return 0.0;
  const auto gain = [](const TimeHmm& own, const TimeHmm& other, const Eigen::MatrixXd& output) {
    return (own.score(output) - other.score(output)) / static_cast<double>(output.rows());
  };
  return 0.5 * (gain(first, second, first_output) + gain(second, first, second_output));
}
}  // namespace

double modelDistance(const TimeHmm& first, const TimeHmm& second)
{
  if (first.dimension() != second.dimension())
    throw std::invalid_argument("models of " + std::to_string(first.dimension()) + " and " +
                                std::to_string(second.dimension()) + " dimensions, expected equal ones");
  return symmetricDistance(first, generalisedOutput(first), second, generalisedOutput(second));
}

void checkOptions(const PrimitiveOptions& o)
{
  checkOptions(o.training);
  phri_core::requireRange("members", o.members, 2, 1000, "segments");
  phri_core::requireRange("cutoff", o.cutoff, 1e-6, 1.0 - 1e-6, "");
  phri_core::requireRange("spread", o.spread, 1e-6, 10.0, "");
  phri_core::requireRange("laplace", o.laplace, 0.0, 1e6, "");
  phri_core::requireRange("remembered", o.remembered, o.members, 1000, "segments");
  phri_core::requireRange("waiting", o.waiting, o.remembered, 1000, "segments");
}

PrimitiveLibrary::PrimitiveLibrary(PrimitiveOptions options) : options_(std::move(options))
{
  checkOptions(options_);
  nodes_[0] = PrimitiveNode();
}

std::vector<int> PrimitiveLibrary::nodeIds() const
{
  std::vector<int> ids;
  for (const auto& entry : nodes_)
    ids.push_back(entry.first);
  return ids;
}

const PrimitiveNode& PrimitiveLibrary::node(int id) const
{
  const auto found = nodes_.find(id);
  if (found == nodes_.end())
    throw std::invalid_argument("node " + std::to_string(id) + " is not in the library of " +
                                std::to_string(nodes_.size()) + " nodes");
  return found->second;
}

std::vector<int> PrimitiveLibrary::path(int segment) const
{
  if (segment < 0 || segment >= segmentCount())
    throw std::invalid_argument("segment " + std::to_string(segment) + ", expected 0.." +
                                std::to_string(segmentCount() - 1));
  std::vector<int> result;
  for (int id = node_of_[static_cast<std::size_t>(segment)]; id >= 0; id = node(id).parent)
    result.insert(result.begin(), id);
  return result;
}

int PrimitiveLibrary::primitiveOf(int segment) const
{
  const std::vector<int> nodes = path(segment);
  return nodes.size() > 1 ? nodes[1] : -1;
}

std::vector<std::pair<std::shared_ptr<const TimeHmm>, int>> PrimitiveLibrary::models(bool single) const
{
  std::vector<std::pair<std::shared_ptr<const TimeHmm>, int>> result;
  for (const int id : upperNodes())
    result.emplace_back(node(id).model->hmm, id);
  if (single)
    for (const PrimitiveSegment& segment : node(0).segments)
      result.emplace_back(segment.model->hmm, -1 - segment.id);
  return result;
}

PrimitiveLibrary::Successions PrimitiveLibrary::successions() const
{
  Successions result;
  result.nodes = upperNodes();
  const Eigen::Index size = static_cast<Eigen::Index>(result.nodes.size());
  result.counts = Eigen::MatrixXi::Zero(size, size);
  result.probability = Eigen::MatrixXd::Zero(size, size);
  std::map<int, Eigen::Index> index{ { -1, -1 } };
  for (Eigen::Index i = 0; i < size; ++i)
    index[result.nodes[static_cast<std::size_t>(i)]] = i;
  Eigen::Index before = -1;
  for (int segment = 0; segment < segmentCount(); ++segment)
  {
    const Eigen::Index now = index.at(primitiveOf(segment));
    if (follows_[static_cast<std::size_t>(segment)] != 0 && before >= 0 && now >= 0)
      ++result.counts(before, now);
    before = now;
  }
  for (Eigen::Index i = 0; i < size; ++i)
  {
    const double total = result.counts.row(i).sum() + options_.laplace * static_cast<double>(size);
    if (total > 0.0)
      result.probability.row(i) = (result.counts.row(i).cast<double>().array() + options_.laplace) / total;
  }
  return result;
}

std::shared_ptr<const EncodedModel> PrimitiveLibrary::encoded(TimeHmm model)
{
  auto result = std::make_shared<EncodedModel>();
  result->serial = next_serial_++;
  result->hmm = std::make_shared<const TimeHmm>(std::move(model));
  result->output = generalisedOutput(*result->hmm);
  return result;
}

std::shared_ptr<const EncodedModel> PrimitiveLibrary::encode(const std::vector<Eigen::MatrixXd>& samples)
{
  return encoded(train(samples, options_.training).model);
}

double PrimitiveLibrary::distance(const EncodedModel& first, const EncodedModel& second)
{
  const auto key = std::minmax(first.serial, second.serial);
  const auto known = distances_.find(key);
  if (known != distances_.end())
    return known->second;
  // always the same order of the sum, so that the value does not depend on who asked first
  const EncodedModel& low = first.serial < second.serial ? first : second;
  const EncodedModel& high = first.serial < second.serial ? second : first;
  return distances_[key] = symmetricDistance(*compared(low), low.output, *compared(high), high.output);
}

std::shared_ptr<const TimeHmm> PrimitiveLibrary::compared(const EncodedModel& model)
{
  std::shared_ptr<const TimeHmm>& result = compared_[model.serial];
  if (!result)
  {
    TimeHmmParameters p = model.hmm->parameters();
    for (Eigen::MatrixXd& covariance : p.ss)
      covariance.diagonal().array() += (options_.spread * size_.array()).square();
    result = std::make_shared<const TimeHmm>(std::move(p), model.hmm->formulas());
  }
  return result;
}

void PrimitiveLibrary::updateSize()
{
  const Eigen::VectorXd mean = sum_ / samples_;
  const Eigen::VectorXd size =
      (squares_.array() / samples_ - mean.array().square()).max(kResolution * kResolution).sqrt();
  if (size_.size() == size.size() && ((size - size_).array().abs() <= kSizeChange * size_.array()).all())
    return;
  size_ = size;
  compared_.clear();
  distances_.clear();
}

std::vector<int> PrimitiveLibrary::add(const Eigen::MatrixXd& segment, bool follows)
{
  if (segment.rows() < 2)
    throw std::invalid_argument("segment has " + std::to_string(segment.rows()) + " samples, expected at least 2");
  if (dimension_ > 0 && segment.cols() != dimension_)
    throw std::invalid_argument("segment has " + std::to_string(segment.cols()) + " dimensions, expected " +
                                std::to_string(dimension_));
  PrimitiveSegment added;
  added.model = encode({ segment });  // throws before anything has changed
  added.samples = std::make_shared<const Eigen::MatrixXd>(segment);
  added.id = segmentCount();
  if (dimension_ == 0)
  {
    dimension_ = static_cast<int>(segment.cols());
    sum_ = squares_ = Eigen::VectorXd::Zero(dimension_);
  }
  samples_ += static_cast<double>(segment.rows());
  sum_ += segment.colwise().sum().transpose();
  squares_ += segment.colwise().squaredNorm().transpose();
  updateSize();
  node_of_.push_back(0);
  follows_.push_back(follows && added.id > 0 ? 1 : 0);
  PrimitiveNode& root = at(0);
  root.segments.push_back(added);
  ++root.count;
  cluster(0);
  forgetOldest(0);

  std::set<int> alive;
  for (const auto& entry : nodes_)
  {
    if (entry.second.model)
      alive.insert(entry.second.model->serial);
    for (const PrimitiveSegment& kept : entry.second.segments)
      alive.insert(kept.model->serial);
  }
  for (auto entry = distances_.begin(); entry != distances_.end();)
    if (alive.count(entry->first.first) && alive.count(entry->first.second))
      ++entry;
    else
      entry = distances_.erase(entry);
  for (auto entry = compared_.begin(); entry != compared_.end();)
    entry = alive.count(entry->first) ? std::next(entry) : compared_.erase(entry);
  return path(added.id);
}

void PrimitiveLibrary::cluster(int node)
{
  while (clusterOnce(node))  // every group formed leaves fewer items
  {
  }
}

bool PrimitiveLibrary::clusterOnce(int id)
{
  const PrimitiveNode& parent = at(id);
  std::vector<Item> items;
  for (const int child : parent.children)
    items.push_back({ child, -1, at(child).model.get() });
  for (const PrimitiveSegment& segment : parent.segments)
    items.push_back({ -1, segment.id, segment.model.get() });
  const Eigen::Index size = static_cast<Eigen::Index>(items.size());
  if (size < 3)
    return false;
  Eigen::MatrixXd between = Eigen::MatrixXd::Zero(size, size);
  for (Eigen::Index i = 0; i < size; ++i)
    for (Eigen::Index j = i + 1; j < size; ++j)
      between(i, j) = between(j, i) = scaled(options_.rule, distance(*items[static_cast<std::size_t>(i)].model,
                                                                     *items[static_cast<std::size_t>(j)].model));
  const double mean = between.sum() / static_cast<double>(size * (size - 1));
  for (const std::vector<std::size_t>& indices : completeLinkage(between, options_.cutoff * mean))
  {
    std::vector<Item> group;
    for (const std::size_t index : indices)
      group.push_back(items[index]);
    const bool has_child = std::any_of(group.begin(), group.end(), [](const Item& item) { return item.child >= 0; });
    if (static_cast<int>(group.size()) >= (has_child ? 2 : options_.members))
    {
      form(id, group);
      return true;
    }
  }
  return false;
}

void PrimitiveLibrary::form(int parent, const std::vector<Item>& group)
{
  int target = -1;
  for (const Item& item : group)
    if (item.child >= 0)
      target = target < 0 ? item.child : std::min(target, item.child);
  if (target < 0)
  {
    target = next_node_++;
    nodes_[target].id = target;
    nodes_[target].parent = parent;
    at(parent).children.push_back(target);
  }
  PrimitiveNode& into = at(target);
  PrimitiveNode& from = at(parent);
  for (const Item& item : group)
  {
    if (item.child == target)
      continue;
    if (item.child >= 0)
    {
      const PrimitiveNode merged = at(item.child);
      for (const int child : merged.children)
        at(child).parent = target;
      into.children.insert(into.children.end(), merged.children.begin(), merged.children.end());
      into.segments.insert(into.segments.end(), merged.segments.begin(), merged.segments.end());
      into.count += merged.count;
      std::replace(node_of_.begin(), node_of_.end(), item.child, target);
      from.children.erase(std::find(from.children.begin(), from.children.end(), item.child));
      nodes_.erase(item.child);
      continue;
    }
    const auto moved = std::find_if(from.segments.begin(), from.segments.end(),
                                    [&](const PrimitiveSegment& segment) { return segment.id == item.segment; });
    into.segments.push_back(*moved);
    ++into.count;
    node_of_[static_cast<std::size_t>(item.segment)] = target;
    from.segments.erase(moved);
  }
  std::sort(into.children.begin(), into.children.end());
  std::sort(into.segments.begin(), into.segments.end(),
            [](const PrimitiveSegment& a, const PrimitiveSegment& b) { return a.id < b.id; });
  retrain(target);
  cluster(target);
  forgetOldest(target);
}

std::vector<PrimitiveSegment> PrimitiveLibrary::branch(int id) const
{
  std::vector<PrimitiveSegment> result = node(id).segments;
  for (const int child : node(id).children)
    for (PrimitiveSegment& segment : branch(child))
      result.push_back(std::move(segment));
  return result;
}

void PrimitiveLibrary::retrain(int id)
{
  std::vector<PrimitiveSegment> segments = branch(id);
  std::sort(segments.begin(), segments.end(),
            [](const PrimitiveSegment& a, const PrimitiveSegment& b) { return a.id > b.id; });
  std::vector<Eigen::MatrixXd> samples;
  for (const PrimitiveSegment& segment : segments)
    if (static_cast<int>(samples.size()) < options_.remembered)
      samples.push_back(*segment.samples);
  at(id).model = encode(samples);
}

void PrimitiveLibrary::forgetOldest(int id)
{
  std::vector<PrimitiveSegment>& segments = at(id).segments;
  const std::ptrdiff_t extra =
      static_cast<std::ptrdiff_t>(segments.size()) - (id == 0 ? options_.waiting : options_.remembered);
  if (extra > 0)
    segments.erase(segments.begin(), segments.begin() + extra);
}
}  // namespace phri_learning
