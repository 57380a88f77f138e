#include "phri_learning/behavior_models.hpp"

#include <cmath>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "phri_core/check.hpp"

namespace phri_learning
{
namespace
{
void fill(const phri_core::Observation& observation, int dof, Eigen::Ref<Eigen::VectorXd> row)
{
  if (observation.state.size() != 2 * dof || observation.human_wrench.size() != dof)
    throw std::invalid_argument("observation has " + std::to_string(observation.state.size()) + " states and " +
                                std::to_string(observation.human_wrench.size()) + " wrench components, expected " +
                                std::to_string(2 * dof) + " and " + std::to_string(dof));
  if (!observation.state.allFinite() || !observation.human_wrench.allFinite())
  {
    phri_core::requireFinite("observed state", observation.state);
    phri_core::requireFinite("observed human_wrench", observation.human_wrench);
  }
  row.head(2 * dof) = observation.state;
  row.tail(dof) = observation.human_wrench;
}
template <typename Value>
Value named(const std::string& key, const std::string& name, const std::vector<std::pair<std::string, Value>>& known)
{
  std::string names;
  for (const auto& [text, value] : known)
  {
    if (text == name)
      return value;
    names += (names.empty() ? "'" : "', '") + text;
  }
  throw std::invalid_argument(key + " = '" + name + "', expected one of " + names + "'");
}

int recognised(const TimeHmmModelSettings& settings)
{
  phri_core::requireRange("dof", settings.dof, 1, phri_core::kMaxDof, "");
  return settings.recognition == Recognition::kAll      ? 0
         : settings.recognition == Recognition::kMotion ? 2 * settings.dof
                                                        : settings.dof;
}
}  // namespace

Reference referenceNamed(const std::string& name)
{
  return named<Reference>("reference", name,
                          { { "path", Reference::kPath }, { "displacement", Reference::kDisplacement } });
}

ForecastSettings forecastNamed(const std::string& name)
{
  using Pair = std::pair<Reference, TimeEstimate>;
  ForecastSettings settings;
  std::tie(settings.reference, settings.time) =
      named<Pair>("predictor", name,
                  { { "thesis", { Reference::kPath, TimeEstimate::kThesis } },
                    { "entry_corrected", { Reference::kPath, TimeEstimate::kEntryCorrected } },
                    { "displacement", { Reference::kDisplacement, TimeEstimate::kRegressed } } });
  return settings;
}

TimeEstimate timeEstimateNamed(const std::string& name)
{
  return named<TimeEstimate>("time", name,
                             { { "thesis", TimeEstimate::kThesis },
                               { "entry_corrected", TimeEstimate::kEntryCorrected },
                               { "regressed", TimeEstimate::kRegressed } });
}

Recognition recognitionNamed(const std::string& name)
{
  return named<Recognition>(
      "recognition", name,
      { { "position", Recognition::kPosition }, { "motion", Recognition::kMotion }, { "all", Recognition::kAll } });
}

Eigen::VectorXd observationVector(const phri_core::Observation& observation, int dof)
{
  phri_core::requireRange("dof", dof, 1, phri_core::kMaxDof, "");
  Eigen::VectorXd row(3 * dof);
  fill(observation, dof, row);
  return row;
}

Eigen::MatrixXd demonstration(const std::vector<phri_core::Observation>& observations, int dof)
{
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(observations.size()), 3 * dof);
  for (std::size_t t = 0; t < observations.size(); ++t)
    rows.row(static_cast<Eigen::Index>(t)) = observationVector(observations[t], dof);
  return rows;
}

TimeHmmModel::TimeHmmModel(std::shared_ptr<const TimeHmm> model, const TimeHmmModelSettings& settings)
  : settings_(settings), tracker_(std::move(model), settings.window, recognised(settings))
{
  if (tracker_.model().dimension() != 3 * settings_.dof)
    throw std::invalid_argument("model has " + std::to_string(tracker_.model().dimension()) + " dimensions, expected " +
                                std::to_string(3 * settings_.dof) + " ([x; xdot; u_h] of " +
                                std::to_string(settings_.dof) + " degrees of freedom)");
  forecast_.reference = settings_.reference;
  forecast_.time = settings_.time;
  forecast_.velocity_first = settings_.dof;
  forecast_.velocity_count = settings_.adapt_pace ? settings_.dof : 0;
  sample_.resize(3 * settings_.dof);
}

void TimeHmmModel::reset()
{
  tracker_.reset();
}

void TimeHmmModel::observe(const phri_core::Observation& observation)
{
  fill(observation, settings_.dof, sample_);
  tracker_.observe(sample_);
  t_ = observation.t;
}

std::optional<phri_core::Prediction> TimeHmmModel::predict(double horizon, double dt)
{
  phri_core::requireRange("dt", dt, 1e-6, 1e3, "s");
  phri_core::requireRange("horizon", horizon, 0.0, 1e4 * dt, "s");
  if (!tracker_.started())
    return std::nullopt;
  const int steps = static_cast<int>(std::lround(horizon / dt)), dof = settings_.dof;
  phri_core::Prediction prediction;
  prediction.t0 = t_;
  prediction.dt = dt;
  prediction.model = "time_hmm";
  prediction.desired_state.reserve(static_cast<std::size_t>(steps) + 1);
  prediction.human_wrench.reserve(static_cast<std::size_t>(steps) + 1);
  for (int k = 0; k <= steps; ++k)
  {
    tracker_.forecast(k * dt, forecast_, &joint_);
    prediction.desired_state.push_back(
        { joint_.mean.head(2 * dof), joint_.covariance.topLeftCorner(2 * dof, 2 * dof) });
    prediction.human_wrench.push_back({ joint_.mean.tail(dof), joint_.covariance.bottomRightCorner(dof, dof) });
  }
  return prediction;
}
}  // namespace phri_learning
