#include "phri_control/assistance_planner.hpp"

namespace phri_control
{
AssistancePlanner::AssistancePlanner(const std::string& controller, const AssistanceSettings& settings, double gate)
  : name_(controller),
    settings_(settings),
    gate_(gate),
    rotations_(settings.rotations),
    controller_(makeAssistance(controller, settings))
{
}

std::optional<FeedbackPolicy> AssistancePlanner::plan(const phri_core::Observation& observation,
                                                      const std::optional<phri_core::Prediction>& prediction)
{
  if (!prediction || !withinGate(observation, *prediction, gate_, rotations_))
    return std::nullopt;
  std::shared_ptr<AssistanceController> controller;
  int generation = 0;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    controller = controller_;
    generation = generation_;
  }
  std::optional<FeedbackPolicy> policy = controller->plan(observation, *prediction);
  if (policy)
    policy->setGeneration(generation);
  else
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++failures_;
  }
  return policy;
}

void AssistancePlanner::select(const std::string& controller)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  controller_ = makeAssistance(controller, settings_);
  name_ = controller;
  ++generation_;
}

void AssistancePlanner::retune(const AssistanceSettings& settings)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  controller_ = makeAssistance(name_, settings);
  settings_ = settings;
  ++generation_;
}

std::string AssistancePlanner::controller() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return name_;
}

int AssistancePlanner::failures() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return failures_;
}
}  // namespace phri_control
