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
      .def(py::init([](double t, const VectorState& state, const VectorDof& human_wrench,
                       const VectorDof& environment_wrench, const Eigen::VectorXd& features) {
             return Observation{ t, state, human_wrench, environment_wrench, features };
           }),
           py::arg("t"), py::arg("state"), py::arg("human_wrench"), py::arg("environment_wrench") = VectorDof(),
           py::arg("features") = Eigen::VectorXd())
      .def_readwrite("t", &Observation::t)
      .def_readwrite("state", &Observation::state)
      .def_readwrite("human_wrench", &Observation::human_wrench)
      .def_readwrite("environment_wrench", &Observation::environment_wrench)
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
      .def(py::init<const VectorDof&, const VectorDof&, double>(), py::arg("mass"), py::arg("damping"), py::arg("dt"))
      .def("step", &Admittance::step, py::arg("wrench"))
      .def("reset", &Admittance::reset, py::arg("position"), py::arg("velocity"))
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
  m.def(
      "safety_parameters",
      [] {
        SafetySettings settings;
        return parameterTable(settings).markdown();
      },
      "Reference table of the safety profile's parameters, as Markdown.");
}
