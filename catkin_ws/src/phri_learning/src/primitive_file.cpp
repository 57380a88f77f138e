// Libraries of primitives on disk, and bringing two of them together.
#include <algorithm>
#include <stdexcept>

#include "model_json.hpp"
#include "phri_learning/primitive_library.hpp"

namespace phri_learning
{
namespace
{
constexpr const char* kSchema = "phri_learning/PrimitiveLibrary";
constexpr int kVersion = 1;

Json toJson(const PrimitiveOptions& o)
{
  return Json{ { "states", o.training.states },
               { "components", o.training.components },
               { "dt", o.training.dt },
               { "formulas", o.training.formulas == Formulas::kThesis ? "thesis" : "corrected" },
               { "max_iterations", o.training.max_iterations },
               { "tolerance", o.training.tolerance },
               { "covariance_floor", o.training.covariance_floor },
               { "shrinkage", o.training.shrinkage },
               { "members", o.members },
               { "cutoff", o.cutoff },
               { "rule", o.rule == CutRule::kMean ? "mean" : "log_mean" },
               { "spread", o.spread },
               { "laplace", o.laplace },
               { "remembered", o.remembered },
               { "waiting", o.waiting } };
}

PrimitiveOptions optionsFromJson(const Reader& read)
{
  PrimitiveOptions o;
  const std::string formulas = read.text("formulas"), rule = read.text("rule");
  if (formulas != "corrected" && formulas != "thesis")
    read.fail("formulas", "corrected or thesis", formulas);
  if (rule != "mean" && rule != "log_mean")
    read.fail("rule", "mean or log_mean", rule);
  o.training.states = read.integer("states");
  o.training.components = read.integer("components");
  o.training.dt = read.number("dt");
  o.training.formulas = formulas == "thesis" ? Formulas::kThesis : Formulas::kCorrected;
  o.training.max_iterations = read.integer("max_iterations");
  o.training.tolerance = read.number("tolerance");
  o.training.covariance_floor = read.number("covariance_floor");
  o.training.shrinkage = read.number("shrinkage");
  o.members = read.integer("members");
  o.cutoff = read.number("cutoff");
  o.rule = rule == "mean" ? CutRule::kMean : CutRule::kLogMean;
  o.spread = read.number("spread");
  o.laplace = read.number("laplace");
  o.remembered = read.integer("remembered");
  o.waiting = read.integer("waiting");
  return o;
}

Json toJson(const PrimitiveNode& node)
{
  Json segments = Json::array();
  for (const PrimitiveSegment& segment : node.segments)
    segments.push_back(
        { { "id", segment.id }, { "samples", rows(*segment.samples) }, { "model", toJson(*segment.model->hmm) } });
  Json result = {
    { "id", node.id }, { "parent", node.parent }, { "count", node.count }, { "segments", std::move(segments) }
  };
  if (node.model)
    result["model"] = toJson(*node.model->hmm);
  return result;
}
}  // namespace

void PrimitiveLibrary::save(const std::string& path) const
{
  Json nodes = Json::array();
  for (const auto& entry : nodes_)
    nodes.push_back(toJson(entry.second));
  writeDocument({ { "options", toJson(options_) },
                  { "dimension", dimension_ },
                  { "next_node", next_node_ },
                  { "samples", samples_ },
                  { "sum", values(sum_) },
                  { "squares", values(squares_) },
                  { "size", values(size_) },
                  { "nodes", std::move(nodes) },
                  { "node_of", node_of_ },
                  { "follows", std::vector<int>(follows_.begin(), follows_.end()) } },
                kSchema, kVersion, path);
}

PrimitiveLibrary PrimitiveLibrary::load(const std::string& path)
{
  const Json contents = readDocument(path, kSchema, kVersion);
  const Reader read(path, contents);
  try
  {
    PrimitiveLibrary result(optionsFromJson(Reader(path, read.object("options"))));
    result.dimension_ = read.integer("dimension");
    result.next_node_ = read.integer("next_node");
    result.samples_ = read.number("samples");
    const auto moments = [&](const char* key) {
      const Eigen::VectorXd vector = read.vector(key);
      if (vector.size() != result.dimension_)
        read.fail(key, std::to_string(result.dimension_) + " numbers", std::to_string(vector.size()));
      return vector;
    };
    result.sum_ = moments("sum");
    result.squares_ = moments("squares");
    result.size_ = moments("size");
    result.node_of_ = read.integers("node_of");
    const std::vector<int> follows = read.integers("follows");
    result.follows_.assign(follows.begin(), follows.end());
    if (result.follows_.size() != result.node_of_.size())
      read.fail("follows", std::to_string(result.node_of_.size()) + " values", std::to_string(follows.size()));
    const auto model = [&](const Reader& from) {
      TimeHmm hmm = timeHmmFromJson(path, from.object("model"));
      if (hmm.dimension() != result.dimension_)
        from.fail("model", std::to_string(result.dimension_) + " dimensions", std::to_string(hmm.dimension()));
      return result.encoded(std::move(hmm));
    };
    for (const Json& entry : read.list("nodes"))
    {
      const Reader from(path, entry);
      PrimitiveNode node;
      node.id = from.integer("id");
      node.parent = from.integer("parent");
      node.count = from.integer("count");
      const bool root = node.id == 0;
      // ids grow from the root down, so this also excludes circles
      if (root ? node.parent != -1 : node.parent >= node.id || result.nodes_.count(node.parent) == 0)
        from.fail("parent", "a node before node " + std::to_string(node.id), std::to_string(node.parent));
      if (node.id < 0 || node.id >= result.next_node_)
        from.fail("id", "0.." + std::to_string(result.next_node_ - 1), std::to_string(node.id));
      if (!root)
        node.model = model(from);
      for (const Json& item : from.list("segments"))
      {
        const Reader segment(path, item);
        PrimitiveSegment kept;
        kept.id = segment.integer("id");
        if (kept.id < 0 || kept.id >= result.segmentCount() ||
            result.node_of_[static_cast<std::size_t>(kept.id)] != node.id)
          segment.fail("id", "a segment of node " + std::to_string(node.id), std::to_string(kept.id));
        kept.samples = std::make_shared<const Eigen::MatrixXd>(segment.matrix("samples"));
        kept.model = model(segment);
        if (kept.samples->cols() != result.dimension_)
          segment.fail("samples", std::to_string(result.dimension_) + " columns", std::to_string(kept.samples->cols()));
        node.segments.push_back(std::move(kept));
      }
      if (!root)
        result.at(node.parent).children.push_back(node.id);
      const int id = node.id;
      result.nodes_[id] = std::move(node);
    }
    for (const int id : result.node_of_)
      if (result.nodes_.count(id) == 0)
        read.fail("node_of", "ids of nodes", std::to_string(id));
    return result;
  }
  catch (const std::invalid_argument& error)
  {
    throw ModelFileError(path, "contents", "a valid library", error.what());
  }
}

void PrimitiveLibrary::merge(const PrimitiveLibrary& other)
{
  if (toJson(options_) != toJson(other.options_))
    throw std::invalid_argument("libraries have different options: " + toJson(options_).dump() + " and " +
                                toJson(other.options_).dump());
  if (dimension_ > 0 && other.dimension_ > 0 && dimension_ != other.dimension_)
    throw std::invalid_argument("other library has " + std::to_string(other.dimension_) + " dimensions, expected " +
                                std::to_string(dimension_));
  const PrimitiveLibrary source = other;  // may be this one
  const int first_segment = segmentCount(), first_node = next_node_ - 1;
  const auto renamed = [&](int id) { return id > 0 ? id + first_node : id; };
  if (source.dimension_ == 0)
    return;
  if (dimension_ == 0)
    sum_ = squares_ = Eigen::VectorXd::Zero(source.dimension_);
  dimension_ = source.dimension_;
  samples_ += source.samples_;
  sum_ += source.sum_;
  squares_ += source.squares_;
  updateSize();
  for (const int id : source.node_of_)
    node_of_.push_back(renamed(id));
  follows_.insert(follows_.end(), source.follows_.begin(), source.follows_.end());
  for (const auto& entry : source.nodes_)
  {
    PrimitiveNode node = entry.second;
    for (PrimitiveSegment& segment : node.segments)
    {
      segment.id += first_segment;
      segment.model = encoded(*segment.model->hmm);
    }
    for (int& child : node.children)
      child = renamed(child);
    if (node.id == 0)
    {
      PrimitiveNode& root = at(0);
      root.children.insert(root.children.end(), node.children.begin(), node.children.end());
      root.segments.insert(root.segments.end(), node.segments.begin(), node.segments.end());
      root.count += node.count;
      continue;
    }
    node.id = renamed(node.id);
    node.parent = renamed(node.parent);
    node.model = encoded(*node.model->hmm);
    nodes_[node.id] = std::move(node);
  }
  next_node_ += source.next_node_ - 1;
  cluster(0);
  forgetOldest(0);
}
}  // namespace phri_learning
