// Module `phri_core`: the types that cross module boundaries. The other modules import it first.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "phri_core/admittance.hpp"
#include "phri_core/interaction.hpp"
#include "phri_core/parameters.hpp"
#include "phri_core/random.hpp"
#include "phri_core/safety.hpp"

namespace py = pybind11;
using namespace phri_core;

namespace
{
/// pybind11 does not know the largest size of a stack-sized vector and would write past its end: sizes are checked
/// here.
template <typename Vector>
Vector sized(const char* name, const Eigen::VectorXd& values)
{
  if (values.size() > Vector::MaxRowsAtCompileTime)
    throw py::value_error(std::string(name) + " has " + std::to_string(values.size()) + " elements: expected at most " +
                          std::to_string(int(Vector::MaxRowsAtCompileTime)));
  return values;
}

Admittance makeAdmittance(const Eigen::VectorXd& mass, const Eigen::VectorXd& damping, double dt)
{
  return Admittance(sized<VectorDof>("mass", mass), sized<VectorDof>("damping", damping), dt);
}

VectorDof ofAdmittance(const Admittance& admittance, const char* name, const Eigen::VectorXd& values)
{
  if (values.size() != admittance.mass().size())
    throw py::value_error(std::string(name) + " has " + std::to_string(values.size()) + " elements: expected " +
                          std::to_string(admittance.mass().size()));
  return values;
}
}  // namespace

PYBIND11_MODULE(phri_core, m)
{
  m.doc() = "Vocabulary of physical human-robot interaction: what is measured, observed, predicted and limited.";

  py::register_exception<ParameterError>(m, "ParameterError", PyExc_ValueError).doc() =
      "All that is wrong with a configuration, at once: one line per error.";

  py::class_<Gaussian>(m, "Gaussian", "N(mean (d,), covariance (d, d))")
      .def(py::init([](const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance) {
             return Gaussian{ mean, covariance };
           }),
           py::arg("mean"), py::arg("covariance"))
      .def_readwrite("mean", &Gaussian::mean, "(d,)")
      .def_readwrite("covariance", &Gaussian::covariance, "(d, d), symmetric");

  py::class_<Observation>(m, "Observation",
                          "What a behaviour model sees: state xi = [x; xdot], wrenches on the object.")
      .def(py::init([](double t, const Eigen::VectorXd& state, const Eigen::VectorXd& human_wrench,
                       const Eigen::VectorXd& environment_wrench, const Eigen::VectorXd& features) {
             return Observation{ t, sized<VectorState>("state", state), sized<VectorDof>("human_wrench", human_wrench),
                                 sized<VectorDof>("environment_wrench", environment_wrench), features };
           }),
           py::arg("t"), py::arg("state"), py::arg("human_wrench"), py::arg("environment_wrench") = Eigen::VectorXd(),
           py::arg("features") = Eigen::VectorXd())
      .def_readwrite("t", &Observation::t, "[s] since the start of the trial")
      .def_property(
          "state", [](const Observation& o) { return o.state; },
          [](Observation& o, const Eigen::VectorXd& v) { o.state = sized<VectorState>("state", v); },
          "xi = [x; xdot] (2 dof,) [m, rad; m/s, rad/s]")
      .def_property(
          "human_wrench", [](const Observation& o) { return o.human_wrench; },
          [](Observation& o, const Eigen::VectorXd& v) { o.human_wrench = sized<VectorDof>("human_wrench", v); },
          "(dof,) [N, Nm] exerted BY the human ON the object")
      .def_property(
          "environment_wrench", [](const Observation& o) { return o.environment_wrench; },
          [](Observation& o, const Eigen::VectorXd& v) {
            o.environment_wrench = sized<VectorDof>("environment_wrench", v);
          },
          "(dof,) [N, Nm] exerted BY the environment ON the object")
      .def_readwrite("features", &Observation::features, "anything more that a model wants to see; may be empty");

  py::class_<Prediction>(m, "Prediction", "Belief about what the human wants: element k speaks of time t0 + k dt.")
      .def(py::init<>())
      .def_readwrite("t0", &Prediction::t0, "[s] time of the observation it was made from")
      .def_readwrite("dt", &Prediction::dt, "[s] step")
      .def_readwrite("desired_state", &Prediction::desired_state, "list of Gaussian over xi_d (2 dof,)")
      .def_readwrite("human_wrench", &Prediction::human_wrench, "list of Gaussian (dof,) [N], as long, or empty")
      .def_readwrite("model", &Prediction::model, "name of the model that made it");

  py::class_<BehaviorModel, std::shared_ptr<BehaviorModel>>(
      m, "BehaviorModel", "A model of the human that watches the interaction and predicts it.")
      .def("reset", &BehaviorModel::reset, "Forgets the current trial's observations, keeps what was learned.")
      .def("observe", &BehaviorModel::observe, py::arg("observation"), "Takes the next Observation, in order.")
      .def("predict", &BehaviorModel::predict, py::arg("horizon"), py::arg("dt"),
           "Prediction over `horizon` [s] in steps of `dt` [s]; None while the model cannot tell.");

  py::class_<Admittance>(m, "Admittance", "M xdd + D xd = u, integrated exactly over dt.")
      .def(py::init(&makeAdmittance), py::arg("mass"), py::arg("damping"), py::arg("dt"))
      .def(
          "step", [](Admittance& a, const Eigen::VectorXd& wrench) { a.step(ofAdmittance(a, "wrench", wrench)); },
          py::arg("wrench"), "Advances by dt under the total wrench (dof,) [N, Nm].")
      .def(
          "reset",
          [](Admittance& a, const Eigen::VectorXd& position, const Eigen::VectorXd& velocity) {
            a.reset(ofAdmittance(a, "position", position), ofAdmittance(a, "velocity", velocity));
          },
          py::arg("position"), py::arg("velocity"), "Moves to a state.")
      .def_property_readonly("position", &Admittance::position, "(dof,) [m, rad]")
      .def_property_readonly("velocity", &Admittance::velocity, "(dof,) [m/s, rad/s]");

  py::class_<Random>(m, "Random", "xoshiro256++ with polar-method normals: the same numbers on every machine.")
      .def(py::init<std::uint64_t>(), py::arg("seed"))
      .def_static("stream", &Random::stream, py::arg("seed"), py::arg("name"), py::arg("index") = 0,
                  "An independent generator for one purpose and index.")
      .def("bits", &Random::bits, "64 random bits")
      .def("uniform", py::overload_cast<>(&Random::uniform), "uniform on [0, 1)")
      .def("normal", py::overload_cast<>(&Random::normal), "standard normal");

  m.def("limit_names", &limitNames, "Names of the bits of the `limits` mask, bit i = name i.");
  m.def(
      "assistance_limits",
      [] {
        std::vector<std::string> names;
        for (std::size_t bit = 0; bit < limitNames().size(); ++bit)
          if (kAssistanceLimits & (1u << bit))
            names.push_back(limitNames()[bit]);
        return names;
      },
      "Names of the limits that take something away from the assistance.");
  m.def(
      "state_names",
      [] {
        std::vector<std::string> names;
        for (std::size_t state = 0; state < kLoopStates; ++state)
          names.push_back(stateName(static_cast<LoopState>(state)));
        return names;
      },
      "Names of the loop's states, in the order of their numbers.");
  m.def(
      "fault_name", [](int code) { return faultName(static_cast<FaultCode>(code)); }, py::arg("code"),
      "Name of a fault code, as in ControllerState and in the trial table.");
}
