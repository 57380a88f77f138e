#include "phri_control/assistance_settings.hpp"

#include <algorithm>
#include <stdexcept>

#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
/// One numeric setting; the table and the validation both read this list.
struct NumberSetting
{
  const char *key, *unit;
  double& (*field)(AssistanceSettings&);
  double low, high;
  bool tunable;
  const char* help;
};

const NumberSetting kNumbers[] = {
  { "dt", "s", [](AssistanceSettings& s) -> double& { return s.dt; }, 1e-4, 0.02, false,
    "period of a stage of the policy" },
  { "horizon", "s", [](AssistanceSettings& s) -> double& { return s.horizon; }, 0.02, 1.0, false,
    "length of a policy" },
  { "q_scale", "", [](AssistanceSettings& s) -> double& { return s.q_scale; }, 0.0, 1e3, true,
    "factor on the state weights of lqr and mahalanobis alike" },
  { "control_weight", "1/N^2", [](AssistanceSettings& s) -> double& { return s.control_weight; }, 1e-9, 1e9, false,
    "weight R of the assistance force" },
  { "lqr/position_weight", "1/m^2", [](AssistanceSettings& s) -> double& { return s.lqr.position; }, 0.0, 1e14, true,
    "weight of the position error per sample" },
  { "lqr/velocity_weight", "s^2/m^2", [](AssistanceSettings& s) -> double& { return s.lqr.velocity; }, 0.0, 1e14, true,
    "weight of the velocity error per sample" },
  { "mahalanobis/position_weight", "", [](AssistanceSettings& s) -> double& { return s.mahalanobis.position; }, 0.0,
    1e9, true, "weight of the position error per predicted variance" },
  { "mahalanobis/velocity_weight", "", [](AssistanceSettings& s) -> double& { return s.mahalanobis.velocity; }, 0.0,
    1e9, true, "weight of the velocity error per predicted variance" },
  { "mahalanobis/covariance_floor", "m^2, m^2/s^2", [](AssistanceSettings& s) -> double& { return s.covariance_floor; },
    1e-12, 1.0, false, "added to the diagonal of the predicted covariance" },
  { "pd/stiffness", "N/m", [](AssistanceSettings& s) -> double& { return s.pd_stiffness; }, 0.0, 1e4, true,
    "gain on the position error" },
  { "pd/damping", "Ns/m", [](AssistanceSettings& s) -> double& { return s.pd_damping; }, 0.0, 1e4, true,
    "gain on the velocity error" },
  { "pd/turn_stiffness", "Nm/rad", [](AssistanceSettings& s) -> double& { return s.pd_turn_stiffness; }, 0.0, 1e4, true,
    "gain on the error of an angle" },
  { "pd/turn_damping", "Nms/rad", [](AssistanceSettings& s) -> double& { return s.pd_turn_damping; }, 0.0, 1e4, true,
    "gain on the error of an angular rate" },
  { "pd/lookahead", "s", [](AssistanceSettings& s) -> double& { return s.pd_lookahead; }, 0.0, 1.0, true,
    "the reference is the prediction for so much later" },
};

const std::vector<std::string> kLaws = { "error_feedback", "preview" };
}  // namespace

phri_core::ParameterTable parameterTable(AssistanceSettings& settings)
{
  phri_core::ParameterTable table;
  table.text("law", &settings.law, kLaws,
             "error_feedback: u = L (xi - mu); preview adds the optimal feedforward of the tracking problem");
  for (const NumberSetting& number : kNumbers)
    table.number(number.key, &number.field(settings), number.unit, number.low, number.high, number.help,
                 number.tunable);
  return table;
}

void requireValid(AssistanceSettings settings)
{
  const Eigen::Index dof = settings.mass.size();
  if (dof < 1 || settings.damping.size() != dof)
    throw std::invalid_argument("AssistanceSettings: mass has " + std::to_string(dof) + " and damping " +
                                std::to_string(settings.damping.size()) + " elements, expected the same number, 1..6");
  phri_core::requireRange("AssistanceSettings: rotations", settings.rotations, 0, static_cast<double>(dof), "");
  for (Eigen::Index i = 0; i < dof; ++i)
  {
    phri_core::requireRange("AssistanceSettings: mass", settings.mass(i), 1e-3, 1e4, "kg, kgm2");
    phri_core::requireRange("AssistanceSettings: damping", settings.damping(i), 0.0, 1e5, "Ns/m, Nms/rad");
  }
  for (const NumberSetting& number : kNumbers)
    phri_core::requireRange("AssistanceSettings: " + std::string(number.key), number.field(settings), number.low,
                            number.high, number.unit);
  if (std::find(kLaws.begin(), kLaws.end(), settings.law) == kLaws.end())
    throw std::invalid_argument("AssistanceSettings: law = \"" + settings.law +
                                "\", expected error_feedback or preview");
}
}  // namespace phri_control
