// Module `phri_control`: optimal control and assistance. Types that cross modules come from module `phri_core`.
#include "arrays.hpp"
#include "phri_control/assistance.hpp"
#include "phri_control/lq_solver.hpp"

using namespace phri_control;
using namespace phri_control::python;

namespace
{
using Problem = LinearQuadraticProblem<>;
using Solution = LqSolution<>;

Problem makeProblem(const Array& A, const Array& B, const Array& Q, const Array& R, const std::optional<Array>& q,
                    const std::optional<Array>& r, const std::optional<Array>& terminal_Q,
                    const std::optional<Array>& terminal_q, const std::optional<Array>& drift,
                    std::optional<py::ssize_t> horizon)
{
  const Stack as("A", A, false), bs("B", B, false), qs("Q", Q, false), rs("R", R, false);
  const auto optional = [](const std::string& name, const std::optional<Array>& array) {
    return array ? std::optional<Stack>(Stack(name, *array, true)) : std::nullopt;
  };
  const std::optional<Stack> linear_q = optional("q", q), linear_r = optional("r", r), ds = optional("drift", drift);
  if (horizon && *horizon < 1)
    throw py::value_error("horizon = " + std::to_string(*horizon) + ", expected at least 1");
  for (const Stack* stack : { &as, &bs, &qs, &rs })
    stack->agree(horizon);
  for (const auto* stack : { &linear_q, &linear_r, &ds })
    if (*stack)
      (*stack)->agree(horizon);
  if (!horizon)
    throw py::value_error("horizon is not given and every array is for one stage: pass horizon=T");

  const Eigen::Index n = as.rows(), m = bs.cols();
  Problem problem;
  problem.terminal = LqTerminal<>::zero(n);
  if (terminal_Q)
    problem.terminal.Q = Stack("terminal_Q", *terminal_Q, false).at(0);
  if (terminal_q)
    problem.terminal.q = Stack("terminal_q", *terminal_q, true).at(0);
  for (py::ssize_t k = 0; k < *horizon; ++k)
  {
    LqStage<> stage = LqStage<>::zero(n, m);
    stage.A = as.at(k);
    stage.B = bs.at(k);
    stage.Q = qs.at(k);
    stage.R = rs.at(k);
    if (linear_q)
      stage.q = linear_q->at(k);
    if (linear_r)
      stage.r = linear_r->at(k);
    if (ds)
      stage.d = ds->at(k);
    problem.stages.push_back(std::move(stage));
  }
  validate(problem);
  return problem;
}

void addNoise(Problem& problem, const std::string& name, const std::optional<Array>& covariance,
              const std::optional<Array>& factor)
{
  if (covariance.has_value() == factor.has_value())
    throw py::value_error("add_noise(\"" + name + "\"): give either covariance= or factor=");
  const NoiseSource source = covariance
                                 ? NoiseSource::fromCovariance(name, Stack("covariance", *covariance, false).all())
                                 : NoiseSource::fromFactor(name, Stack("factor", *factor, false).all());
  detail::requireNoise(source, problem.stateSize(), problem.stages.size());
  problem.noise.push_back(source);
}

Solution solveOrRaise(const Problem& problem)
{
  Solution solution = solve(problem);
  if (solution.status.ok)
    return solution;
  const std::string stage = std::to_string(solution.status.stage);
  const std::string text = solution.status.kind == LqFailure::Hessian
                               ? "solve: R + B'WB is not positive definite at stage " + stage + ": no minimum over u"
                               : "solve: not finite at stage " + stage;
  PyErr_SetString(PyExc_ArithmeticError, text.c_str());
  throw py::error_already_set();
}

void requireDof(const std::string& name, Eigen::Index size, Eigen::Index most)
{
  if (size < 1 || size > most)
    throw py::value_error(name + " has " + std::to_string(size) + " elements, expected 1 to " + std::to_string(most));
}

FeedbackPolicy makePolicy(double t0, double dt, const Array& gains, const Array& references,
                          const std::optional<Array>& feedforward, int source)
{
  const Stack gain("gains", gains, false), reference("references", references, true);
  std::optional<py::ssize_t> horizon;
  gain.agree(horizon);
  reference.agree(horizon);
  std::optional<Stack> force;
  if (feedforward)
    force.emplace("feedforward", *feedforward, true);
  if (force)
    force->agree(horizon);
  requireDof("a row of gains", gain.cols(), 2 * phri_core::kMaxDof);
  requireDof("a column of gains", gain.rows(), phri_core::kMaxDof);
  requireDof("a reference", reference.rows(), 2 * phri_core::kMaxDof);
  requireDof("a feedforward", force ? force->rows() : 1, phri_core::kMaxDof);
  std::vector<FeedbackPolicy::Stage> stages(horizon.value_or(1));
  for (std::size_t k = 0; k < stages.size(); ++k)
  {
    stages[k].gain = gain.at(k);
    stages[k].reference = reference.at(k);
    stages[k].feedforward.setZero(gain.rows());
    if (force)
      stages[k].feedforward = force->at(k);
  }
  return FeedbackPolicy(t0, dt, std::move(stages), source);
}

Eigen::VectorXd act(const FeedbackPolicy& policy, double t, const Eigen::VectorXd& xi)
{
  requireDof("xi", xi.size(), 2 * phri_core::kMaxDof);
  phri_core::VectorDof u;
  policy.act(t, xi, u);
  return u;
}

/// Property of a VectorDof that refuses what does not fit: pybind11 would write past its end.
template <phri_core::VectorDof AssistanceSettings::*member>
void bindVector(py::class_<AssistanceSettings>& settings, const char* name)
{
  settings.def_property(
      name, [](const AssistanceSettings& self) -> Eigen::VectorXd { return self.*member; },
      [name](AssistanceSettings& self, const Eigen::VectorXd& value) {
        requireDof(name, value.size(), phri_core::kMaxDof);
        self.*member = value;
      });
}

void bindLq(py::module_& m)
{
  py::class_<Problem>(
      m, "LinearQuadraticProblem",
      "xi+ = A xi + B u + drift + noise; J = 1/2 xi'Q xi + q'xi + 1/2 u'R u + r'u summed over the stages, "
      "plus 1/2 xi'terminal_Q xi + terminal_q'xi. Arrays are (T, ...) or one for all stages; what is not "
      "given is zero, the terminal cost too.")
      .def(py::init(&makeProblem), py::arg("A"), py::arg("B"), py::arg("Q"), py::arg("R"), py::arg("q") = py::none(),
           py::arg("r") = py::none(), py::arg("terminal_Q") = py::none(), py::arg("terminal_q") = py::none(),
           py::arg("drift") = py::none(), py::arg("horizon") = py::none())
      .def("add_noise", &addNoise, py::arg("name"), py::kw_only(), py::arg("covariance") = py::none(),
           py::arg("factor") = py::none(),
           "Adds a source eps = factor n, n ~ N(0, I), to the state: covariance (n, n) or factor (n, p), or (T, ...).")
      .def_property_readonly("horizon", &Problem::horizon, "number of stages T")
      .def_property_readonly(
          "noise",
          [](const Problem& problem) {
            std::vector<std::string> names;
            for (const NoiseSource& source : problem.noise)
              names.push_back(source.name);
            return names;
          },
          "names of the noise sources");

  py::class_<Solution>(m, "LqSolution", "Policy u = gains[k] xi + feedforward[k] and its value.")
      .def_property_readonly("gains", &gainsOf<Solution>, "(T, m, n)")
      .def_property_readonly("feedforward", &feedforwardOf<Solution>, "(T, m)")
      .def(
          "value",
          [](const Solution& self, const Eigen::VectorXd& x0) {
            phri_core::requireShape("x0", x0, self.value.w.size(), 1);
            return self.value(x0);
          },
          py::arg("x0"), "Expected cost from state x0 (n,) of stage 0 on.");

  m.def(
      "solve", [](const Problem& problem, const py::none&) { return solveOrRaise(problem); }, py::arg("problem"),
      py::arg("attitude") = py::none(),
      "Minimises the expected cost. Raises ArithmeticError naming the stage at which there is no minimum.");
  m.def("residual", &residual<Eigen::Dynamic, Eigen::Dynamic>, py::arg("problem"), py::arg("solution"),
        "Largest gradient of the cost in the controls, relative to its terms: 0 for an optimal policy.");
}

void bindPolicy(py::module_& m)
{
  using Stage = FeedbackPolicy::Stage;
  py::class_<FeedbackPolicy>(m, "FeedbackPolicy",
                             "u = L_k (xi - mu_k) + l_k over a horizon; then fades to passive in 0.2 s.")
      .def(py::init(&makePolicy), py::arg("t0"), py::arg("dt"), py::arg("gains"), py::arg("references"),
           py::arg("feedforward") = py::none(), py::arg("source") = 0)
      .def("act", &act, py::arg("t"), py::arg("xi"), "u (dof,); zero once expired.")
      .def("weight", &FeedbackPolicy::weight, py::arg("t"), "Share of the policy in u at time t [s], 0 to 1.")
      .def("expired", &FeedbackPolicy::expired, py::arg("t"), "Nothing is left of it at time t [s].")
      .def_property_readonly("t0", &FeedbackPolicy::t0, "[s] from which it holds")
      .def_property_readonly("dt", &FeedbackPolicy::dt, "[s] per stage")
      .def_property_readonly("dof", &FeedbackPolicy::dof, "degrees of freedom")
      .def_property_readonly("source", &FeedbackPolicy::source, "index of the controller in assistance_names()")
      .def_property_readonly("horizon_end", &FeedbackPolicy::horizonEnd, "[s]")
      .def_property_readonly(
          "gains",
          [](const FeedbackPolicy& self) {
            return stacked(
                self.stages(), [](const Stage& stage) -> const auto& { return stage.gain; }, false);
          },
          "L (T, dof, 2 dof) [N/m, Ns/m]")
      .def_property_readonly(
          "references",
          [](const FeedbackPolicy& self) {
            return stacked(
                self.stages(), [](const Stage& stage) -> const auto& { return stage.reference; }, true);
          },
          "mu (T, 2 dof) [m; m/s]")
      .def_property_readonly(
          "feedforward",
          [](const FeedbackPolicy& self) {
            return stacked(
                self.stages(), [](const Stage& stage) -> const auto& { return stage.feedforward; }, true);
          },
          "l (T, dof) [N]");
}

void bindAssistance(py::module_& m)
{
  py::class_<StateWeights>(m, "StateWeights", "Diagonal weights of position and velocity.")
      .def(py::init([](double position, double velocity) {
             return StateWeights{ position, velocity };
           }),
           py::arg("position"), py::arg("velocity"))
      .def_readwrite("position", &StateWeights::position, "[1/m^2]; of mahalanobis [-]")
      .def_readwrite("velocity", &StateWeights::velocity, "[s^2/m^2]; of mahalanobis [-]");

  py::class_<AssistanceSettings> settings(m, "AssistanceSettings", "Settings of every controller of the catalogue.");
  settings.def(py::init<>())
      .def_readwrite("dt", &AssistanceSettings::dt, "[s] period of a stage of the policy")
      .def_readwrite("horizon", &AssistanceSettings::horizon, "[s] length of a policy")
      .def_readwrite("law", &AssistanceSettings::law, "\"error_feedback\" (the thesis) or \"preview\"")
      .def_readwrite("q_scale", &AssistanceSettings::q_scale, "[-] on the state weights of lqr and mahalanobis")
      .def_readwrite("control_weight", &AssistanceSettings::control_weight, "R [1/N^2]")
      .def_readwrite("lqr", &AssistanceSettings::lqr, "StateWeights per sample")
      .def_readwrite("mahalanobis", &AssistanceSettings::mahalanobis, "StateWeights per predicted variance")
      .def_readwrite("covariance_floor", &AssistanceSettings::covariance_floor,
                     "[m^2; m^2/s^2] added to the predicted variances")
      .def_readwrite("pd_stiffness", &AssistanceSettings::pd_stiffness, "[N/m]")
      .def_readwrite("pd_damping", &AssistanceSettings::pd_damping, "[Ns/m]")
      .def_readwrite("pd_lookahead", &AssistanceSettings::pd_lookahead,
                     "[s] the reference is the prediction for so much later");
  bindVector<&AssistanceSettings::mass>(settings, "mass");
  bindVector<&AssistanceSettings::damping>(settings, "damping");

  py::class_<AssistanceController>(m, "AssistanceController", "Plans feedback policies from predictions.")
      .def("plan", &AssistanceController::plan, py::arg("observation"), py::arg("prediction"),
           "A FeedbackPolicy, or None when the inputs are unusable: see `failure`.")
      .def_property_readonly("failure", &AssistanceController::failure, "why the last plan returned None");

  m.def("make_assistance", &makeAssistance, py::arg("name"), py::arg("settings") = AssistanceSettings(),
        "The controller of this name. Raises ValueError listing the known ones.");
  m.def("assistance_names", &assistanceNames, "Names of the catalogue, in its order.");
}
}  // namespace

PYBIND11_MODULE(phri_control, m)
{
  m.doc() = "Optimal control and assistance: linear-quadratic problems, feedback policies, assistive controllers.";
  py::module_::import("phri_core");
  bindLq(m);
  bindRisk(m);
  bindCumulants(m);
  bindIterative(m);
  bindMultiplicative(m);
  bindPlants(m);
  bindRollOuts(m);
  bindPolicy(m);
  bindAssistance(m);
  bindContact(m);
  bindSensor(m);
}
