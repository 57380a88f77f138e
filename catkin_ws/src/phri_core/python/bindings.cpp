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

  py::register_exception<ParameterError>(m, "ParameterError", PyExc_ValueError);

  py::class_<Gaussian>(m, "Gaussian", "N(mean (d,), covariance (d, d))")
      .def(py::init([](const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance) {
             return Gaussian{ mean, covariance };
           }),
           py::arg("mean"), py::arg("covariance"))
      .def_readwrite("mean", &Gaussian::mean)
      .def_readwrite("covariance", &Gaussian::covariance);

  py::class_<Observation>(m, "Observation",
                          "What a behaviour model sees: state xi = [x; xdot], wrenches on the object.")
      .def(py::init([](double t, const Eigen::VectorXd& state, const Eigen::VectorXd& human_wrench,
                       const Eigen::VectorXd& environment_wrench, const Eigen::VectorXd& features) {
             return Observation{ t, sized<VectorState>("state", state), sized<VectorDof>("human_wrench", human_wrench),
                                 sized<VectorDof>("environment_wrench", environment_wrench), features };
           }),
           py::arg("t"), py::arg("state"), py::arg("human_wrench"), py::arg("environment_wrench") = Eigen::VectorXd(),
           py::arg("features") = Eigen::VectorXd())
      .def_readwrite("t", &Observation::t)
      .def_property(
          "state", [](const Observation& o) { return o.state; },
          [](Observation& o, const Eigen::VectorXd& v) { o.state = sized<VectorState>("state", v); })
      .def_property(
          "human_wrench", [](const Observation& o) { return o.human_wrench; },
          [](Observation& o, const Eigen::VectorXd& v) { o.human_wrench = sized<VectorDof>("human_wrench", v); })
      .def_property(
          "environment_wrench", [](const Observation& o) { return o.environment_wrench; },
          [](Observation& o, const Eigen::VectorXd& v) {
            o.environment_wrench = sized<VectorDof>("environment_wrench", v);
          })
      .def_readwrite("features", &Observation::features);

  py::class_<Prediction>(m, "Prediction", "Belief about what the human wants: element k speaks of time t0 + k dt.")
      .def(py::init<>())
      .def_readwrite("t0", &Prediction::t0)
      .def_readwrite("dt", &Prediction::dt)
      .def_readwrite("desired_state", &Prediction::desired_state)
      .def_readwrite("human_wrench", &Prediction::human_wrench)
      .def_readwrite("model", &Prediction::model);

  py::class_<BehaviorModel, std::shared_ptr<BehaviorModel>>(m, "BehaviorModel")
      .def("reset", &BehaviorModel::reset)
      .def("observe", &BehaviorModel::observe, py::arg("observation"))
      .def("predict", &BehaviorModel::predict, py::arg("horizon"), py::arg("dt"));

  py::class_<Admittance>(m, "Admittance", "M xdd + D xd = u, integrated exactly over dt.")
      .def(py::init(&makeAdmittance), py::arg("mass"), py::arg("damping"), py::arg("dt"))
      .def(
          "step", [](Admittance& a, const Eigen::VectorXd& wrench) { a.step(ofAdmittance(a, "wrench", wrench)); },
          py::arg("wrench"))
      .def(
          "reset",
          [](Admittance& a, const Eigen::VectorXd& position, const Eigen::VectorXd& velocity) {
            a.reset(ofAdmittance(a, "position", position), ofAdmittance(a, "velocity", velocity));
          },
          py::arg("position"), py::arg("velocity"))
      .def_property_readonly("position", &Admittance::position)
      .def_property_readonly("velocity", &Admittance::velocity);

  py::class_<Random>(m, "Random", "xoshiro256++ with polar-method normals: the same numbers on every machine.")
      .def(py::init<std::uint64_t>(), py::arg("seed"))
      .def_static("stream", &Random::stream, py::arg("seed"), py::arg("name"), py::arg("index") = 0)
      .def("bits", &Random::bits)
      .def("uniform", py::overload_cast<>(&Random::uniform))
      .def("normal", py::overload_cast<>(&Random::normal));

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
      "fault_name", [](int code) { return faultName(static_cast<FaultCode>(code)); }, py::arg("code"));
}
