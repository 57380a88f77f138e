#pragma once
#include <memory>
#include <optional>
#include <vector>

#include "phri_sim/haptic_device.hpp"
#include "phri_sim/participant.hpp"
#include "phri_sim/route.hpp"
#include "phri_sim/stage.hpp"

namespace phri_sim
{
/// The two linear actuators in front of a picture (thesis A.1): walls, moving obstacles, a goal, perhaps a path to be
/// followed to its end.
class PlanarStage : public Stage
{
public:
  PlanarStage(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec, std::unique_ptr<Hand> hand);

  phri_core::VectorDof start() const override { return experiment_->scene->start; }
  phri_core::Measurement read(std::int64_t now_ns, const phri_core::VectorDof& assistance) noexcept override;
  void write(const phri_core::Command& command) noexcept override;
  bool arrived() const noexcept override { return arrived_; }

private:
  std::shared_ptr<const Experiment> experiment_;
  std::vector<MovingObstacle> obstacles_;
  HapticDevice device_;
  std::unique_ptr<Hand> hand_;
  std::optional<Route> path_;  // of a scene with a path, which is to be followed to its end
  double progress_ = 0.0;      // [m] along path_
  bool arrived_ = false;
};
}  // namespace phri_sim
