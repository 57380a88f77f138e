// Risk-sensitive control in Python: RiskSensitive, solve(problem, attitude), evaluate, theta_max, stationary_gain.
#include "arrays.hpp"
#include "phri_control/cumulant_evaluation.hpp"
#include "phri_control/risk_limits.hpp"
#include "phri_control/stationary_gain.hpp"

using namespace phri_control;
using namespace phri_control::python;

namespace
{
using Problem = LinearQuadraticProblem<>;
using Evaluation = RiskEvaluation<>;

/// A solution that can be asked for its cumulants.
struct Solution : RiskSolution<>
{
  Problem problem;
};

Solution solveKeeping(const Problem& problem, const RiskSensitive& attitude)
{
  Solution solution;
  static_cast<RiskSolution<>&>(solution) = solve(problem, attitude);
  solution.problem = problem;
  return solution;
}

Eigen::MatrixXd cumulantsOf(const Solution& self, const Eigen::VectorXd& x0, int count)
{
  phri_core::requireShape("x0", x0, self.problem.stateSize(), 1);
  return evaluateCumulants(self.problem, count, self.gains, self.feedforward).cumulants(x0);
}

constexpr const char* kKinds[] = { "none", "expectation", "hessian", "not finite" };

/// Sets the Python error: RiskBreakdown with the fields of the status.
void setBreakdown(const py::handle& type, const char* words, const RiskStatus& status)
{
  py::object error = py::reinterpret_borrow<py::object>(type)(words);
  error.attr("kind") = kKinds[static_cast<int>(status.kind)];
  error.attr("stage") = status.stage;
  error.attr("source") = status.source < 0 ? py::object(py::none()) : py::object(py::int_(status.source));
  error.attr("theta") = status.theta;
  error.attr("limit") = status.limit;
  PyErr_SetObject(type.ptr(), error.ptr());
}

double valueAt(const Evaluation& self, const Eigen::VectorXd& x0)
{
  phri_core::requireShape("x0", x0, self.values.front().w.size(), 1);
  return self.value(x0);
}

std::vector<double> valuesAt(const Evaluation& self, const Eigen::VectorXd& x0)
{
  phri_core::requireShape("x0", x0, self.values.front().w.size(), 1);
  std::vector<double> values;
  for (const QuadraticValue<>& value : self.values)
    values.push_back(value(x0));
  return values;
}

Evaluation evaluateArrays(const Problem& problem, const RiskSensitive& attitude, const Array& gains,
                          const Array& feedforward)
{
  const PolicyStages policy = policyStages(problem.horizon(), gains, feedforward);
  return evaluate(problem, attitude, policy.gains, policy.feedforward);
}

Eigen::MatrixXd stationary(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, const Eigen::MatrixXd& Q,
                           const Eigen::MatrixXd& R, const std::vector<Eigen::MatrixXd>& factors,
                           const std::optional<RiskSensitive>& attitude, double tolerance, int max_iterations)
{
  const RiskSensitive neutral{ std::vector<double>(factors.size(), 0.0) };
  const StationaryPolicy policy =
      stationaryGain(A, B, Q, R, factors, attitude.value_or(neutral), { tolerance, max_iterations });
  if (!policy.status)
    throw RiskBreakdown(policy.status);
  if (!policy)
  {
    const std::string words = "stationary_gain: no convergence in " + std::to_string(policy.iterations) + " stages";
    PyErr_SetString(PyExc_ArithmeticError, words.c_str());
    throw py::error_already_set();
  }
  return policy.gain;
}
}  // namespace

void phri_control::python::bindRisk(py::module_& m)
{
  // never released: it must outlive the interpreter's last exception
  static const py::handle breakdown = [&] {
    const py::object type = py::reinterpret_steal<py::object>(PyErr_NewExceptionWithDoc(
        "phri_control.RiskBreakdown",
        "There is no policy. kind: \"expectation\", \"hessian\" or \"not finite\"; stage; source and theta of an "
        "expectation, and the limit of theta there.",
        PyExc_ArithmeticError, nullptr));
    m.attr("RiskBreakdown") = type;
    return type.inc_ref();
  }();
  py::register_exception_translator([](std::exception_ptr pointer) {
    try
    {
      if (pointer)
        std::rethrow_exception(pointer);
    }
    catch (const RiskBreakdown& error)
    {
      setBreakdown(breakdown, error.what(), error.status());
    }
  });

  py::class_<RiskSensitive>(m, "RiskSensitive",
                            "Criterion: mean over the sources s of noise of log E exp(theta_s J) / theta_s, each with "
                            "its own noise alone. theta [1/J] > 0 is risk-averse, < 0 risk-seeking, 0 the mean of J.")
      .def(py::init([](const std::vector<double>& theta) { return RiskSensitive{ theta }; }), py::arg("theta"))
      .def_readonly("theta", &RiskSensitive::theta, "per source");

  py::class_<Evaluation>(m, "RiskEvaluation", "Value of a policy under an attitude.")
      .def("value", &valueAt, py::arg("x0"), "The criterion from state x0 (n,) of stage 0 on: mean over the sources.")
      .def("values", &valuesAt, py::arg("x0"), "The same per source; of a problem without noise, its cost.");
  py::class_<Solution, Evaluation>(m, "RiskSolution", "Policy u = gains[k] xi + feedforward[k] and its value.")
      .def_property_readonly("gains", &gainsOf<Solution>, "(T, m, n)")
      .def_property_readonly("feedforward", &feedforwardOf<Solution>, "(T, m)")
      .def("cumulants", &cumulantsOf, py::arg("x0"), py::arg("K"),
           "(S, K): kappa_1 .. kappa_K of J under each source alone, from state x0 (n,).");

  m.def("solve", &solveKeeping, py::arg("problem"), py::arg("attitude"),
        "Minimises the risk-sensitive criterion. Raises RiskBreakdown where there is no policy.");
  m.def("evaluate", &evaluateArrays, py::arg("problem"), py::arg("attitude"), py::arg("gains"), py::arg("feedforward"),
        "Value of the policy gains (T, m, n), feedforward (T, m). Raises RiskBreakdown where it is infinite.");
  m.def("theta_max", &thetaMax<Eigen::Dynamic, Eigen::Dynamic>, py::arg("problem"), py::arg("source") = 0,
        py::arg("tolerance") = kThetaTolerance,
        "Largest theta of one source that has a policy, the others neutral, to a relative tolerance from below; inf.");
  m.def("stationary_gain", &stationary, py::arg("A"), py::arg("B"), py::arg("Q"), py::arg("R"),
        py::arg("factors") = std::vector<Eigen::MatrixXd>(), py::arg("attitude") = py::none(),
        py::arg("tolerance") = StationaryOptions().tolerance,
        py::arg("max_iterations") = StationaryOptions().max_iterations,
        "Gain (m, n) of the infinite horizon; factors: (n, p) of every source of noise. Raises RiskBreakdown, and "
        "ArithmeticError when it does not converge.");
}
