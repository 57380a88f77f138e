// Cost cumulants in Python: CostCumulants, solve(problem, attitude), evaluate_cumulants.
#include "arrays.hpp"
#include "phri_control/cost_cumulants.hpp"

using namespace phri_control;
using namespace phri_control::python;

namespace
{
using Problem = LinearQuadraticProblem<>;
using Values = CumulantValues<>;

/// A solution that can be asked for more cumulants than it was solved for.
struct Solution : CumulantSolution<>
{
  Problem problem;
};

CostCumulants makeAttitude(const Array& gamma)
{
  if (gamma.ndim() != 2)
    throw py::value_error("gamma has shape " + shapeOf(gamma) + ", expected (S, K - 1): a row per source of noise");
  return CostCumulants{ Stack("gamma", gamma, false).at(0) };
}

Solution solveKeeping(const Problem& problem, const CostCumulants& attitude, bool printed)
{
  return { solve(problem, attitude, printed ? CumulantWeighting::Printed : CumulantWeighting::Optimal), problem };
}

double valueAt(const Solution& self, const Eigen::VectorXd& x0)
{
  phri_core::requireShape("x0", x0, self.value.w.size(), 1);
  return self.value(x0);
}

Eigen::MatrixXd cumulantsAt(const Values& values, const Eigen::VectorXd& x0)
{
  phri_core::requireShape("x0", x0, values.series.front().w.size(), 1);
  return values.cumulants(x0);
}

Eigen::MatrixXd cumulantsOf(const Solution& self, const Eigen::VectorXd& x0, std::optional<int> count)
{
  const int wanted = count.value_or(self.values.count);
  if (wanted >= 1 && wanted <= self.values.count)
    return cumulantsAt(self.values, x0).leftCols(wanted);
  return cumulantsAt(evaluateCumulants(self.problem, wanted, self.gains, self.feedforward), x0);
}

Values evaluateArrays(const Problem& problem, int count, const Array& gains, const Array& feedforward)
{
  const PolicyStages policy = policyStages(problem.horizon(), gains, feedforward);
  return evaluateCumulants(problem, count, policy.gains, policy.feedforward);
}
}  // namespace

void phri_control::python::bindCumulants(py::module_& m)
{
  py::class_<CostCumulants>(m, "CostCumulants",
                            "Criterion: mean over the sources of noise of kappa_1 + sum_r gamma[s, r-2] kappa_r, the "
                            "cumulants of J under the noise of s alone. Positive weights are risk-averse.")
      .def(py::init(&makeAttitude), py::arg("gamma"))
      .def_readonly("gamma", &CostCumulants::gamma, "(S, K - 1) weights of kappa_2 .. kappa_K [1/J^(r-1)]");

  py::class_<Values>(m, "CumulantValues", "Cumulants of J under a policy, as functions of the first state.")
      .def("cumulants", &cumulantsAt, py::arg("x0"), "(S, K): kappa_1 .. kappa_K per source from state x0 (n,).");

  py::class_<Solution>(m, "CumulantSolution", "Policy u = gains[k] xi + feedforward[k] and its cumulants.")
      .def_property_readonly("gains", &gainsOf<Solution>, "(T, m, n)")
      .def_property_readonly("feedforward", &feedforwardOf<Solution>, "(T, m)")
      .def("value", &valueAt, py::arg("x0"), "The criterion from state x0 (n,) of stage 0 on.")
      .def("cumulants", &cumulantsOf, py::arg("x0"), py::arg("K") = py::none(),
           "(S, K): kappa_1 .. kappa_K of J per source from state x0; K: any, as solved for if not given.");

  m.def("solve", &solveKeeping, py::arg("problem"), py::arg("attitude"), py::kw_only(), py::arg("printed") = false,
        "Minimises the weighted cumulants stage by stage. printed: the weights of (4.37), without the factor r, for "
        "comparison with the figures of the thesis only. Raises RiskBreakdown where there is no policy.");
  m.def("evaluate_cumulants", &evaluateArrays, py::arg("problem"), py::arg("K"), py::arg("gains"),
        py::arg("feedforward"), "CumulantValues of the policy gains (T, m, n), feedforward (T, m) of any solver.");
}
