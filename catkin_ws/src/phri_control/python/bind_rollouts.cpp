// Stochastic roll-outs of a policy in the true problem.
#include "arrays.hpp"
#include "phri_control/stochastic_rollout.hpp"

using namespace phri_control;
using namespace phri_control::python;

namespace
{
Array arrayOf(const py::object& policy, const char* field)
{
  if (!py::hasattr(policy, field))
    throw py::type_error(std::string("roll_out: policy has no ") + field +
                         ", expected an IterativeResult or an object with states (T + 1, n), controls (T, m) and "
                         "gains (T, m, n)");
  return policy.attr(field).cast<Array>();
}

int sourceOf(const PlanarScene& scene, const py::object& source)
{
  if (source.is_none())
    return -1;
  const std::vector<NoiseModel<>> noise = problemOf(scene).noise;
  if (py::isinstance<py::str>(source))
  {
    std::string known;
    for (std::size_t s = 0; s < noise.size(); ++s)
    {
      if (noise[s].name == source.cast<std::string>())
        return static_cast<int>(s);
      known += (s > 0 ? ", " : "") + noise[s].name;
    }
    throw py::value_error("roll_out: source \"" + source.cast<std::string>() + "\", expected one of " + known);
  }
  const int index = source.cast<int>();
  if (index < 0)
    throw py::value_error("roll_out: source = " + std::to_string(index) + ", expected at least 0, a name or None");
  return index;
}

/// Sizes known at compile time where the scene has one of them.
template <int N>
RollOuts simulate(const PlanarScene& scene, const Stack& states, const Stack& controls, const Stack& gains,
                  py::ssize_t horizon, const RollOutOptions& options)
{
  Trajectory<N, N == Eigen::Dynamic ? N : 2> nominal;
  LqPolicy<N, N == Eigen::Dynamic ? N : 2> policy;
  for (py::ssize_t k = 0; k < horizon; ++k)
  {
    nominal.states.push_back(states.at(k));
    nominal.controls.push_back(controls.at(k));
    policy.gains.push_back(gains.at(k));
  }
  nominal.states.push_back(states.at(horizon));
  const py::gil_scoped_release released;
  return rollOuts(scene, nominal, policy, options);
}

RollOuts rollOutOf(const PlanarScene& scene, const py::object& policy, int count, std::uint64_t seed,
                   const py::object& source)
{
  const Stack states("states", arrayOf(policy, "states"), true),
      controls("controls", arrayOf(policy, "controls"), true), gains("gains", arrayOf(policy, "gains"), false);
  const py::ssize_t horizon = scene.horizon;
  std::optional<py::ssize_t> samples = horizon + 1, stages = horizon;
  states.agree(samples);
  controls.agree(stages);
  gains.agree(stages);
  const auto require = [](const char* name, py::ssize_t size, py::ssize_t expected) {
    if (size != expected)
      throw py::value_error("roll_out: " + std::string(name) + " has " + std::to_string(size) +
                            " elements per stage, expected " + std::to_string(expected) +
                            " as in the joint state of the scene");
  };
  require("states", states.rows(), scene.stateSize());
  require("controls", controls.rows(), 2);
  require("a column of gains", gains.rows(), 2);
  require("a row of gains", gains.cols(), scene.stateSize());
  const RollOutOptions options{ count, seed, sourceOf(scene, source) };
  switch (scene.stateSize())
  {
    case 8:
      return simulate<8>(scene, states, controls, gains, horizon, options);
    case 12:
      return simulate<12>(scene, states, controls, gains, horizon, options);
    case 14:
      return simulate<14>(scene, states, controls, gains, horizon, options);
    default:
      return simulate<Eigen::Dynamic>(scene, states, controls, gains, horizon, options);
  }
}
}  // namespace

void phri_control::python::bindRollOuts(py::module_& m)
{
  py::class_<RollOuts>(m, "RollOuts", "Costs of simulated runs, one element or row per run.")
      .def_readonly("costs", &RollOuts::costs, "J (count,), things at uncertain places at the places drawn")
      .def_readonly("model_costs", &RollOuts::model_costs, "J (count,) with the problem's closed forms of their cost")
      .def_readonly(
          "distances", &RollOuts::distances,
          "(count, obstacles) smallest sqrt(d'Q d) to each obstacle, d between the positions and Q the weight "
          "of its cost; moving ones first, then static ones")
      .def_property_readonly("clearance", &RollOuts::clearance, "(count,) smallest distance; inf without obstacles")
      .def_property_readonly(
          "collided",
          [](const RollOuts& self) {
            const auto flags = self.collided();
            py::array_t<bool> array(flags.size());
            std::copy(flags.begin(), flags.end(), array.mutable_data());
            return array;
          },
          "(count,) clearance < 1: within the width of an obstacle at some sample, the first included");

  m.def("roll_out", &rollOutOf, py::arg("scene"), py::arg("policy"), py::arg("count") = RollOutOptions().count,
        py::kw_only(), py::arg("seed") = RollOutOptions().seed, py::arg("source") = py::none(),
        "Simulates `count` runs of a policy in the true dynamics with all noise and sums the true cost. policy: a\n"
        "result of PlanarScene.solve in the joint state, or any object with its states, controls and gains. source:\n"
        "name or index of the only source of noise that acts. Run i meets the same random numbers under every policy,\n"
        "whatever the count.");
}
