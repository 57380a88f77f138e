#include "phri_learning/learned_primitives.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

#include "phri_core/check.hpp"
#include "phri_learning/hmm_chain.hpp"

namespace phri_learning
{
void checkOptions(const EmergingOptions& o)
{
  phri_core::requireRange("dof", o.dof, 1, phri_core::kMaxDof, "");
  phri_core::requireRange("dt", o.dt, 1e-4, 10.0, "s");
  phri_core::requireRange("horizon", o.horizon, o.dt, 100.0 * o.dt, "s");
  phri_core::requireRange("window_states", o.window_states, 2, 1000, "states");
  if (o.window_states % 2 != 0)
    throw std::invalid_argument("window_states = " + std::to_string(o.window_states) + ", expected an even number");
  phri_core::requireRange("spread", o.spread, 1e-6, 10.0, "");
  phri_core::requireRange("motion_spread", o.motion_spread, 1e-6, 10.0, "");
  phri_core::requireRange("blend", o.blend, 0, 100, "samples");
  // a displacement model needs examples that are longer than what it predicts
  phri_core::requireRange("shortest", o.shortest, std::ceil(o.horizon / o.dt) + 2, 1e5, "samples");
  phri_core::requireRange("longest", o.longest, o.shortest, 1e5, "samples");
  phri_core::requireRange("queue", o.queue, 1, 1000, "segments");
  phri_core::requireRange("scale_samples", o.scale_samples, 2, 10000, "samples");
  checkOptions(o.recogniser);
  checkOptions(o.segmentation, recognisedDimensions(o.segmented, o.dof));
  checkOptions(o.primitives);
}

int recognisedDimensions(Recognition recognition, int dof)
{
  return recognition == Recognition::kAll ? 3 * dof : recognition == Recognition::kMotion ? 2 * dof : dof;
}

PrimitiveWindow primitiveWindow(const TimeHmm* before, const TimeHmm& own, const TimeHmm* after, int window_states)
{
  phri_core::requireRange("window_states", window_states, 2, 1000, "states");
  if (window_states % 2 != 0)
    throw std::invalid_argument("window_states = " + std::to_string(window_states) + ", expected an even number");
  const int ahead = before ? std::min(window_states / 2, before->states()) : 0;
  const int behind = after ? std::min(window_states / 2, after->states()) : 0;
  TimeHmm chain = before ? concatenate(*before, own) : own;
  if (after)
    chain = concatenate(chain, *after);
  PrimitiveWindow result;
  result.before = ahead;
  result.begin = before ? before->length() : 0.0;
  const int first = (before ? before->states() : 0) - ahead, count = ahead + own.states() + behind;
  if (count == chain.states())
    result.hmm = std::make_shared<const TimeHmm>(std::move(chain));
  else
    result.hmm = std::make_shared<const TimeHmm>(windowHmm(chain, first + (count - 1) / 2, count).model);
  return result;
}

namespace
{
using Segments = std::map<int, std::shared_ptr<const Eigen::MatrixXd>>;

void collect(const PrimitiveLibrary& library, int id, Segments* all)
{
  for (const PrimitiveSegment& segment : library.node(id).segments)
    all->emplace(segment.id, segment.samples);
  for (const int child : library.node(id).children)
    collect(library, child, all);
}

/// The latest of a branch, as many as a node is trained on.
Segments members(const PrimitiveLibrary& library, int id)
{
  Segments result;
  collect(library, id, &result);
  while (static_cast<int>(result.size()) > library.options().remembered)
    result.erase(result.begin());
  return result;
}

Eigen::VectorXd sizeOf(const Segments& all, int dimension)
{
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(dimension), squares = sum;
  double count = 0.0;
  for (const auto& entry : all)
  {
    sum += entry.second->colwise().sum().transpose();
    squares += entry.second->colwise().squaredNorm().transpose();
    count += static_cast<double>(entry.second->rows());
  }
  return (squares / count - (sum / count).cwiseAbs2()).cwiseMax(0.0).cwiseSqrt();
}

/// Whether the second begins where the first ends: ids alone do not tell, a trial may lie between.
bool continues(const Eigen::MatrixXd& first, const Eigen::MatrixXd& second, int dof)
{
  constexpr double kSteps = 3.0;  // of the longer of the two steps at the joint
  const auto step = [dof](const Eigen::MatrixXd& x, Eigen::Index t) {
    return (x.row(t + 1).head(dof) - x.row(t).head(dof)).norm();
  };
  const double longest = std::max(step(first, first.rows() - 2), step(second, 0));
  return (second.row(0).head(dof) - first.row(first.rows() - 1).head(dof)).norm() <= kSteps * longest;
}

/// A member with the last samples before it and the first after it, as far as they are remembered: a displacement model
/// has to know how a primitive goes on.
Eigen::MatrixXd extended(const Segments& all, int id, int before, int after, int dof)
{
  const Eigen::MatrixXd& own = *all.at(id);
  const auto previous = all.find(id - 1), next = all.find(id + 1);
  Eigen::Index head = 0, tail = 0;
  if (previous != all.end() && continues(*previous->second, own, dof))
    head = std::min<Eigen::Index>(before, previous->second->rows());
  if (next != all.end() && continues(own, *next->second, dof))
    tail = std::min<Eigen::Index>(after, next->second->rows());
  Eigen::MatrixXd result(head + own.rows() + tail, own.cols());
  if (head > 0)
    result.topRows(head) = previous->second->bottomRows(head);
  result.middleRows(head, own.rows()) = own;
  if (tail > 0)
    result.bottomRows(tail) = next->second->topRows(tail);
  return result;
}

/// The model over the leading dimensions, every covariance widened by what repetitions may differ.
std::shared_ptr<const TimeHmm> widened(const TimeHmm& model, int dimensions, const Eigen::VectorXd& deviation)
{
  TimeHmmParameters p = model.leading(dimensions).parameters();
  for (Eigen::MatrixXd& covariance : p.ss)
    covariance.diagonal() += deviation.head(dimensions).cwiseAbs2();
  return std::make_shared<const TimeHmm>(std::move(p), model.formulas());
}

int likeliest(const Eigen::Ref<const Eigen::VectorXi>& counts, const std::vector<int>& nodes)
{
  Eigen::Index best = 0;
  return counts.size() > 0 && counts.maxCoeff(&best) > 0 ? nodes[static_cast<std::size_t>(best)] : -1;
}

PrimitiveOptions primitiveOptions(const EmergingOptions& options)
{
  checkOptions(options);
  PrimitiveOptions result = options.primitives;
  result.training.dt = options.dt;
  return result;
}
}  // namespace

std::vector<Eigen::MatrixXd> memberSamples(const PrimitiveLibrary& library, int node)
{
  std::vector<Eigen::MatrixXd> result;
  for (const auto& member : members(library, node))
    result.push_back(*member.second);
  return result;
}

PrimitiveLearner::PrimitiveLearner(const EmergingOptions& options)
  : PrimitiveLearner(options, PrimitiveLibrary(primitiveOptions(options)))
{
}

PrimitiveLearner::PrimitiveLearner(const EmergingOptions& options, PrimitiveLibrary library) : options_(options)
{
  checkOptions(options_);
  if (library.options().training.dt != options_.dt)
    throw std::invalid_argument("library was learned at dt = " + std::to_string(library.options().training.dt) +
                                " s, expected " + std::to_string(options_.dt));
  if (library.dimension() != 0 && library.dimension() != 3 * options_.dof)
    throw std::invalid_argument("library has " + std::to_string(library.dimension()) + " dimensions, expected " +
                                std::to_string(3 * options_.dof) + " ([x; xdot; u_h] of " +
                                std::to_string(options_.dof) + " degrees of freedom)");
  refresh(std::move(library));
}

PrimitiveLearner PrimitiveLearner::load(const EmergingOptions& options, const std::string& path)
{
  return PrimitiveLearner(options, PrimitiveLibrary::load(path));
}

std::shared_ptr<const LearnedPrimitives> PrimitiveLearner::add(const CommittedSegment& segment)
{
  phri_core::requireShape("segment", segment.samples, segment.samples.rows(), 3 * options_.dof);
  PrimitiveLibrary library = snapshot_->library;
  library.add(segment.samples, segment.follows);
  refresh(std::move(library));
  return snapshot_;
}

void PrimitiveLearner::refresh(PrimitiveLibrary library)
{
  auto result = std::make_shared<LearnedPrimitives>(LearnedPrimitives{ options_, std::move(library), {} });
  const PrimitiveLibrary& from = result->library;
  if (!from.upperNodes().empty())
  {
    Segments all;
    collect(from, 0, &all);
    const int recognised = recognisedDimensions(options_.recognition, options_.dof);
    Eigen::VectorXd deviation = options_.spread * sizeOf(all, from.dimension());
    deviation.tail(2 * options_.dof) *= options_.motion_spread / options_.spread;
    const PrimitiveLibrary::Successions graph = from.successions();
    const auto model = [&](int node) { return node < 0 ? nullptr : from.node(node).model->hmm.get(); };
    for (std::size_t i = 0; i < graph.nodes.size(); ++i)
    {
      const Eigen::Index row = static_cast<Eigen::Index>(i);
      LearnedPrimitive primitive;
      primitive.node = graph.nodes[i];
      primitive.own = from.node(primitive.node).model->hmm;
      primitive.predecessor = likeliest(graph.counts.col(row), graph.nodes);
      primitive.successor = likeliest(graph.counts.row(row).transpose(), graph.nodes);
      primitive.window = primitiveWindow(model(primitive.predecessor), *primitive.own, model(primitive.successor),
                                         options_.window_states);
      primitive.recognised = widened(*primitive.window.hmm, recognised, deviation);
      const Segments own = members(from, primitive.node);
      std::vector<Eigen::MatrixXd> examples;
      for (const auto& member : own)
        examples.push_back(member.second->leftCols(recognised));
      primitive.typical = typicalIncrement(*primitive.recognised, examples, options_.recogniser.leak);
      if (options_.reference == Reference::kDisplacement)
        fitDisplacement(all, own, &primitive);
      result->primitives.push_back(std::move(primitive));
    }
  }
  snapshot_ = std::move(result);
}

void PrimitiveLearner::fitDisplacement(const Segments& all, const Segments& own, LearnedPrimitive* primitive) const
{
  // a primitive is followed from a little before it begins to a little after it ends: these are places to predict from
  // too, and beyond the last of them lies a whole horizon
  constexpr double kLookback = 0.2;  // [s] that a displacement model looks back at least
  const int steps = static_cast<int>(std::ceil(options_.horizon / options_.dt - 1e-9)) + 1;
  const int margin = steps + options_.recogniser.confirm;
  const int before = static_cast<int>(std::ceil(kLookback / options_.dt)) + margin, after = margin + steps;
  std::vector<Eigen::MatrixXd> demonstrations;
  for (const auto& member : own)
  {
    demonstrations.push_back(extended(all, member.first, before, after, options_.dof));
    primitive->fitted.emplace_back(member.first, static_cast<int>(demonstrations.back().rows()));
  }
  if (snapshot_)
    for (const LearnedPrimitive& known : snapshot_->primitives)
      if (known.node == primitive->node && known.fitted == primitive->fitted)
      {
        primitive->displacement = known.displacement;
        return;
      }
  DisplacementOptions o;
  o.axes = options_.dof;
  o.dt = options_.dt;
  o.horizon = steps * options_.dt;
  primitive->displacement = std::make_shared<const DisplacementRegression>(trainDisplacements(demonstrations, o));
}
}  // namespace phri_learning
