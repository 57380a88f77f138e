// Plants, uncertain costs and the thesis' scenes in Python.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cmath>
#include <memory>

#include "phri_control/iterative_solver.hpp"
#include "phri_control/thesis_scenes.hpp"
#include "phri_core/check.hpp"

namespace phri_control
{
// both are in the library: compiling them again here takes longer than the rest of this file
extern template class IterativeSolver<>;
extern template IterativeResult<> solveIterative(const OptimalControlProblem<>&, const Eigen::VectorXd&,
                                                 const Attitude&, const IterativeOptions&,
                                                 const std::vector<Eigen::VectorXd>&);
}  // namespace phri_control

namespace py = pybind11;
using namespace phri_control;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

namespace
{
Integrator integratorNamed(const std::string& name)
{
  if (name == "euler")
    return Integrator::Euler;
  if (name == "runge_kutta")
    return Integrator::RungeKutta4;
  throw py::value_error("integrator = \"" + name + "\", expected \"euler\" or \"runge_kutta\"");
}

/// The plants' own functions take any size unchecked: here is the check.
PlantState stateOf(const Plant& plant, const VectorXd& x)
{
  phri_core::requireShape("x", x, plant.stateSize(), 1);
  return x;
}

void bindPlantClasses(py::module_& m)
{
  py::class_<Plant, std::shared_ptr<Plant>>(m, "Plant", "xdot = f(x, u) in the plane, with its discretisation.")
      .def_property_readonly("state_size", &Plant::stateSize, "n; there are 2 controls")
      .def(
          "rate",
          [](const Plant& self, const VectorXd& x, const Vector2d& u) -> VectorXd {
            PlantState xdot(self.stateSize());
            self.rate(stateOf(self, x), u, xdot);
            return xdot;
          },
          py::arg("x"), py::arg("u"), "f(x, u) (n,)")
      .def(
          "step",
          [](const Plant& self, const VectorXd& x, const Vector2d& u, double dt,
             const std::string& integrator) -> VectorXd {
            PlantState next;
            step(self, integratorNamed(integrator), dt, stateOf(self, x), u, next);
            return next;
          },
          py::arg("x"), py::arg("u"), py::arg("dt"), py::arg("integrator") = "euler", "x after dt [s] (n,)")
      .def(
          "linearise",
          [](const Plant& self, const VectorXd& x, const Vector2d& u, double dt, const std::string& integrator) {
            PlantMatrix A;
            PlantInput B;
            linearise(self, integratorNamed(integrator), dt, stateOf(self, x), u, A, B);
            return py::make_tuple(MatrixXd(A), MatrixXd(B));
          },
          py::arg("x"), py::arg("u"), py::arg("dt"), py::arg("integrator") = "euler",
          "Exact derivatives (A (n, n), B (n, 2)) of `step`.")
      .def(
          "motion", [](const Plant& self, const VectorXd& x) { return self.motion(stateOf(self, x)); }, py::arg("x"),
          "[position; velocity] in the plane (4,) [m; m/s]")
      .def(
          "motion_jacobian",
          [](const Plant& self, const VectorXd& x) -> MatrixXd {
            MotionJacobian jacobian;
            self.motionJacobian(stateOf(self, x), jacobian);
            return jacobian;
          },
          py::arg("x"), "Derivative of `motion` (4, n).");

  py::class_<PointMass, Plant, std::shared_ptr<PointMass>>(m, "PointMass", "M pdd + D pd = u + drive, x = [p; pd].")
      .def(py::init([](const Vector2d& mass, const Vector2d& damping, std::optional<double> drive) {
             return std::make_shared<PointMass>(
                 mass, damping, drive ? std::optional<DrivingForce>(DrivingForce{ *drive }) : std::nullopt);
           }),
           py::arg("mass") = Vector2d(1.0, 1.0), py::arg("damping") = Vector2d(1.0, 1.0), py::arg("drive") = py::none(),
           "mass [kg], damping [Ns/m] per axis; drive: wavenumber k [rad/m] of the force [cos(k p1), sin(k p2)] [N].");

  py::class_<TwoLinkArm, Plant, std::shared_ptr<TwoLinkArm>>(m, "TwoLinkArm", "Arm of section 4.6.3, x = [q; qd].")
      .def(py::init([](const std::string& input, const Eigen::Matrix2d& friction) {
             if (input != "joint_torque" && input != "workspace_force")
               throw py::value_error("input = \"" + input + "\", expected \"joint_torque\" or \"workspace_force\"");
             ArmParameters parameters;
             parameters.friction = friction;
             return std::make_shared<TwoLinkArm>(
                 parameters, input == "joint_torque" ? ArmInput::JointTorque : ArmInput::WorkspaceForce);
           }),
           py::arg("input") = "joint_torque", py::arg("friction") = ArmParameters().friction,
           "friction (2, 2) [Nms/rad]")
      .def("mass_matrix", &TwoLinkArm::massMatrix, py::arg("q"), "(2, 2) [kg m^2]")
      .def("end_effector", &TwoLinkArm::endEffector, py::arg("q"), "(2,) [m]")
      .def("jacobian", &TwoLinkArm::jacobian, py::arg("q"), "(2, 2) [m/rad]")
      .def(
          "kinetic_energy",
          [](const TwoLinkArm& self, const VectorXd& x) { return self.kineticEnergy(stateOf(self, x)); }, py::arg("x"),
          "[J]")
      .def(
          "state_at",
          [](const TwoLinkArm& self, const Eigen::Vector4d& motion) -> VectorXd { return self.stateAt(motion); },
          py::arg("motion"), "x (4,) with the end-effector at `motion` and 0 < q2 < pi.");

  py::class_<CarLikeRobot, Plant, std::shared_ptr<CarLikeRobot>>(
      m, "CarLikeRobot", "(4.46): x = [p1, p2, heading, speed, curvature], u = [acceleration, rate of curvature].")
      .def(py::init<>());
}

CostVector pointOf(const CostVector& centre, const VectorXd& y)
{
  phri_core::requireShape("y", y, centre.size(), 1);
  return y;
}

template <typename Term>
py::tuple expanded(const Term& term, const VectorXd& y)
{
  const Eigen::Index n = term.centre.size();
  CostVector gradient = CostVector::Zero(n);
  CostMatrix hessian = CostMatrix::Zero(n, n);
  const double value = term.expand(pointOf(term.centre, y), gradient, hessian);
  return py::make_tuple(value, VectorXd(gradient), MatrixXd(hessian));
}

/// What Quadratic and Bump have in common.
template <typename Term>
py::class_<Term> bindTerm(py::module_& m, const char* name, const char* text)
{
  return py::class_<Term>(m, name, text)
      .def_property_readonly("centre", [](const Term& self) -> VectorXd { return self.centre; })
      .def_property_readonly("weight", [](const Term& self) -> MatrixXd { return self.weight; })
      .def(
          "value", [](const Term& self, const VectorXd& y) { return self.value(pointOf(self.centre, y)); },
          py::arg("y"))
      .def("expand", &expanded<Term>, py::arg("y"), "(value, gradient (n,), Hessian (n, n)), all exact.");
}

void bindCosts(py::module_& m)
{
  bindTerm<Quadratic>(m, "Quadratic", "1/2 d'W d + constant, d = y - centre.")
      .def_readonly("constant", &Quadratic::constant);
  bindTerm<Bump>(m, "Bump", "amplitude exp(-1/2 d'P d), d = y - centre.").def_readonly("amplitude", &Bump::amplitude);

  py::class_<UncertainGoal>(m, "UncertainGoal", "h = 1/2 (y - x)'weight(y - x), x ~ N(mean, covariance).")
      .def(py::init<const VectorXd&, const MatrixXd&, const MatrixXd&>(), py::arg("mean"), py::arg("covariance"),
           py::arg("weight"))
      .def("risk_sensitive", &UncertainGoal::riskSensitive, py::arg("theta"),
           "theta^-1 log E exp(theta h) as a Quadratic of y. Raises from theta_limit on.")
      .def("cumulant", &UncertainGoal::cumulant, py::arg("r"), "r-th cumulant of h as a Quadratic of y.")
      .def("cumulants", &UncertainGoal::cumulants, py::arg("gamma"), "kappa_1 + gamma[0] kappa_2 + ...")
      .def_property_readonly("theta_limit", &UncertainGoal::thetaLimit, "[1/cost]; inf for a certain goal");

  py::class_<UncertainObstacle>(m, "UncertainObstacle",
                                "h = amplitude exp(-1/2 (y - x)'weight(y - x)), x ~ N(mean, covariance).")
      .def(py::init<const VectorXd&, const MatrixXd&, const MatrixXd&, double>(), py::arg("mean"),
           py::arg("covariance"), py::arg("weight"), py::arg("amplitude"))
      .def("moment", &UncertainObstacle::moment, py::arg("p"), "E h^p as a Bump of y.")
      .def("expected", &UncertainObstacle::expected, "E h as a Bump of y.")
      .def("cumulant", &UncertainObstacle::cumulant, py::arg("r"),
           "r-th cumulant of h, 1 to 4: a list of Bumps to add.")
      .def("cumulants", &UncertainObstacle::cumulants, py::arg("gamma"), "kappa_1 + gamma[0] kappa_2 + ...: Bumps.")
      .def_property_readonly("mean", [](const UncertainObstacle& self) -> VectorXd { return self.mean(); })
      .def_property_readonly("covariance", [](const UncertainObstacle& self) -> MatrixXd { return self.covariance(); })
      .def_property_readonly("weight", [](const UncertainObstacle& self) -> MatrixXd { return self.weight(); })
      .def_property_readonly("amplitude", &UncertainObstacle::amplitude);
}

void requireJoint(const PlanarScene& scene, const VectorXd& z)
{
  phri_core::requireShape("z", z, scene.stateSize(), 1);
}

IterativeResult<> solveScene(const PlanarScene& scene, const std::optional<Attitude>& attitude, bool error_state,
                             double tolerance, int max_iterations, bool reduce, int cumulants)
{
  const OptimalControlProblem<> problem = error_state ? errorProblemOf(scene) : problemOf(scene);
  IterativeOptions options;
  options.tolerance = tolerance;
  options.max_iterations = max_iterations;
  options.reduce = reduce;
  options.cumulants = cumulants;
  const Attitude neutral = RiskSensitive{ std::vector<double>(problem.noise.size(), 0.0) };
  return solveIterative<Eigen::Dynamic, Eigen::Dynamic>(problem, error_state ? errorStart(scene) : scene.start(),
                                                        attitude.value_or(neutral), options);
}

void bindScenes(py::module_& m)
{
  py::class_<PlanarScene>(m, "PlanarScene", "A robot among goals and obstacles; joint state z = [robot, movers ...].")
      .def_readonly("name", &PlanarScene::name)
      .def_readonly("dt", &PlanarScene::dt, "[s]")
      .def_readwrite("horizon", &PlanarScene::horizon, "number of controls")
      .def_readwrite("control_weight", &PlanarScene::control_weight, "R (2, 2)")
      .def_property(
          "integrator",
          [](const PlanarScene& self) { return self.integrator == Integrator::Euler ? "euler" : "runge_kutta"; },
          [](PlanarScene& self, const std::string& name) { self.integrator = integratorNamed(name); },
          "\"euler\" or \"runge_kutta\"")
      .def_property_readonly("state_size", &PlanarScene::stateSize)
      .def_property_readonly("start", &PlanarScene::start, "z at the start")
      .def_property_readonly(
          "movers",
          [](const PlanarScene& self) {
            py::dict offsets;
            for (std::size_t i = 0; i < self.movers.size(); ++i)
              offsets[py::str(self.movers[i].name)] = self.offset(i);
            return offsets;
          },
          "name -> where its block begins in z")
      .def_property_readonly("robot",
                             [](const PlanarScene& self) { return std::const_pointer_cast<Plant>(self.robot); })
      .def_property_readonly("static_obstacles",
                             [](const PlanarScene& self) {
                               std::vector<UncertainObstacle> beliefs;
                               for (const StaticObstacle& obstacle : self.static_obstacles)
                                 beliefs.push_back(obstacle.belief);
                               return beliefs;
                             })
      .def(
          "set_diffusion",
          [](PlanarScene& self, std::size_t mover, const MatrixXd& diffusion) {
            self.movers.at(mover).diffusion = diffusion;
          },
          py::arg("mover"), py::arg("diffusion"), "G (n, p) of a mover, by its index; (n, 0): no noise.")
      .def_property_readonly(
          "obstacle_spread",
          [](const PlanarScene& self) {
            std::vector<double> spreads;
            for (const AvoidedObstacle& obstacle : self.obstacles)
              spreads.push_back(obstacleSpread(self, obstacle));
            return spreads;
          },
          "Spread of each moving obstacle over its width; above 1 the quadratic model is not to be believed.")
      .def(
          "solve", &solveScene, py::arg("attitude") = py::none(), py::kw_only(), py::arg("error_state") = false,
          py::arg("tolerance") = IterativeOptions().tolerance,
          py::arg("max_iterations") = IterativeOptions().max_iterations, py::arg("reduce") = IterativeOptions().reduce,
          py::arg("cumulants") = 0,
          "IterativeResult from the start of the scene, for an attitude with one element per source (None: the mean),\n"
          "in the joint state, or in the error state where that is Markov.")
      .def_property_readonly(
          "noise",
          [](const PlanarScene& self) {
            py::dict factors;
            for (const NoiseModel<>& source : problemOf(self).noise)
            {
              MatrixXd factor(self.stateSize(), source.width);
              source.factor(0, self.start(), Vector2d::Zero(), factor);
              factors[py::str(source.name)] = factor;
            }
            return factors;
          },
          "source -> factor (n, p) of one sample in z, in the order of an attitude's elements")
      .def_property_readonly("error_start", &errorStart, "error state at the start")
      .def(
          "step",
          [](const PlanarScene& self, const VectorXd& z, const Vector2d& u) -> VectorXd {
            const OptimalControlProblem<> problem = problemOf(self);
            requireJoint(self, z);
            VectorXd next(z.size());
            problem.dynamics->step(0, z, u, next);
            return next;
          },
          py::arg("z"), py::arg("u"), "z one sample later, without noise.")
      .def(
          "linearise",
          [](const PlanarScene& self, const VectorXd& z, const Vector2d& u) {
            const OptimalControlProblem<> problem = problemOf(self);
            requireJoint(self, z);
            MatrixXd A(z.size(), z.size()), B(z.size(), 2);
            problem.dynamics->linearise(0, z, u, A, B);
            return py::make_tuple(A, B);
          },
          py::arg("z"), py::arg("u"), "(A, B) of `step`.")
      .def(
          "cost",
          [](const PlanarScene& self, const VectorXd& z, const std::optional<Vector2d>& u) {
            const OptimalControlProblem<> problem = problemOf(self);
            requireJoint(self, z);
            return u ? problem.cost->running(0, z, *u) : problem.cost->terminal(z);
          },
          py::arg("z"), py::arg("u") = py::none(), "Of one sample; without u the final cost.")
      .def(
          "expand",
          [](const PlanarScene& self, const VectorXd& z, const std::optional<Vector2d>& u) {
            const OptimalControlProblem<> problem = problemOf(self);
            requireJoint(self, z);
            if (u)
            {
              auto expansion = CostExpansion<>::zero(z.size(), 2);
              problem.cost->expand(0, z, *u, expansion);
              return py::make_tuple(expansion.q0, expansion.q, expansion.Q, expansion.r, expansion.R);
            }
            auto expansion = LqTerminal<>::zero(z.size());
            problem.cost->expandTerminal(z, expansion);
            return py::make_tuple(expansion.q0, expansion.q, expansion.Q);
          },
          py::arg("z"), py::arg("u") = py::none(),
          "(value, gradient in z, Hessian in z, gradient in u, Hessian in u); without u the first three of the final "
          "cost.");

  py::class_<FigurePanel>(m, "FigurePanel", "The attitude behind one panel of a figure.")
      .def_readonly("panel", &FigurePanel::panel)
      .def_readonly("name", &FigurePanel::name)
      .def_readonly("attitude", &FigurePanel::attitude, "RiskSensitive or CostCumulants");
  py::class_<ThesisScene>(m, "ThesisScene", "Scene of a figure with its panels and what the text does not print.")
      .def_readonly("figure", &ThesisScene::figure)
      .def_readonly("scene", &ThesisScene::scene)
      .def_readonly("panels", &ThesisScene::panels)
      .def_readonly("assumed", &ThesisScene::assumed);
  m.def("thesis_scene", &thesisScene, py::arg("figure"), "The scene of a figure, such as \"4.5\".");
  m.def("thesis_scene_names", &thesisSceneNames, "Figures that have a scene.");
}
}  // namespace

namespace phri_control::python
{
void bindPlants(py::module_& m)
{
  bindPlantClasses(m);
  bindCosts(m);
  bindScenes(m);
}
}  // namespace phri_control::python
