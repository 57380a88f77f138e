#include "phri_sim/stage.hpp"

#include <stdexcept>

#include "phri_sim/planar_stage.hpp"
#include "phri_sim/transport_stage.hpp"

namespace phri_sim
{
std::unique_ptr<Stage> makeStage(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec,
                                 std::unique_ptr<Hand> hand)
{
  if (experiment->task == "transport")
  {
    if (hand)
      throw std::invalid_argument("a hand that is not simulated moves the planar device only");
    return std::make_unique<TransportStage>(std::move(experiment), spec);
  }
  return std::make_unique<PlanarStage>(std::move(experiment), spec, std::move(hand));
}
}  // namespace phri_sim
