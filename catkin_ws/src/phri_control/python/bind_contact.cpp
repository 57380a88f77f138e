// The contact controller of 5.4 in Python: ContactSettings, ContactReference, ContactController, ForceWindow,
// covariance_max.
#include "arrays.hpp"
#include "phri_control/contact_control.hpp"
#include "phri_core/check.hpp"

using namespace phri_control;
using namespace phri_control::python;

namespace
{
constexpr const char* kFallbacks[] = { "none", "reduced", "neutral", "no policy" };

/// A vector that fits into a VectorDof: pybind11 would write past its end.
phri_core::VectorDof sized(const std::string& name, const Eigen::VectorXd& value)
{
  if (value.size() < 1 || value.size() > phri_core::kMaxDof)
    throw py::value_error(name + " has " + std::to_string(value.size()) + " elements, expected 1 to " +
                          std::to_string(phri_core::kMaxDof));
  return value;
}

template <phri_core::VectorDof ContactSettings::*member>
void bindVector(py::class_<ContactSettings>& settings, const char* name)
{
  settings.def_property(
      name, [](const ContactSettings& self) -> Eigen::VectorXd { return self.*member; },
      [name](ContactSettings& self, const Eigen::VectorXd& value) { self.*member = sized(name, value); });
}

std::vector<phri_core::Gaussian> gaussians(const std::string& name, const Array& means, const Array& covariances)
{
  const Stack mean(name + "_means", means, true), covariance(name + "_covariances", covariances, false);
  std::optional<py::ssize_t> count;
  mean.agree(count);
  covariance.agree(count);
  std::vector<phri_core::Gaussian> result;
  for (py::ssize_t k = 0; k < count.value_or(1); ++k)
    result.push_back({ mean.at(k), covariance.at(k) });
  return result;
}

ContactReference makeReference(double t0, double dt, const Array& motion_means, const Array& motion_covariances,
                               const Array& wrench_means, const Array& wrench_covariances)
{
  return { t0, dt, gaussians("motion", motion_means, motion_covariances),
           gaussians("wrench", wrench_means, wrench_covariances) };
}

Eigen::MatrixXd maximum(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b)
{
  if (a.rows() < 1 || a.rows() > phri_core::kMaxDof)
    throw py::value_error("a has " + std::to_string(a.rows()) + " rows, expected 1 to " +
                          std::to_string(phri_core::kMaxDof));
  phri_core::requireCovariance("a", a);
  phri_core::requireShape("b", b, a.rows(), a.cols());
  phri_core::requireCovariance("b", b);
  return covarianceMax(a, b);
}

void bindPlan(py::module_& m)
{
  const auto vector = [](auto ContactPlan::*member) {
    return [member](const ContactPlan& self) -> Eigen::VectorXd { return self.*member; };
  };
  py::class_<ContactPlan>(m, "ContactPlan", "What a plan of the contact controller did: first stage, per axis.")
      .def_readonly("t", &ContactPlan::t, "[s]")
      .def_property_readonly("bias", vector(&ContactPlan::bias), "u_0 [N]")
      .def_property_readonly("noise_variance", vector(&ContactPlan::noise_variance), "diagonal of Sigma_u [N^2]")
      .def_property_readonly("stiffness", vector(&ContactPlan::stiffness), "of u_p [N/m]")
      .def_property_readonly("velocity_gain", vector(&ContactPlan::velocity_gain), "of u_p [Ns/m]")
      .def_property_readonly("adaptation", vector(&ContactPlan::adaptation), "xi_a [m; m/s]")
      .def_property_readonly("reference", vector(&ContactPlan::reference), "xi_d = mu + xi_a [m; m/s]")
      .def_property_readonly(
          "fallback", [](const ContactPlan& self) { return kFallbacks[static_cast<int>(self.fallback)]; },
          "\"none\", \"reduced\" (an averse theta) or \"neutral\"")
      .def_readonly("scale", &ContactPlan::scale, "of an averse theta [-]");
}
}  // namespace

void phri_control::python::bindContact(py::module_& m)
{
  py::class_<ContactReference>(m, "ContactReference",
                               "A learned contact task: means and covariances of the motion xi = [x; xdot] and of the "
                               "wrench BY the environment ON the tool, element k at t0 + k dt.")
      .def(py::init(&makeReference), py::arg("t0"), py::arg("dt"), py::arg("motion_means"),
           py::arg("motion_covariances"), py::arg("wrench_means"), py::arg("wrench_covariances"),
           "Means (T, 2 dof) and (T, dof), covariances (T, 2 dof, 2 dof) and (T, dof, dof).")
      .def_readonly("t0", &ContactReference::t0, "[s]")
      .def_readonly("dt", &ContactReference::dt, "[s]")
      .def(
          "__len__", [](const ContactReference& self) { return self.motion.size(); }, "Number of elements.");

  py::class_<ContactSettings> settings(m, "ContactSettings", "Settings of the contact controllers.");
  settings.def(py::init<>())
      .def_readwrite("dt", &ContactSettings::dt, "[s] period of a stage")
      .def_readwrite("horizon", &ContactSettings::horizon, "[s] of the optimisation")
      .def_readwrite("validity", &ContactSettings::validity, "[s] length of a policy")
      .def_readwrite("law", &ContactSettings::law, "\"error_feedback\" (the thesis) or \"preview\"")
      .def_readwrite("weighting", &ContactSettings::weighting, "\"covariance\" or \"identity\"")
      .def_readwrite("covariance_weights", &ContactSettings::covariance_weights, "StateWeights per learned variance")
      .def_readwrite("identity_weights", &ContactSettings::identity_weights, "StateWeights per sample")
      .def_readwrite("covariance_floor", &ContactSettings::covariance_floor, "[m^2; m^2/s^2]")
      .def_readwrite("control_weight", &ContactSettings::control_weight, "R [1/N^2]")
      .def_readwrite("seeking", &ContactSettings::seeking, "-theta of the seeking controllers [1/J]")
      .def_readwrite("averse", &ContactSettings::averse, "theta of the averse controller [1/J]")
      .def_readwrite("window", &ContactSettings::window, "W [s]")
      .def_readwrite("forgetting_time", &ContactSettings::forgetting_time, "[s] of the leak")
      .def_readwrite("clamp_velocity_gain", &ContactSettings::clamp_velocity_gain, "velocity gain 0");
  bindVector<&ContactSettings::mass>(settings, "mass");
  bindVector<&ContactSettings::damping>(settings, "damping");
  bindVector<&ContactSettings::force_gain>(settings, "force_gain");
  bindPlan(m);

  py::class_<ContactController>(m, "ContactController",
                                "Reproduction of a contact task (5.4): plans feedback policies whose stiffness and "
                                "reference follow the force control's activity.")
      .def(py::init<const std::string&, const ContactSettings&>(), py::arg("name"),
           py::arg("settings") = ContactSettings(), "Raises ValueError listing the known names.")
      .def("follow", &ContactController::follow, py::arg("reference"), "The task from now on.")
      .def("reset", &ContactController::reset, "Forgets window and adaptation.")
      .def(
          "observe",
          [](ContactController& self, double t, const Eigen::VectorXd& wrench) {
            self.observe(t, sized("environment_wrench", wrench));
          },
          py::arg("t"), py::arg("environment_wrench"), "A sample of the wrench by the environment on the tool [N].")
      .def("plan", &ContactController::plan, py::arg("observation"), "A FeedbackPolicy, or None: see `failure`.")
      .def(
          "force_input",
          [](const ContactController& self, double t, const Eigen::VectorXd& wrench) -> Eigen::VectorXd {
            return self.forceInput(t, sized("environment_wrench", wrench));
          },
          py::arg("t"), py::arg("environment_wrench"), "u_f = K_f (f_env - mu_f) [N]; 0 without a task.")
      .def_property_readonly("name", &ContactController::name, "of the controller")
      .def_property_readonly("failure", &ContactController::failure, "why the last plan was None")
      .def_property_readonly("last", &ContactController::last, "ContactPlan of the last policy")
      .def_property_readonly(
          "loop_mass", [](const ContactController& self) -> Eigen::VectorXd { return self.loopMass(); },
          "K_f^-1 M_r [kg], to be rendered by the interaction loop")
      .def_property_readonly(
          "loop_damping", [](const ContactController& self) -> Eigen::VectorXd { return self.loopDamping(); },
          "K_f^-1 D_r [Ns/m]");
  m.def("contact_controller_names", &contactControllerNames, "Names of the contact controllers, (a) to (e) first.");

  py::class_<ForceMoments>(m, "ForceMoments", "Means over the samples of a window.")
      .def_readonly("count", &ForceMoments::count, "of samples")
      .def_property_readonly(
          "mean", [](const ForceMoments& self) -> Eigen::VectorXd { return self.mean; }, "[N]")
      .def_property_readonly(
          "second_moment", [](const ForceMoments& self) -> Eigen::MatrixXd { return self.second_moment; },
          "about zero [N^2]")
      .def_property_readonly(
          "covariance", [](const ForceMoments& self) -> Eigen::MatrixXd { return self.covariance; },
          "about the mean [N^2]");
  py::class_<ForceWindow>(m, "ForceWindow", "The samples of a force over the last `duration` seconds.")
      .def(py::init<Eigen::Index, double, double>(), py::arg("dof"), py::arg("duration"), py::arg("dt"))
      .def(
          "add",
          [](ForceWindow& self, double t, const Eigen::VectorXd& force) { return self.add(t, sized("force", force)); },
          py::arg("t"), py::arg("force"), "False if it was refused: time not increasing, wrong size, not finite.")
      .def("moments", &ForceWindow::moments, py::arg("t"), "Over the samples in (t - duration, t].")
      .def("clear", &ForceWindow::clear, "Forgets all samples.");
  m.def("covariance_max", &maximum, py::arg("a"), py::arg("b"),
        "The smallest of its kind that is not below either covariance; entrywise for diagonal ones.");
}
