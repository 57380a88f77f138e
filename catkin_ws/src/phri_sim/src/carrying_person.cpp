#include "phri_sim/carrying_person.hpp"

#include <algorithm>

#include "phri_core/random.hpp"
#include "phri_sim/configuration.hpp"

namespace phri_sim
{
CarryingPopulation::CarryingPopulation()
{
  using P = CarryingPerson;
  constexpr auto normal = Trait::Shape::Normal, log_normal = Trait::Shape::LogNormal;
  traits = {
    { &P::speed, "speed", "m/s", log_normal, 0.165, 0.10, 0.14, 0.2, "comfortable speed with the load" },
    { &P::curvature_exponent, "curvature_exponent", "-", normal, 0.33, 0.05, 0.2, 0.45, "speed ~ curvature^-beta" },
    { &P::patience, "patience", "m", log_normal, 0.12, 0.2, 0.06, 0.25, "lag of the load that makes the person stop" },
    { &P::stiffness_forward, "stiffness_forward", "N/m", log_normal, 400.0, 0.35, 160.0, 1000.0, "arms, fore-aft" },
    { &P::stiffness_lateral, "stiffness_lateral", "-", normal, 0.625, 0.1, 0.35, 0.9, "share of fore-aft" },
    { &P::stiffness_vertical, "stiffness_vertical", "-", normal, 0.875, 0.1, 0.5, 1.2, "share of fore-aft" },
    { &P::stiffness_yaw, "stiffness_yaw", "Nm/rad", log_normal, 10.0, 0.35, 3.0, 33.0, "about the vertical" },
    { &P::stiffness_pitch, "stiffness_pitch", "-", normal, 1.2, 0.15, 0.7, 1.7, "share of yaw" },
    { &P::stiffness_roll, "stiffness_roll", "-", normal, 0.6, 0.1, 0.3, 1.0, "share of yaw" },
    { &P::damping_ratio, "damping_ratio", "-", normal, 0.7, 0.15, 0.4, 1.1, "zeta of arms and hands" },
    { &P::hand_mass, "hand_mass", "kg", log_normal, 3.2, 0.2, 1.8, 5.0, "reflected mass of both arms" },
    { &P::hand_inertia, "hand_inertia", "kgm2", log_normal, 0.019, 0.2, 0.01, 0.035, "reflected inertia" },
    { &P::reflex_share, "reflex_share", "-", normal, 0.3, 0.06, 0.15, 0.45, "part of the stiffness that is delayed" },
    { &P::muscle_lag, "muscle_lag", "s", normal, 0.045, 0.008, 0.03, 0.07, "each of two cascaded lags" },
    { &P::reflex_delay, "reflex_delay", "s", normal, 0.08, 0.015, 0.05, 0.12, "proprioceptive delay" },
    { &P::visual_delay, "visual_delay", "s", normal, 0.2, 0.03, 0.13, 0.28, "visual delay" },
    { &P::decision_delay, "decision_delay", "s", normal, 0.25, 0.04, 0.18, 0.35, "change of role" },
    { &P::visual_stiffness, "visual_stiffness", "N/m", log_normal, 20.0, 0.3, 5.0, 60.0, "slow correction" },
    { &P::weight_share, "weight_share", "-", normal, 0.5, 0.1, 0.0, 1.0, "share of the weight that is expected" },
    { &P::force_variation, "force_variation", "-", normal, 0.06, 0.02, 0.02, 0.12, "signal-dependent noise" },
    { &P::force_noise, "force_noise", "N", normal, 0.15, 0.05, 0.05, 0.3, "white noise" },
    { &P::torque_noise, "torque_noise", "Nm", normal, 0.01, 0.003, 0.002, 0.03, "white noise" },
    { &P::tremor, "tremor", "N", log_normal, 0.05, 0.5, 0.0, 0.2, "tremor amplitude" },
    { &P::gait_rate, "gait_rate", "1/s", normal, 1.8, 0.1, 1.6, 2.0, "steps per second" },
    { &P::gait_bob, "gait_bob", "m", normal, 0.01, 0.0015, 0.0075, 0.0125, "vertical amplitude, once a step" },
    { &P::gait_sway, "gait_sway", "m", normal, 0.005, 0.0015, 0.0025, 0.0075, "lateral amplitude, once in two steps" },
    { &P::trigger, "trigger", "Nm", log_normal, 0.6, 0.4, 0.0, 2.0, "yaw pulse before setting off" },
    { &P::leading, "leading", "-", normal, 0.85, 0.08, 0.5, 1.0, "role in translation: 1 leads, 0 follows" },
    { &P::turning, "turning", "-", normal, 0.3, 0.1, 0.0, 1.0, "role in yaw" },
    { &P::yield_force, "yield_force", "N", log_normal, 6.0, 0.4, 1.0, 18.0, "counter-pull that changes the role" },
    { &P::yielding, "yielding", "-", normal, 0.3, 0.35, -0.5, 1.0, "gives in (> 0) or fights (< 0)" },
    { &P::force_max, "force_max", "N", log_normal, 80.0, 0.15, 50.0, 120.0, "strength" },
    { &P::torque_max, "torque_max", "Nm", log_normal, 8.0, 0.15, 5.0, 12.0, "strength of the wrists" },
    { &P::grip_max, "grip_max", "N", log_normal, 40.0, 0.15, 25.0, 60.0, "along the object before the grip slips" },
  };
}

phri_core::ParameterTable CarryingPopulation::table()
{
  phri_core::ParameterTable table;
  for (CarryingTrait& trait : traits)
  {
    const bool log_normal = trait.shape == Trait::Shape::LogNormal;
    table.number(trait.key + "/median", &trait.median, trait.unit, trait.low, trait.high, trait.help)
        .number(trait.key + "/spread", &trait.spread, log_normal ? "-" : trait.unit, 0.0, log_normal ? 2.0 : trait.high,
                std::string(log_normal ? "coefficient of variation" : "standard deviation") + " between people");
  }
  return table;
}

CarryingPerson CarryingPopulation::person(std::uint64_t seed, int index) const
{
  CarryingPerson person;
  person.index = index;
  phri_core::Random random = phri_core::Random::stream(seed, "carrying person", index);
  for (const CarryingTrait& trait : traits)
  {
    const double value = trait.shape == Trait::Shape::Normal ? random.normal(trait.median, trait.spread)
                                                             : random.logNormal(trait.median, trait.spread);
    person.*trait.field = std::clamp(value, trait.low, trait.high);
  }
  return person;
}

CarryingPopulation loadCarryingPopulation(const std::string& name_or_path)
{
  const std::string path = findConfiguration("participants", name_or_path);
  CarryingPopulation population;
  population.table().assign(path, loadYaml(path));
  return population;
}
}  // namespace phri_sim
