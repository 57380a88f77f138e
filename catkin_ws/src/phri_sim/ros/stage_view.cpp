#include "stage_view.hpp"

#include "planar_view.hpp"
#include "robot_view.hpp"

namespace phri_sim
{
bool hasView(const Experiment& experiment)
{
  return experiment.planar() || experiment.task == "transport";
}

std::unique_ptr<StageView> makeStageView(ros::NodeHandle& node, std::shared_ptr<const Experiment> experiment,
                                         const ros::Time& now)
{
  if (experiment->planar())
    return std::make_unique<PlanarView>(node, std::move(experiment), now);
  return std::make_unique<RobotView>(node, std::move(experiment), now);
}
}  // namespace phri_sim
