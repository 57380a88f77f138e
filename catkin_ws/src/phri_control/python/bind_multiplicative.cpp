// Multiplicative noise in Python: MultiplicativeNoiseProblem, solve, evaluate, mean_square_gain.
#include "arrays.hpp"
#include "phri_control/multiplicative_noise.hpp"

using namespace phri_control;
using namespace phri_control::python;

namespace
{
using Problem = MultiplicativeNoiseProblem<>;
using Points = ExpansionPoints<>;
using Evaluation = MultiplicativeEvaluation<>;
using OptionalAttitude = std::optional<Attitude>;
using OptionalArray = std::optional<Array>;

/// A solution that can follow its mean trajectory.
struct Solution : MultiplicativeSolution<>
{
  Problem problem;
};

void addChannel(Problem& problem, const std::string& name, const OptionalArray& state, const OptionalArray& control,
                const OptionalArray& constant)
{
  for (const NoiseSource& source : problem.lq.noise)
    if (source.name == name)
      throw py::value_error("add_multiplicative_noise(\"" + name +
                            "\"): an additive source has this name already; pass its columns as constant=");
  if (!state && !control && !constant)
    throw py::value_error("add_multiplicative_noise(\"" + name +
                          "\"): give at least one of state=, control=, constant=");
  const Eigen::Index n = problem.lq.stateSize(), m = problem.lq.controlSize();
  const struct
  {
    const char* name;
    const OptionalArray& array;
    bool vector;
    Eigen::Index start, cols;
  } parts[] = { { "state", state, false, 0, n },
                { "control", control, false, n, m },
                { "constant", constant, true, n + m, 1 } };
  std::optional<py::ssize_t> stages;
  std::vector<std::optional<Stack>> stacks;
  for (const auto& part : parts)
  {
    stacks.push_back(part.array ? std::optional<Stack>(Stack(part.name, *part.array, part.vector)) : std::nullopt);
    if (!stacks.back())
      continue;
    phri_core::requireShape(part.name, stacks.back()->at(0), n, part.cols);
    stacks.back()->agree(stages);
  }
  NoiseChannel channel;
  for (py::ssize_t k = 0; k < stages.value_or(1); ++k)
  {
    channel.map.push_back(Eigen::MatrixXd::Zero(n, n + m + 1));
    for (int i = 0; i < 3; ++i)
      if (stacks[i])
        channel.map.back().middleCols(parts[i].start, parts[i].cols) = stacks[i]->at(k);
  }
  detail::requireChannels({ name, { channel } }, n, m, problem.lq.horizon());
  for (MultiplicativeSource& source : problem.noise)
    if (source.name == name)
    {
      source.channels.push_back(channel);
      return;
    }
  problem.noise.push_back({ name, { channel } });
}

Points makePoints(const OptionalArray& states, const OptionalArray& controls)
{
  if (states.has_value() != controls.has_value())
    throw py::value_error("states and controls: give both or none");
  Points points;
  if (!states)
    return points;
  const Stack x("states", *states, true), u("controls", *controls, true);
  for (const Eigen::MatrixXd& value : x.all())
    points.states.push_back(value);
  for (const Eigen::MatrixXd& value : u.all())
    points.controls.push_back(value);
  return points;
}

Solution solveKeeping(const Problem& problem, const OptionalAttitude& attitude, const OptionalArray& states,
                      const OptionalArray& controls)
{
  Solution solution;
  MultiplicativeSolution<>& plain = solution;
  const Points points = makePoints(states, controls);
  if (attitude)
    plain = std::visit([&](const auto& some) { return solve(problem, some, points); }, *attitude);
  else
    plain = solve(problem);
  solution.problem = problem;
  return solution;
}

Evaluation evaluateArrays(const Problem& problem, const OptionalAttitude& attitude, const Array& gains,
                          const Array& feedforward, const OptionalArray& states, const OptionalArray& controls)
{
  const PolicyStages policy = policyStages(problem.lq.horizon(), gains, feedforward);
  const Points points = makePoints(states, controls);
  if (!attitude)
    return evaluate(problem, policy.gains, policy.feedforward);
  return std::visit([&](const auto& some) { return evaluate(problem, some, policy.gains, policy.feedforward, points); },
                    *attitude);
}

double valueAt(const Evaluation& self, const Eigen::VectorXd& x0)
{
  phri_core::requireShape("x0", x0, self.values.front().w.size(), 1);
  return self.value(x0);
}

std::vector<double> each(const std::vector<QuadraticValue<>>& values, const Eigen::VectorXd& x0)
{
  std::vector<double> numbers;
  for (const QuadraticValue<>& value : values)
  {
    phri_core::requireShape("x0", x0, value.w.size(), 1);
    numbers.push_back(value(x0));
  }
  return numbers;
}

py::tuple trajectory(const Solution& self, const Eigen::VectorXd& x0)
{
  const Points points = expandAlong(self.problem, self.gains, self.feedforward, x0);
  const auto same = [](const Eigen::VectorXd& item) -> const Eigen::VectorXd& { return item; };
  return py::make_tuple(stacked(points.states, same, true), stacked(points.controls, same, true));
}

Eigen::MatrixXd stationary(const Problem& problem, double tolerance, int max_iterations)
{
  const MeanSquareGain result = meanSquareGain(problem, tolerance, max_iterations);
  if (result)
    return result.gain;
  const std::string words =
      result.status == MeanSquareGain::Status::NotStabilisable
          ? "mean_square_gain: no gain keeps E |xi|^2 finite under this noise"
          : "mean_square_gain: no convergence in " + std::to_string(result.iterations) + " stages";
  PyErr_SetString(PyExc_ArithmeticError, words.c_str());
  throw py::error_already_set();
}
}  // namespace

void phri_control::python::bindMultiplicative(py::module_& m)
{
  py::class_<Problem>(
      m, "MultiplicativeNoiseProblem",
      "A LinearQuadraticProblem (copied, with its additive sources) plus noise that grows with state and "
      "control: xi+ = A xi + B u + drift + eps + sum_j (C_j xi + D_j u + e_j) w_j, w_j ~ N(0, 1).")
      .def(py::init([](const LinearQuadraticProblem<>& lq) {
             return Problem{ lq, {} };
           }),
           py::arg("problem"))
      .def("add_multiplicative_noise", &addChannel, py::arg("name"), py::kw_only(), py::arg("state") = py::none(),
           py::arg("control") = py::none(), py::arg("constant") = py::none(),
           "Adds a channel (C xi + D u + e) w to source `name`, made at its first channel: state C (n, n), control D "
           "(n, m), constant e (n,), or (T, ...). Channels of one source act together; attitudes weigh sources.")
      .def_property_readonly(
          "noise",
          [](const Problem& problem) {
            std::vector<std::string> names;
            for (const NoiseSource& source : problem.lq.noise)
              names.push_back(source.name);
            for (const MultiplicativeSource& source : problem.noise)
              names.push_back(source.name);
            return names;
          },
          "names of the sources as an attitude counts them: the additive ones first");

  py::class_<Evaluation>(m, "MultiplicativeEvaluation", "Value of a policy under multiplicative noise.")
      .def("value", &valueAt, py::arg("x0"), "The criterion from state x0 (n,) of stage 0 on.")
      .def(
          "values", [](const Evaluation& self, const Eigen::VectorXd& x0) { return each(self.values, x0); },
          py::arg("x0"), "Per source: mean of J, or the risk-sensitive value. One number without an attitude.")
      .def(
          "variances", [](const Evaluation& self, const Eigen::VectorXd& x0) { return each(self.variances, x0); },
          py::arg("x0"),
          "Per source: variance of J to second order about the expansion points; of CostCumulants only.");
  py::class_<Solution, Evaluation>(m, "MultiplicativeSolution", "Policy u = gains[k] xi + feedforward[k].")
      .def_property_readonly("gains", &gainsOf<Solution>, "(T, m, n)")
      .def_property_readonly("feedforward", &feedforwardOf<Solution>, "(T, m)")
      .def("mean_trajectory", &trajectory, py::arg("x0"),
           "Mean states (T, n) and controls (T, m) from x0: as `states` and `controls`, the points to expand about.");

  m.def("solve", &solveKeeping, py::arg("problem"), py::arg("attitude") = py::none(), py::kw_only(),
        py::arg("states") = py::none(), py::arg("controls") = py::none(),
        "Minimises the expected cost (exact), CostCumulants with K = 2 or RiskSensitive (to second order about states "
        "(T, n) and controls (T, m), 0 if not given). Raises RiskBreakdown where there is no policy.");
  m.def("evaluate", &evaluateArrays, py::arg("problem"), py::arg("attitude"), py::arg("gains"), py::arg("feedforward"),
        py::kw_only(), py::arg("states") = py::none(), py::arg("controls") = py::none(),
        "Value of the policy gains (T, m, n), feedforward (T, m); attitude None: the expected cost.");
  m.def("mean_square_gain", &stationary, py::arg("problem"), py::arg("tolerance") = 1e-13,
        py::arg("max_iterations") = 100000,
        "Gain (m, n) of the infinite horizon for the expected cost, from the first stage. Raises ArithmeticError when "
        "the noise is too strong for any gain, or undecided.");
}
