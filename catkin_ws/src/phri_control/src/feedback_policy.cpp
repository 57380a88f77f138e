#include "phri_control/feedback_policy.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "phri_core/check.hpp"
#include "phri_core/safety.hpp"

namespace phri_control
{
namespace
{
void requireStage(const FeedbackPolicy::Stage& stage, std::size_t k, Eigen::Index dof)
{
  if (stage.gain.rows() != dof || stage.gain.cols() != 2 * dof || stage.reference.size() != 2 * dof ||
      stage.feedforward.size() != dof)
    throw std::invalid_argument("FeedbackPolicy: stage " + std::to_string(k) + " has a gain of " +
                                std::to_string(stage.gain.rows()) + " x " + std::to_string(stage.gain.cols()) +
                                ", a reference of " + std::to_string(stage.reference.size()) +
                                " and a feedforward of " + std::to_string(stage.feedforward.size()) +
                                " elements, expected m x 2m, 2m and m with m = " + std::to_string(dof));
  if (!stage.gain.allFinite() || !stage.reference.allFinite() || !stage.feedforward.allFinite())
    throw std::invalid_argument("FeedbackPolicy: stage " + std::to_string(k) + " has an element that is not finite");
}
}  // namespace

FeedbackPolicy::FeedbackPolicy(double t0, double dt, std::vector<Stage> stages, int source)
  : t0_(t0), dt_(dt), stages_(std::move(stages)), source_(source)
{
  if (!std::isfinite(t0_))
    throw std::invalid_argument("FeedbackPolicy: t0 = " + std::to_string(t0_) + " s, expected a finite time");
  phri_core::requireRange("FeedbackPolicy: dt", dt_, 1e-6, 1.0, "s");
  if (stages_.empty())
    throw std::invalid_argument("FeedbackPolicy: no stages, expected at least one");
  const Eigen::Index dof = stages_.front().gain.rows();
  if (dof < 1)
    throw std::invalid_argument("FeedbackPolicy: stage 0 has an empty gain, expected m x 2m with m = 1..6");
  for (std::size_t k = 0; k < stages_.size(); ++k)
    requireStage(stages_[k], k, dof);
}

double FeedbackPolicy::weight(double t) const noexcept
{
  if (empty() || !std::isfinite(t))
    return 0.0;
  return 1.0 - phri_core::smoothStep((t - horizonEnd()) / kFade);
}

const FeedbackPolicy::Stage& FeedbackPolicy::stageAt(double t) const noexcept
{
  constexpr double kTick =
      1e-6;  // of a stage: times are sums of decimal steps, and must not fall into the stage before
  const double k = std::floor((t - t0_) / dt_ + kTick);
  const double last = static_cast<double>(stages_.size() - 1);
  return stages_[static_cast<std::size_t>(k > 0.0 ? std::min(k, last) : 0.0)];
}

bool FeedbackPolicy::act(double t, const phri_core::VectorState& xi, phri_core::VectorDof& u) const noexcept
{
  const double share = weight(t);
  if (!(share > 0.0) || xi.size() != 2 * dof())
  {
    u.setZero(xi.size() / 2);
    return false;
  }
  const Stage& stage = stageAt(t);
  const phri_core::VectorState deviation = xi - stage.reference;
  u = stage.feedforward;
  u.noalias() += stage.gain.lazyProduct(deviation);
  u *= share;
  if (u.allFinite())
    return true;
  u.setZero();
  return false;
}
}  // namespace phri_control
