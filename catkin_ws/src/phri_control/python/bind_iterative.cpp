// The iterative solver in Python: solve_iterative over any dynamics and cost given as functions.
#include <pybind11/functional.h>

#include "arrays.hpp"
#include "phri_control/iterative_solver.hpp"

using namespace phri_control;
using namespace phri_control::python;

namespace
{
using Result = IterativeResult<>;
using Vector = Eigen::VectorXd;

constexpr const char* kFallbacks[] = { "none", "reduced", "risk neutral" };

Eigen::MatrixXd matrixOf(const char* name, const py::handle& value, Eigen::Index rows, Eigen::Index cols)
{
  const Eigen::MatrixXd matrix = value.cast<Eigen::MatrixXd>();
  phri_core::requireShape(name, matrix, rows, cols);
  return matrix;
}

Vector vectorOf(const char* name, const py::handle& value, Eigen::Index size)
{
  const Vector vector = value.cast<Vector>();
  phri_core::requireShape(name, vector, size, 1);
  return vector;
}

class PythonDynamics : public Dynamics<>
{
public:
  PythonDynamics(py::function step, py::object derivatives, Eigen::Index n, Eigen::Index m)
    : step_(std::move(step)), derivatives_(std::move(derivatives)), n_(n), m_(m)
  {
  }
  Eigen::Index stateSize() const override { return n_; }
  Eigen::Index controlSize() const override { return m_; }
  void step(int k, const State& x, const Control& u, State& next) const override
  {
    next = vectorOf("dynamics(k, x, u)", step_(k, x, u), n_);
  }
  void linearise(int k, const State& x, const Control& u, StateMatrix& A, InputMatrix& B) const override
  {
    if (derivatives_.is_none())
      return Dynamics<>::linearise(k, x, u, A, B);
    const py::tuple both = derivatives_(k, x, u);
    if (both.size() != 2)
      throw py::value_error("dynamics_derivatives(k, x, u): expected a pair (A, B)");
    A = matrixOf("dynamics_derivatives(k, x, u)[0]", both[0], n_, n_);
    B = matrixOf("dynamics_derivatives(k, x, u)[1]", both[1], n_, m_);
  }

private:
  py::function step_;
  py::object derivatives_;
  Eigen::Index n_, m_;
};

class PythonCost : public CostFunction<>
{
public:
  PythonCost(py::function running, py::object terminal, py::object expansion, py::object terminal_expansion)
    : running_(std::move(running)),
      terminal_(std::move(terminal)),
      expansion_(std::move(expansion)),
      terminal_expansion_(std::move(terminal_expansion))
  {
  }
  double running(int k, const State& x, const Control& u) const override { return running_(k, x, u).cast<double>(); }
  double terminal(const State& x) const override { return terminal_.is_none() ? 0.0 : terminal_(x).cast<double>(); }
  void expand(int k, const State& x, const Control& u, CostExpansion<>& expansion) const override
  {
    if (expansion_.is_none())
      return CostFunction<>::expand(k, x, u, expansion);
    const py::tuple parts = expansion_(k, x, u);
    if (parts.size() != 4 && parts.size() != 5)
      throw py::value_error("cost_derivatives(k, x, u): expected (q, Q, r, R) or (q, Q, r, R, S)");
    expansion.q0 = running(k, x, u);
    expansion.q = vectorOf("cost_derivatives(k, x, u): q", parts[0], x.size());
    expansion.Q = matrixOf("cost_derivatives(k, x, u): Q", parts[1], x.size(), x.size());
    expansion.r = vectorOf("cost_derivatives(k, x, u): r", parts[2], u.size());
    expansion.R = matrixOf("cost_derivatives(k, x, u): R", parts[3], u.size(), u.size());
    expansion.has_cross = parts.size() == 5;
    if (expansion.has_cross)
      expansion.S = matrixOf("cost_derivatives(k, x, u): S", parts[4], u.size(), x.size());
  }
  void expandTerminal(const State& x, LqTerminal<>& expansion) const override
  {
    if (terminal_expansion_.is_none())
      return CostFunction<>::expandTerminal(x, expansion);
    const py::tuple parts = terminal_expansion_(x);
    if (parts.size() != 2)
      throw py::value_error("terminal_derivatives(x): expected (q, Q)");
    expansion.q0 = terminal(x);
    expansion.q = vectorOf("terminal_derivatives(x): q", parts[0], x.size());
    expansion.Q = matrixOf("terminal_derivatives(x): Q", parts[1], x.size(), x.size());
  }

private:
  py::function running_;
  py::object terminal_, expansion_, terminal_expansion_;
};

/// A source of noise: a factor (n, p), or a function (k, x, u) of such factors with its width taken at x0.
NoiseModel<> noiseOf(const std::string& name, const py::object& value, const Vector& x0, Eigen::Index m)
{
  const bool function = PyCallable_Check(value.ptr());
  const Eigen::MatrixXd first = (function ? value(0, x0, Vector::Zero(m).eval()) : value).cast<Eigen::MatrixXd>();
  phri_core::requireShape("noise \"" + name + "\"", first, x0.size(), first.cols());
  if (!function)
    return NoiseModel<>::constant(name, first);
  return { name, first.cols(), [value, name](int k, const Vector& x, const Vector& u, Eigen::MatrixXd& factor) {
            factor = matrixOf(name.c_str(), value(k, x, u), factor.rows(), factor.cols());
          } };
}

Result solveFunctions(const py::function& dynamics, const py::function& cost, const Vector& x0, int horizon,
                      int controls, const py::object& terminal_cost, const py::dict& noise, const py::object& attitude,
                      const py::object& start, const py::object& dynamics_derivatives,
                      const py::object& cost_derivatives, const py::object& terminal_derivatives,
                      const std::optional<Vector>& lower, const std::optional<Vector>& upper, double tolerance,
                      int max_iterations, const std::string& line_search, bool reduce, int cumulants,
                      bool raise_on_breakdown)
{
  OptimalControlProblem<> problem;
  problem.dynamics = std::make_shared<PythonDynamics>(dynamics, dynamics_derivatives, x0.size(), controls);
  problem.cost = std::make_shared<PythonCost>(cost, terminal_cost, cost_derivatives, terminal_derivatives);
  problem.horizon = horizon;
  problem.lower = lower;
  problem.upper = upper;
  for (const auto& item : noise)
    problem.noise.push_back(
        noiseOf(item.first.cast<std::string>(), py::reinterpret_borrow<py::object>(item.second), x0, controls));
  Attitude wish = RiskSensitive{ std::vector<double>(problem.noise.size(), 0.0) };
  if (py::isinstance<CostCumulants>(attitude))
    wish = attitude.cast<CostCumulants>();
  else if (!attitude.is_none())
    wish = attitude.cast<RiskSensitive>();
  if (line_search != "feedforward" && line_search != "criterion")
    throw py::value_error("line_search = \"" + line_search + R"(", expected "feedforward" or "criterion")");
  IterativeOptions options;
  options.tolerance = tolerance;
  options.max_iterations = max_iterations;
  options.line_search = line_search == "criterion" ? LineSearch::Criterion : LineSearch::Feedforward;
  options.reduce = reduce;
  options.cumulants = cumulants;
  std::vector<Vector> controls_start;
  if (!start.is_none())
  {
    const Stack stack("start", start.cast<Array>(), true);
    for (const Eigen::MatrixXd& u : stack.all())
      controls_start.push_back(u);
  }
  const Result result = solveIterative(problem, x0, wish, options, controls_start);
  if (raise_on_breakdown && result.status == IterativeStatus::Breakdown)
    throw RiskBreakdown(result.risk);
  return result;
}

py::list traceOf(const Result& self)
{
  py::list lines;
  for (const IterationTrace& line : self.trace)
  {
    py::dict entry;
    entry["phase"] = line.phase;
    entry["cost"] = line.cost;
    entry["criterion"] = line.criterion;
    entry["max_feedforward"] = line.max_feedforward;
    entry["step"] = line.step;
    entry["regularisation"] = line.regularisation;
    entry["share"] = line.share;
    lines.append(entry);
  }
  return lines;
}

const auto kSame = [](const auto& item) -> const auto&
{
  return item;
};
}  // namespace

void phri_control::python::bindIterative(py::module_& m)
{
  py::class_<Result>(m, "IterativeResult",
                     "Policy u = controls[k] + gains[k] (x - states[k]) around a nominal trajectory.")
      .def_property_readonly("status", [](const Result& self) { return toString(self.status); })
      .def_property_readonly(
          "converged", [](const Result& self) { return self.converged; },
          "max |l| < tolerance for the attitude that the result belongs to (see share)")
      .def_property_readonly("fallback", [](const Result& self) { return kFallbacks[static_cast<int>(self.fallback)]; })
      .def_readonly("share", &Result::share, "of the attitude's averse part that the result belongs to")
      .def_readonly("usable", &Result::usable, "the policy is finite, whatever the status")
      .def_property_readonly("message", &Result::message)
      .def_property_readonly("states", [](const Result& self) { return stacked(self.nominal.states, kSame, true); })
      .def_property_readonly("controls", [](const Result& self) { return stacked(self.nominal.controls, kSame, true); })
      .def_property_readonly("gains", [](const Result& self) { return gainsOf(self.policy); })
      .def_property_readonly(
          "feedforward", [](const Result& self) { return feedforwardOf(self.policy); },
          "l (T, m): what is left of the last step, below the tolerance where converged")
      .def_property_readonly("multipliers", [](const Result& self) { return stacked(self.multipliers, kSame, true); })
      .def_property_readonly(
          "cost", [](const Result& self) { return self.nominal.cost; }, "J without noise")
      .def_readonly("criterion", &Result::criterion)
      .def_readonly("max_feedforward", &Result::max_feedforward)
      .def_readonly("iterations", &Result::iterations)
      .def_readonly("passes", &Result::passes)
      .def_readonly("cumulants", &Result::cumulants, "(S, K) of J in the approximation, if asked for")
      .def_property_readonly("trace", &traceOf, "one dict per iteration");

  m.def(
      "solve_iterative", &solveFunctions, py::arg("dynamics"), py::arg("cost"), py::arg("x0"), py::arg("horizon"),
      py::kw_only(), py::arg("controls"), py::arg("terminal_cost") = py::none(), py::arg("noise") = py::dict(),
      py::arg("attitude") = py::none(), py::arg("start") = py::none(), py::arg("dynamics_derivatives") = py::none(),
      py::arg("cost_derivatives") = py::none(), py::arg("terminal_derivatives") = py::none(),
      py::arg("lower") = py::none(), py::arg("upper") = py::none(), py::arg("tolerance") = 1e-6,
      py::arg("max_iterations") = 100, py::arg("line_search") = "feedforward", py::arg("reduce") = true,
      py::arg("cumulants") = 0, py::arg("raise_on_breakdown") = false,
      "Solves x+ = dynamics(k, x, u) + noise, J = terminal_cost(x) + sum of cost(k, x, u) for an attitude (None: the\n"
      "mean), x0 (n,), `controls` = m. noise: dict of name to factor (n, p) or function (k, x, u) -> (n, p); start,\n"
      "(T, m). Derivatives that are not given are central differences: dynamics_derivatives(k, x, u) -> (A, B),\n"
      "cost_derivatives(k, x, u) -> (q, Q, r, R[, S]), terminal_derivatives(x) -> (q, Q). Look at .status; with\n"
      "raise_on_breakdown a breakdown raises RiskBreakdown instead. Exceptions of the functions pass through.");
}
