// Force/torque sensors and delays in Python: identify_payload, ForceSensor, estimate_delay, admitted_stiffness.
#include "arrays.hpp"
#include "phri_control/delay_estimation.hpp"
#include "phri_control/force_sensor.hpp"

using namespace phri_control;
using namespace phri_control::python;

namespace
{
std::vector<Eigen::Matrix3d> orientationsOf(const Array& array)
{
  if (array.ndim() != 3 || array.shape(1) != 3 || array.shape(2) != 3)
    throw py::value_error("orientations have shape " + shapeOf(array) + ", expected (N, 3, 3)");
  std::vector<Eigen::Matrix3d> matrices;
  for (const Eigen::MatrixXd& matrix : Stack("orientations", array, false).all())
    matrices.emplace_back(matrix);
  return matrices;
}

PayloadEstimate identify(const Array& orientations, const Array& wrenches)
{
  if (wrenches.ndim() != 2 || wrenches.shape(1) != 6)
    throw py::value_error("wrenches have shape " + shapeOf(wrenches) + ", expected (N, 6)");
  std::vector<Vector6d> vectors;
  for (const Eigen::MatrixXd& wrench : Stack("wrenches", wrenches, true).all())
    vectors.emplace_back(wrench);
  return identifyPayload(orientationsOf(orientations), vectors);
}

SensorMotion motionOf(const Eigen::Matrix3d& orientation, const Eigen::Vector3d& velocity,
                      const Eigen::Vector3d& angular_velocity, const Eigen::Vector3d& acceleration,
                      const Eigen::Vector3d& angular_acceleration)
{
  return { orientation, velocity, angular_velocity, acceleration, angular_acceleration };
}

std::string stateOf(const ForceSensor& sensor)
{
  constexpr const char* kStates[] = { "none", "running", "done", "refused" };
  return kStates[static_cast<int>(sensor.tareReport().state)];
}
}  // namespace

namespace phri_control::python
{
}

void phri_control::python::bindSensor(py::module_& m)
{
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();

  py::class_<Payload>(m, "Payload", "What hangs on a force/torque sensor.")
      .def(py::init([](double mass, const Eigen::Vector3d& centre, const Eigen::Matrix3d& inertia) {
             return Payload{ mass, centre, inertia };
           }),
           py::arg("mass") = 0.0, py::arg("centre") = zero,
           py::arg("inertia") = Eigen::Matrix3d(Eigen::Matrix3d::Zero()))
      .def_readwrite("mass", &Payload::mass, "[kg]")
      .def_readwrite("centre", &Payload::centre, "of mass, in the sensor's frame [m]")
      .def_readwrite("inertia", &Payload::inertia, "about the centre of mass, in the sensor's axes [kgm2]");
  m.def("gravity_wrench", &gravityWrench, py::arg("payload"), py::arg("orientation"),
        "Reading (6,) that the weight causes; orientation (3, 3): sensor's frame -> inertial frame, z up.");

  py::class_<PayloadEstimate>(m, "PayloadEstimate", "Payload and bias from readings at rest.")
      .def_readonly("payload", &PayloadEstimate::payload)
      .def_readonly("bias", &PayloadEstimate::bias, "(6,) reading without load [N, Nm]")
      .def_readonly("force_residual", &PayloadEstimate::force_residual, "rms per axis [N]")
      .def_readonly("torque_residual", &PayloadEstimate::torque_residual, "rms per axis [Nm]")
      .def_readonly("condition", &PayloadEstimate::condition, "1.3 for poses that tilt every way")
      .def_property_readonly(
          "residuals",
          [](const PayloadEstimate& self) {
            return stacked(
                self.residuals, [](const auto& item) -> const auto& { return item; }, true);
          },
          "(N, 6) reading minus model [N, Nm]")
      .def_readonly("mass_deviation", &PayloadEstimate::mass_deviation, "[kg]")
      .def_readonly("centre_deviation", &PayloadEstimate::centre_deviation, "(3,) [m]")
      .def_readonly("bias_deviation", &PayloadEstimate::bias_deviation, "(6,) [N, Nm]");
  m.attr("FEWEST_POSES") = kFewestPoses;
  m.def("identify_payload", &identify, py::arg("orientations"), py::arg("wrenches"),
        "From orientations (N, 3, 3), sensor's frame -> inertial frame, and mean readings (N, 6) at rest. Raises "
        "ValueError naming all causes.");

  m.def(
      "transform_wrench",
      [](const Eigen::Matrix4d& pose, const Vector6d& wrench) {
        return transformWrench(Eigen::Isometry3d(pose), wrench);
      },
      py::arg("pose"), py::arg("wrench"),
      "The same wrench in and about another frame; pose (4, 4): of the present frame in the other one.");

  py::class_<ForceSensorSettings>(m, "ForceSensorSettings", "What turns raw readings into a wrench.")
      .def(py::init<>())
      .def_readwrite("payload", &ForceSensorSettings::payload)
      .def_readwrite("bias", &ForceSensorSettings::bias, "(6,) [N, Nm]")
      .def_readwrite("force_range", &ForceSensorSettings::force_range, "[N]")
      .def_readwrite("torque_range", &ForceSensorSettings::torque_range, "[Nm]")
      .def_readwrite("cutoff", &ForceSensorSettings::cutoff, "[Hz]; 0: none")
      .def_readwrite("order", &ForceSensorSettings::order, "1 or 2")
      .def_readwrite("dt", &ForceSensorSettings::dt, "[s]")
      .def_readwrite("inertial", &ForceSensorSettings::inertial, "remove the payload's inertial wrench, too")
      .def_readwrite("tare_time", &ForceSensorSettings::tare_time, "[s]");

  py::class_<ForceReading>(m, "ForceReading", "One compensated reading.")
      .def_readonly("wrench", &ForceReading::wrench, "(6,) by human and environment on the robot [N, Nm]; NaN: invalid")
      .def_readonly("valid", &ForceReading::valid)
      .def_readonly("saturated", &ForceReading::saturated);
  py::class_<ForceSensor>(m, "ForceSensor", "Bias and payload removed, filtered, tared.")
      .def(py::init<const ForceSensorSettings&>(), py::arg("settings"))
      .def(
          "update",
          [](ForceSensor& self, const Vector6d& raw, const Eigen::Matrix3d& orientation, const Eigen::Vector3d& v,
             const Eigen::Vector3d& w, const Eigen::Vector3d& a,
             const Eigen::Vector3d& alpha) { return self.update(raw, motionOf(orientation, v, w, a, alpha)); },
          py::arg("raw"), py::arg("orientation"), py::arg("velocity") = zero, py::arg("angular_velocity") = zero,
          py::arg("acceleration") = zero, py::arg("angular_acceleration") = zero,
          "One raw reading (6,); the motion of the sensor's frame in the inertial one.")
      .def("tare", &ForceSensor::tare, "The readings of the next tare_time decide.")
      .def_property_readonly("tare_state", &stateOf, "\"none\", \"running\", \"done\" or \"refused\"")
      .def_property_readonly(
          "tare_text", [](const ForceSensor& self) { return describe(self.tareReport()); }, "cause, value and bound")
      .def_property_readonly("bias", &ForceSensor::bias, "(6,) [N, Nm]")
      .def_property_readonly("delay", &ForceSensor::delay, "[s] that the filter adds");

  py::class_<DelayEstimate>(m, "DelayEstimate", "response(t) = gain * lag(command)(t - delay) + offset.")
      .def_readonly("delay", &DelayEstimate::delay, "[s]; all of it where the lag was not identified")
      .def_readonly("lag", &DelayEstimate::lag, "[s] first-order time constant")
      .def_readonly("lag_identified", &DelayEstimate::lag_identified)
      .def_readonly("total", &DelayEstimate::total, "delay + lag [s]")
      .def_readonly("total_deviation", &DelayEstimate::total_deviation, "[s]")
      .def_readonly("delay_deviation", &DelayEstimate::delay_deviation, "[s]")
      .def_readonly("lag_deviation", &DelayEstimate::lag_deviation, "[s]")
      .def_readonly("gain", &DelayEstimate::gain)
      .def_readonly("offset", &DelayEstimate::offset)
      .def_readonly("correlation", &DelayEstimate::correlation)
      .def_readonly("explained", &DelayEstimate::explained, "share of the response's variance");
  m.def(
      "estimate_delay",
      [](const Eigen::VectorXd& command, const Eigen::VectorXd& response, double dt, double max_delay,
         double least_correlation) {
        return estimateDelay(command, response, dt, { max_delay, least_correlation });
      },
      py::arg("command"), py::arg("response"), py::arg("dt"), py::arg("max_delay") = DelayOptions().max_delay,
      py::arg("least_correlation") = DelayOptions().least_correlation,
      "From two signals (N,) sampled every dt [s]. Raises ValueError naming the cause.");
  m.def("admitted_stiffness", &admittedStiffness, py::arg("mass"), py::arg("damping"), py::arg("delay"),
        py::arg("lag") = 0.0, "Largest contact stiffness of an admittance with this delay; about damping / delay.");
}
