#include "phri_sim/participant.hpp"

#include <algorithm>
#include <cmath>

#include "phri_core/random.hpp"
#include "phri_sim/configuration.hpp"

namespace phri_sim
{
namespace
{
constexpr double kNoviceStiffness = 1.3;  // a novice co-contracts: K_1 / K
constexpr double kPractice = 3.0;         // [trials] in which the extra stiffness fades
}  // namespace

double Participant::internalModelAfter(int trials) const
{
  double a = internal_model;
  for (int n = 0; n < trials; ++n)
    a += learning_rate * (1.0 - a) - forgetting * a;
  return a;
}

double Participant::stiffnessAfter(int trials) const
{
  return stiffness * (1.0 + (kNoviceStiffness - 1.0) * std::exp(-trials / kPractice));
}

Population::Population()
{
  using P = Participant;
  constexpr auto normal = Trait::Shape::Normal, log_normal = Trait::Shape::LogNormal;
  traits = {
    { &P::speed, "speed", "m/s", log_normal, 0.075, 0.20, 0.03, 0.15, "comfortable speed" },
    { &P::curvature_exponent, "curvature_exponent", "-", normal, 0.33, 0.05, 0.2, 0.45, "speed ~ curvature^-beta" },
    { &P::steering, "steering", "s", log_normal, 0.2, 0.2, 0.05, 1.0, "steering law: speed <= width / this" },
    { &P::clearance, "clearance", "m", log_normal, 0.012, 0.25, 0.004, 0.03, "comfortable distance from walls" },
    { &P::side_bias, "side_bias", "m", normal, 0.0, 0.0015, -0.006, 0.006, "constant lateral offset" },
    { &P::wander, "wander", "m", log_normal, 0.002, 0.3, 0.0, 0.01, "lateral variation between trials" },
    { &P::stiffness, "stiffness", "N/m", log_normal, 220.0, 0.35, 80.0, 900.0, "arm stiffness, strong axis" },
    { &P::stiffness_ratio, "stiffness_ratio", "-", normal, 0.40, 0.09, 0.25, 0.6, "weak over strong axis" },
    { &P::stiffness_angle, "stiffness_angle", "rad", normal, 0.0, 0.13, -0.27, 0.27, "tilt of the strong axis" },
    { &P::damping_ratio, "damping_ratio", "-", normal, 0.7, 0.15, 0.35, 1.1, "zeta of the arm" },
    { &P::hand_mass, "hand_mass", "kg", log_normal, 1.3, 0.25, 0.7, 2.3, "reflected mass of hand and arm" },
    { &P::muscle_lag, "muscle_lag", "s", normal, 0.045, 0.008, 0.03, 0.07, "each of two cascaded lags" },
    { &P::reflex_delay, "reflex_delay", "s", normal, 0.08, 0.015, 0.05, 0.12, "proprioceptive delay" },
    { &P::visual_delay, "visual_delay", "s", normal, 0.2, 0.03, 0.13, 0.28, "visual delay" },
    { &P::decision_delay, "decision_delay", "s", normal, 0.25, 0.04, 0.18, 0.35, "obstacles, change of role" },
    { &P::force_variation, "force_variation", "-", normal, 0.06, 0.02, 0.02, 0.12, "signal-dependent noise" },
    { &P::force_noise, "force_noise", "N", normal, 0.15, 0.05, 0.05, 0.3, "white noise" },
    { &P::tremor, "tremor", "N", log_normal, 0.05, 0.5, 0.0, 0.2, "tremor amplitude" },
    { &P::internal_model, "internal_model", "-", normal, 0.75, 0.12, 0.4, 1.0, "fed-forward share, first trial" },
    { &P::learning_rate, "learning_rate", "1/trial", normal, 0.35, 0.1, 0.05, 0.8, "eta" },
    { &P::forgetting, "forgetting", "1/trial", normal, 0.03, 0.01, 0.0, 0.1, "lambda" },
    { &P::visual_stiffness, "visual_stiffness", "N/m", log_normal, 60.0, 0.3, 10.0, 200.0, "slow correction" },
    { &P::visual_damping, "visual_damping", "Ns/m", log_normal, 60.0, 0.3, 10.0, 200.0, "slow correction" },
    { &P::force_max, "force_max", "N", log_normal, 70.0, 0.2, 40.0, 120.0, "strength" },
    { &P::yield_force, "yield_force", "N", log_normal, 4.0, 0.4, 1.0, 12.0, "counter-pull that changes the role" },
    { &P::yielding, "yielding", "-", normal, 0.3, 0.35, -0.5, 1.0, "gives in (> 0) or fights (< 0)" },
  };
}

phri_core::ParameterTable Population::table()
{
  phri_core::ParameterTable table;
  for (Trait& trait : traits)
  {
    const bool log_normal = trait.shape == Trait::Shape::LogNormal;
    table.number(trait.key + "/median", &trait.median, trait.unit, trait.low, trait.high, trait.help)
        .number(trait.key + "/spread", &trait.spread, log_normal ? "-" : trait.unit, 0.0, log_normal ? 2.0 : trait.high,
                std::string(log_normal ? "coefficient of variation" : "standard deviation") + " between people");
  }
  return table;
}

Participant Population::person(std::uint64_t seed, int index) const
{
  Participant person;
  person.index = index;
  phri_core::Random random = phri_core::Random::stream(seed, "participant", index);
  for (const Trait& trait : traits)
  {
    const double value = trait.shape == Trait::Shape::Normal ? random.normal(trait.median, trait.spread)
                                                             : random.logNormal(trait.median, trait.spread);
    person.*trait.field = std::clamp(value, trait.low, trait.high);
  }
  return person;
}

Population loadPopulation(const std::string& name_or_path)
{
  const std::string path = findConfiguration("participants", name_or_path);
  Population population;
  population.table().assign(path, loadYaml(path));
  return population;
}
}  // namespace phri_sim
