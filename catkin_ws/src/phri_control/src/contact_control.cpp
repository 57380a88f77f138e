#include "phri_control/contact_control.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "phri_core/check.hpp"

namespace phri_control
{
using phri_core::VectorDof;
using phri_core::VectorState;

namespace
{
/// One numeric setting; the table and the validation both read this list.
struct NumberSetting
{
  const char *key, *unit;
  double& (*field)(ContactSettings&);
  double low, high;
  const char* help;
};

const NumberSetting kNumbers[] = {
  { "dt", "s", [](ContactSettings& s) -> double& { return s.dt; }, 1e-4, 0.02, "period of a stage of the policy" },
  { "horizon", "s", [](ContactSettings& s) -> double& { return s.horizon; }, 0.02, 2.0, "of the optimisation" },
  { "validity", "s", [](ContactSettings& s) -> double& { return s.validity; }, 0.02, 2.0,
    "length of a policy, at most the horizon" },
  { "covariance_weights/position", "", [](ContactSettings& s) -> double& { return s.covariance_weights.position; }, 0.0,
    1e9, "weight of the position error per learned variance" },
  { "covariance_weights/velocity", "", [](ContactSettings& s) -> double& { return s.covariance_weights.velocity; }, 0.0,
    1e9, "weight of the velocity error per learned variance" },
  { "identity_weights/position", "1/m^2", [](ContactSettings& s) -> double& { return s.identity_weights.position; },
    0.0, 1e14, "weight of the position error per sample" },
  { "identity_weights/velocity", "s^2/m^2", [](ContactSettings& s) -> double& { return s.identity_weights.velocity; },
    0.0, 1e14, "weight of the velocity error per sample" },
  { "covariance_floor", "m^2, m^2/s^2", [](ContactSettings& s) -> double& { return s.covariance_floor; }, 1e-12, 1.0,
    "added to the learned variances" },
  { "control_weight", "1/N^2", [](ContactSettings& s) -> double& { return s.control_weight; }, 1e-9, 1e9,
    "weight R of the motion control's force" },
  { "seeking", "1/J", [](ContactSettings& s) -> double& { return s.seeking; }, 0.0, 1e9,
    "-theta of the risk-seeking controllers" },
  { "averse", "1/J", [](ContactSettings& s) -> double& { return s.averse; }, 0.0, 1e9,
    "theta of the risk-averse controller" },
  { "window", "s", [](ContactSettings& s) -> double& { return s.window; }, 0.02, 10.0,
    "over which the force input's moments are taken" },
  { "forgetting_time", "s", [](ContactSettings& s) -> double& { return s.forgetting_time; }, 0.01, 1e3,
    "time constant with which the adaptation of the reference is forgotten" },
};

const std::vector<std::string> kLaws = { "error_feedback", "preview" };
const std::vector<std::string> kWeightings = { "covariance", "identity" };

struct Kind
{
  const char* name;
  int attitude;  ///< sign of theta
  bool adapts, forgets;
};

constexpr Kind kKinds[] = {
  { "neutral_learned", 0, false, false },   { "seeking_learned", -1, false, false },
  { "neutral_adapted", 0, true, false },    { "seeking_adapted", -1, true, false },
  { "seeking_forgetting", -1, true, true }, { "neutral_forgetting", 0, true, true },
  { "averse_learned", 1, false, false },
};

std::size_t kindOf(const std::string& name)
{
  const std::vector<std::string>& names = contactControllerNames();
  const auto found = std::find(names.begin(), names.end(), name);
  if (found != names.end())
    return found - names.begin();
  std::string message = "unknown contact controller \"" + name + "\": expected one of";
  for (const std::string& known : names)
    message += " " + known;
  const std::string meant = phri_core::closest(name, names);
  throw std::invalid_argument(message + (meant.empty() ? "" : "; did you mean " + meant + '?'));
}

const ContactSettings& valid(const ContactSettings& settings)
{
  requireValid(settings);
  return settings;
}

void requireGaussian(const std::string& name, const phri_core::Gaussian& value, Eigen::Index size)
{
  phri_core::requireShape(name + ".mean", value.mean, size, 1);
  phri_core::requireFinite(name + ".mean", value.mean);
  phri_core::requireShape(name + ".covariance", value.covariance, size, size);
  phri_core::requireCovariance(name + ".covariance", value.covariance);
}
}  // namespace

phri_core::ParameterTable parameterTable(ContactSettings& settings)
{
  phri_core::ParameterTable table;
  table.text("law", &settings.law, kLaws,
             "error_feedback: u = L (xi - xi_d); preview adds the optimal feedforward of the tracking problem");
  table.text("weighting", &settings.weighting, kWeightings,
             "covariance: weights per learned variance; identity: constant weights");
  for (const NumberSetting& number : kNumbers)
    table.number(number.key, &number.field(settings), number.unit, number.low, number.high, number.help);
  table.flag("clamp_velocity_gain", &settings.clamp_velocity_gain, "stiffness only: velocity gain 0");
  return table;
}

void requireValid(ContactSettings settings)
{
  const std::string where = "ContactSettings: ";
  const Eigen::Index dof = settings.mass.size();
  if (dof < 1 || settings.damping.size() != dof || settings.force_gain.size() != dof)
    throw std::invalid_argument(
        where + "mass has " + std::to_string(dof) + ", damping " + std::to_string(settings.damping.size()) +
        " and force_gain " + std::to_string(settings.force_gain.size()) + " elements, expected the same number, 1..6");
  for (Eigen::Index i = 0; i < dof; ++i)
  {
    phri_core::requireRange(where + "mass", settings.mass(i), 1e-3, 1e4, "kg, kgm2");
    phri_core::requireRange(where + "damping", settings.damping(i), 0.0, 1e5, "Ns/m, Nms/rad");
    phri_core::requireRange(where + "force_gain", settings.force_gain(i), 1e-3, 1e3, "-");
    // the explicit step of (5.48) is not a model of the plant beyond
    phri_core::requireRange(where + "dt * damping / mass", settings.dt * settings.damping(i) / settings.mass(i), 0.0,
                            1.0, "-");
  }
  for (const NumberSetting& number : kNumbers)
    phri_core::requireRange(where + number.key, number.field(settings), number.low, number.high, number.unit);
  phri_core::requireRange(where + "validity", settings.validity, settings.dt, settings.horizon, "s");
  const auto requireChoice = [&](const std::string& key, const std::string& value,
                                 const std::vector<std::string>& choices) {
    if (std::find(choices.begin(), choices.end(), value) == choices.end())
      throw std::invalid_argument(where + key + " = \"" + value + "\", expected " + choices[0] + " or " + choices[1]);
  };
  requireChoice("law", settings.law, kLaws);
  requireChoice("weighting", settings.weighting, kWeightings);
}

ContactController::ContactController(const std::string& name, const ContactSettings& settings)
  : name_(name),
    settings_(valid(settings)),
    source_(static_cast<int>(kindOf(name))),
    window_(settings.mass.size(), settings.window, settings.dt)
{
  const Kind& kind = kKinds[source_];
  adapts_ = kind.adapts;
  theta_ = kind.attitude < 0 ? -settings.seeking : kind.attitude * settings.averse;
  lambda_ = kind.forgets ? std::exp(-settings.dt / settings.forgetting_time) : 1.0;

  const std::size_t horizon = std::lround(settings.horizon / settings.dt);
  references_.assign(horizon + 1, VectorState::Zero(2 * settings.mass.size()));
  for (Eigen::Index i = 0; i < settings.mass.size(); ++i)
  {
    LqStage<2, 1> stage = LqStage<2, 1>::zero();
    stage.A << 1.0, settings.dt, 0.0, 1.0 - settings.dt * settings.damping(i) / settings.mass(i);
    stage.B << 0.0, settings.dt / settings.mass(i);
    stage.R(0, 0) = settings.control_weight;
    Problem problem;
    problem.stages.assign(horizon, stage);
    problem.terminal = LqTerminal<2>::zero();
    problem.noise.push_back(
        NoiseSource::fromFactor("force", std::vector<Eigen::MatrixXd>(horizon, Eigen::MatrixXd(stage.B))));
    problems_.push_back(std::move(problem));
  }
  reset();
}

void ContactController::reset() noexcept
{
  window_.clear();
  bias_.setZero(settings_.mass.size());
  adaptation_.setZero(2 * settings_.mass.size());
  planned_ = false;
}

void ContactController::follow(const ContactReference& reference)
{
  const Eigen::Index dof = settings_.mass.size();
  if (!std::isfinite(reference.t0))
    throw std::invalid_argument("ContactReference: t0 = " + std::to_string(reference.t0) +
                                " s, expected a finite time");
  phri_core::requireRange("ContactReference: dt", reference.dt, 1e-6, 10.0, "s");
  if (reference.motion.empty() || reference.motion.size() != reference.environment_wrench.size())
    throw std::invalid_argument("ContactReference: " + std::to_string(reference.motion.size()) + " motions and " +
                                std::to_string(reference.environment_wrench.size()) +
                                " wrenches, expected the same number, at least 1");
  std::vector<Node> nodes(reference.motion.size());
  for (std::size_t k = 0; k < nodes.size(); ++k)
  {
    const phri_core::Gaussian &motion = reference.motion[k], &wrench = reference.environment_wrench[k];
    requireGaussian("ContactReference: motion[" + std::to_string(k) + "]", motion, 2 * dof);
    requireGaussian("ContactReference: environment_wrench[" + std::to_string(k) + "]", wrench, dof);
    nodes[k] = { motion.mean, motion.covariance.diagonal().cwiseMax(0.0), wrench.mean, wrench.covariance,
                 VectorDof::Zero(dof) };
  }
  nodes_ = std::move(nodes);
  reference_t0_ = reference.t0;
  reference_dt_ = reference.dt;
}

ContactController::Place ContactController::locate(double t) const noexcept
{
  const double last = static_cast<double>(nodes_.size() - 1), s = (t - reference_t0_) / reference_dt_;
  const double clamped = std::clamp(s, 0.0, last), index = std::floor(clamped);
  const std::size_t first = static_cast<std::size_t>(index);
  return { &nodes_[first], &nodes_[std::min(first + 1, nodes_.size() - 1)], clamped - index, s > last };
}

VectorDof ContactController::forceInput(double t, const VectorDof& environment_wrench) const noexcept
{
  VectorDof force = VectorDof::Zero(settings_.mass.size());
  if (nodes_.empty() || environment_wrench.size() != force.size() || !std::isfinite(t))
    return force;
  const Place at = locate(t);
  force = environment_wrench - at(&Node::force);
  return force.cwiseProduct(settings_.force_gain);
}

void ContactController::observe(double t, const VectorDof& environment_wrench) noexcept
{
  if (!nodes_.empty() && environment_wrench.size() == settings_.mass.size())
    window_.add(t, forceInput(t, environment_wrench));
}

std::string ContactController::unusable(const phri_core::Observation& observation) const
{
  const Eigen::Index dof = settings_.mass.size();
  const auto sizes = [](const std::string& what, Eigen::Index size, Eigen::Index expected) {
    return what + " has " + std::to_string(size) + " elements, expected " + std::to_string(expected);
  };
  if (nodes_.empty())
    return "there is no task to follow";
  if (!std::isfinite(observation.t) || !observation.state.allFinite() || !observation.environment_wrench.allFinite())
    return "the observation is not finite";
  if (observation.state.size() != 2 * dof)
    return sizes("the observed state", observation.state.size(), 2 * dof);
  if (observation.environment_wrench.size() != dof)
    return sizes("the observed environment wrench", observation.environment_wrench.size(), dof);
  if (planned_ && observation.t < planned_at_)
    return "the observation is of " + std::to_string(observation.t) + " s, before the last plan at " +
           std::to_string(planned_at_) + " s";
  return "";
}

void ContactController::adapt(VectorState& adaptation) const noexcept
{
  const Eigen::Index dof = settings_.mass.size();
  for (Eigen::Index i = 0; i < dof; ++i)
  {
    const LqStage<2, 1>& stage = problems_[i].stages.front();
    const Eigen::Vector2d before(adaptation(i), adaptation(dof + i));
    const Eigen::Vector2d after = lambda_ * (stage.A * before) + stage.B * bias_(i);
    adaptation(i) = after(0);
    adaptation(dof + i) = after(1);
  }
}

void ContactController::setReferences(double t)
{
  const Eigen::Index dof = settings_.mass.size();
  VectorState adaptation = adaptation_;
  for (std::size_t k = 0; k < references_.size(); ++k)
  {
    const Place at = locate(t + static_cast<double>(k) * settings_.dt);
    references_[k] = at(&Node::mean);
    if (at.past)
      references_[k].tail(dof).setZero();
    if (!adapts_)
      continue;
    references_[k] += adaptation;
    adapt(adaptation);
  }
}

void ContactController::setNoise(double t, const MatrixDof& observed)
{
  const Node* const last = locate(t + settings_.horizon).second;
  for (const Node* node = locate(t).first; node <= last; ++node)
    nodes_[node - nodes_.data()].noise = covarianceMax(node->force_covariance, observed).diagonal().cwiseMax(0.0);
}

void ContactController::setAxis(Eigen::Index axis, double t)
{
  const bool by_covariance = settings_.weighting == "covariance";
  const StateWeights& weights = by_covariance ? settings_.covariance_weights : settings_.identity_weights;
  const Eigen::Index dof = settings_.mass.size();
  Problem& problem = problems_[axis];
  for (std::size_t k = 0; k <= problem.stages.size(); ++k)
  {
    const Place at = locate(t + static_cast<double>(k) * settings_.dt);
    Eigen::Matrix2d& Q = k < problem.stages.size() ? problem.stages[k].Q : problem.terminal.Q;
    Q(0, 0) = weights.position / (by_covariance ? at(&Node::variance, axis) + settings_.covariance_floor : 1.0);
    Q(1, 1) = weights.velocity / (by_covariance ? at(&Node::variance, dof + axis) + settings_.covariance_floor : 1.0);
    if (k == problem.stages.size())
      break;
    LqStage<2, 1>& stage = problem.stages[k];
    problem.noise[0].factor[k] = stage.B * std::sqrt(at(&Node::noise, axis));
    if (settings_.law != "preview")
      continue;
    const Eigen::Vector2d now(references_[k](axis), references_[k](dof + axis));
    const Eigen::Vector2d next(references_[k + 1](axis), references_[k + 1](dof + axis));
    stage.d = stage.A * now - next;
    if (adapts_)  // then u_f has the mean u_0, else it is noise about 0
      stage.d += stage.B * bias_(axis);
  }
}

std::optional<FeedbackPolicy> ContactController::plan(const phri_core::Observation& observation)
{
  failure_ = unusable(observation);
  if (!failure_.empty())
    return std::nullopt;
  const double t = observation.t;
  const Eigen::Index dof = settings_.mass.size();
  observe(t, observation.environment_wrench);
  if (adapts_ && planned_)
    for (long steps = std::lround((t - planned_at_) / settings_.dt); steps > 0; --steps)
      adapt(adaptation_);
  planned_at_ = t;
  planned_ = true;
  const ForceMoments moments = window_.moments(t);
  bias_ = moments.mean;
  setReferences(t);
  // about u_0 only where the reference accounts for all of u_0
  setNoise(t, adapts_ && lambda_ == 1.0 ? moments.covariance : moments.second_moment);

  ContactPlan report;
  report.t = t;
  report.bias = bias_;
  report.adaptation = adaptation_;
  report.reference = references_.front();
  report.noise_variance = report.stiffness = report.velocity_gain = VectorDof::Zero(dof);
  const Place start = locate(t);
  std::vector<FeedbackPolicy::Stage> stages(std::lround(settings_.validity / settings_.dt));
  for (std::size_t k = 0; k < stages.size(); ++k)
  {
    stages[k].gain.setZero(dof, 2 * dof);
    stages[k].reference = references_[k];
    stages[k].feedforward = -locate(t + static_cast<double>(k) * settings_.dt)(&Node::force);
  }
  for (Eigen::Index i = 0; i < dof; ++i)
  {
    setAxis(i, t);
    const FallbackReport fallback = solveWithFallback(problems_[i], RiskSensitive{ { theta_ } }, solution_);
    if (fallback.used == RiskFallback::NoPolicy)
    {
      failure_ = "no policy exists on axis " + std::to_string(i) + ": the recursion broke down at stage " +
                 std::to_string(solution_.status.stage);
      return std::nullopt;
    }
    report.fallback = std::max(report.fallback, fallback.used);
    report.scale = std::min(report.scale, fallback.scale);
    const double share = 1.0 / settings_.force_gain(i);  // the loop renders K_f^-1 times (5.45)
    for (std::size_t k = 0; k < stages.size(); ++k)
    {
      stages[k].gain(i, i) = share * solution_.gains[k](0);
      stages[k].gain(i, dof + i) = settings_.clamp_velocity_gain ? 0.0 : share * solution_.gains[k](1);
      stages[k].feedforward(i) += share * solution_.feedforward[k](0);
    }
    report.noise_variance(i) = start(&Node::noise, i);
    report.stiffness(i) = -solution_.gains.front()(0);
    report.velocity_gain(i) = settings_.clamp_velocity_gain ? 0.0 : -solution_.gains.front()(1);
  }
  last_ = report;
  return FeedbackPolicy(t, settings_.dt, std::move(stages), source_);
}

const std::vector<std::string>& contactControllerNames()
{
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const Kind& kind : kKinds)
      list.push_back(kind.name);
    return list;
  }();
  return names;
}
}  // namespace phri_control
