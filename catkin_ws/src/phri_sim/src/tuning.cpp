#include "phri_sim/tuning.hpp"

namespace phri_sim
{
namespace
{
constexpr double kLightest = 1.0, kHeaviest = 500.0;           // [kg]
constexpr double kLeastDamping = 40.0, kMostDamping = 2000.0;  // [Ns/m]
}  // namespace

Tuning::Tuning(const Experiment& experiment)
  : assistance(experiment.assistance), mass(experiment.loop.mass(0)), damping(experiment.loop.damping(0))
{
}

phri_core::ParameterTable Tuning::table()
{
  phri_core::ParameterTable all = phri_control::parameterTable(assistance);
  all.number("admittance/mass", &mass, "kg", kLightest, kHeaviest, "rendered mass along both axes", true)
      .number("admittance/damping", &damping, "Ns/m", kLeastDamping, kMostDamping, "rendered damping along both axes",
              true);
  return all.tunable();
}

void Tuning::apply(Experiment& experiment) const
{
  if (mass != experiment.loop.mass(0))
    experiment.loop.mass.setConstant(mass);
  if (damping != experiment.loop.damping(0))
    experiment.loop.damping.setConstant(damping);
  experiment.assistance = assistance;
  experiment.assistance.mass = experiment.loop.mass;
  experiment.assistance.damping = experiment.loop.damping;
}
}  // namespace phri_sim
