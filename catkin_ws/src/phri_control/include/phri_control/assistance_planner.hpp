#pragma once
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "phri_control/assistance.hpp"

namespace phri_control
{
/// The slow half of the assistance: the controller in force, its settings and the gate of 5.1.1. `plan` belongs to one
/// thread (it takes as long as a plan takes); the requests may come from any other, act with the next plan, and leave
/// everything as it was when they throw. After a request the loop cross-fades, for the policies' generation changes.
class AssistancePlanner
{
public:
  /// Throws std::invalid_argument as makeAssistance does. `gate` [m]; 0: none.
  AssistancePlanner(const std::string& controller, const AssistanceSettings& settings, double gate);

  /// The policy to adopt; nothing, and the old one stays, without a prediction, with one beyond the gate, or when the
  /// plan failed.
  std::optional<FeedbackPolicy> plan(const phri_core::Observation& observation,
                                     const std::optional<phri_core::Prediction>& prediction);

  /// Another controller of the catalogue.
  void select(const std::string& controller);
  /// Other settings, of the rendered mass and damping too.
  void retune(const AssistanceSettings& settings);

  std::string controller() const;
  int failures() const;

private:
  mutable std::mutex mutex_;
  std::string name_;
  AssistanceSettings settings_;
  double gate_;
  int rotations_;
  std::shared_ptr<AssistanceController> controller_;
  int generation_ = 0, failures_ = 0;
};
}  // namespace phri_control
