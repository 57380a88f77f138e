// Module `phri_sim`: experiments, simulated people and whole trials in lockstep, without ROS.
#include <pybind11/eigen.h>
#include <pybind11/functional.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "phri_sim/human_partner.hpp"
#include "phri_sim/route.hpp"
#include "phri_sim/trial.hpp"

namespace py = pybind11;
using namespace phri_sim;

void bindContactRun(py::module_& m, Parameters (*parameters)(const py::dict&));
py::dict mapOf(const Scene& scene);
void addTransportColumns(const TrialLog& log, int every, py::dict& columns);
void addTransportAttributes(const Experiment& experiment, const TrialLog& log, py::dict& attrs);

namespace
{
using ExperimentPtr = std::shared_ptr<const Experiment>;

template <typename Value>
py::array_t<Value> column(const TrialLog& log, const std::function<Value(const phri_control::TickRecord&)>& value)
{
  py::array_t<Value> out(log.ticks.size());
  Value* data = out.mutable_data();
  for (std::size_t k = 0; k < log.ticks.size(); ++k)
    data[k] = value(log.ticks[k]);
  return out;
}

/// Columns of the newest prediction on every row; NaN before the first.
void addPredictions(const TrialLog& log, py::dict& columns)
{
  const char* names[] = { "prediction_t0", "prediction_horizon", "prediction_x", "prediction_y",
                          "prediction_xx", "prediction_xy",      "prediction_yy" };
  std::vector<py::array_t<double>> arrays;
  for (const char* name : names)
  {
    arrays.emplace_back(log.ticks.size());
    columns[name] = arrays.back();
  }
  std::size_t next = 0;
  double row[7];
  std::fill(row, row + 7, std::nan(""));
  for (std::size_t k = 0; k < log.ticks.size(); ++k)
  {
    for (; next < log.predictions.size() && log.predictions[next].known_from_ns <= log.ticks[k].time_ns; ++next)
    {
      const PredictedPosition& p = log.predictions[next];
      const double newest[] = {
        p.t0, p.horizon, p.mean(0), p.mean(1), p.covariance(0, 0), p.covariance(0, 1), p.covariance(1, 1)
      };
      std::copy(newest, newest + 7, row);
    }
    for (int i = 0; i < 7; ++i)
      arrays[i].mutable_data()[k] = row[i];
  }
}

py::dict attributes(const Experiment& experiment, const TrialLog& log)
{
  py::dict attrs;
  attrs["experiment"] = experiment.name;
  attrs["participant"] = log.spec.participant;
  attrs["controller"] = log.spec.controller;
  attrs["trial"] = log.spec.trial;
  attrs["practice"] = log.spec.practice;
  attrs["evaluated"] = log.spec.evaluated;
  attrs["seed"] = log.spec.study_seed;
  attrs["completed"] = log.completed;
  attrs["failed_plans"] = log.failed_plans;
  attrs["simulated_participants"] = true;
  if (!experiment.assistance_off.empty())
    attrs["assistance_off"] = !experiment.assists(log.spec.trial);
  if (log.primitives >= 0)
  {
    attrs["primitives"] = log.primitives;
    attrs["predicted"] = log.plans > 0 ? double(log.predictions.size()) / log.plans : 0.0;
  }
  if (experiment.lab)
    addTransportAttributes(experiment, log, attrs);
  if (!experiment.scene)
    return attrs;
  const Scene& scene = *experiment.scene;
  attrs["scene"] = scene.name;
  attrs["map"] = mapOf(scene);
  attrs["start"] = std::vector<double>{ scene.start(0), scene.start(1) };
  attrs["goal"] = std::vector<double>{ scene.goal(0), scene.goal(1) };
  if (std::isfinite(scene.turning_x))
    attrs["turning_point_x"] = scene.turning_x;
  if (!scene.path.empty())
  {
    py::list path;
    for (const Eigen::Vector2d& x : scene.path)
      path.append(std::vector<double>{ x(0), x(1) });
    attrs["path"] = path;
    attrs["pace"] = experiment.pace;
  }
  py::list obstacles;
  for (const MovingObstacle& obstacle : scene.obstacles)
  {
    py::dict box;
    box["center"] = std::vector<double>{ obstacle.center(0), obstacle.center(1) };
    box["half_size"] = std::vector<double>{ obstacle.half_size(0), obstacle.half_size(1) };
    box["amplitude"] = obstacle.amplitude;
    obstacles.append(box);
  }
  attrs["obstacles"] = obstacles;
  return attrs;
}

py::object table(const Experiment& experiment, const TrialLog& log)
{
  using Record = phri_control::TickRecord;
  py::dict columns;
  columns["t"] = column<double>(log, [](const Record& r) { return r.time_ns * 1e-9; });
  const std::pair<const char*, phri_core::VectorDof Record::*> vectors[] = {
    { "", &Record::position },
    { "v", &Record::velocity },
    { "human_", &Record::human_wrench },
    { "environment_", &Record::environment_wrench },
    { "assistance_", &Record::assistance_wrench },
    { "requested_", &Record::requested_wrench },
  };
  static const std::array<std::string, 3> axes = { "x", "y", "yaw" };
  const int dof = log.ticks.empty() ? 2 : std::min<int>(3, int(log.ticks.front().position.size()));
  for (const auto& [prefix, field] : vectors)
    for (int axis = 0; axis < dof; ++axis)
      columns[py::str(prefix + axes[std::size_t(axis)])] =
          column<double>(log, [field = field, axis](const Record& r) { return (r.*field)(axis); });
  columns["state"] = column<std::int64_t>(log, [](const Record& r) { return std::int64_t(r.state); });
  columns["fault"] = column<std::int64_t>(log, [](const Record& r) { return std::int64_t(r.fault); });
  columns["limits"] = column<std::int64_t>(log, [](const Record& r) { return std::int64_t(r.limits); });
  columns["tank"] = column<double>(log, [](const Record& r) { return r.tank; });
  columns["passivity"] = column<double>(log, [](const Record& r) { return r.passivity; });
  addPredictions(log, columns);
  addTransportColumns(log, experiment.replanTicks(), columns);
  py::object frame = py::module_::import("pandas").attr("DataFrame")(columns);
  frame.attr("attrs") = attributes(experiment, log);
  return frame;
}

/// Python's numbers, flags, texts and lists as parameters; pybind11's own variant would read the integer 5 as true.
Parameters parameters(const py::dict& given)
{
  Parameters out;
  for (const auto& [key, value] : given)
  {
    const std::string name = py::str(key);
    if (py::isinstance<py::bool_>(value))
      out[name] = value.cast<bool>();
    else if (py::isinstance<py::str>(value))
      out[name] = value.cast<std::string>();
    else if (!py::isinstance<py::sequence>(value))
      out[name] = value.cast<double>();
    else if (py::len(value) > 0 && py::isinstance<py::str>(value[py::int_(0)]))
      out[name] = value.cast<std::vector<std::string>>();
    else
      out[name] = value.cast<std::vector<double>>();
  }
  return out;
}

std::vector<TrialLog> runUnlocked(const ExperimentPtr& experiment, const Block& block)
{
  py::gil_scoped_release unlocked;
  return runBlock(experiment, block);
}

py::object runOne(const py::object& experiment, const std::string& controller, int participant, int seed, int trial)
{
  const ExperimentPtr loaded = py::isinstance<Experiment>(experiment)
                                   ? experiment.cast<ExperimentPtr>()
                                   : std::make_shared<const Experiment>(loadExperiment(experiment.cast<std::string>()));
  const int last = trial > 0 ? trial : loaded->trials;
  if (participant < 0)
    throw py::value_error("participant = " + std::to_string(participant) + ": expected 0 or more");
  Block block{ participant, controller, std::uint64_t(seed), {} };
  for (int k = 1; k <= last; ++k)
    block.trials.push_back(trialSpec(participant, controller, k, loaded->trials, k - 1, seed));
  return table(*loaded, runUnlocked(loaded, block).back());
}
/// One trial in which nobody learns and nobody predicts: under condition (a) the same as within its block.
py::object runAlone(const ExperimentPtr& experiment, const TrialSpec& spec)
{
  const auto run = [&] {
    py::gil_scoped_release unlocked;
    return runTrial(experiment, spec, nullptr);
  };
  return table(*experiment, run());
}

HumanPartner makePartner(const Experiment& experiment, const Participant& person, int practice, double mass,
                         double damping, std::uint64_t seed)
{
  const auto route = std::make_shared<const Route>(planRoute(*experiment.scene, person.clearance));
  return HumanPartner(experiment.scene, route, person, practice, mass, damping, seed);
}

/// The person, by read-write fields, and the partner that a person is, without device, loop or robot.
void bindPeople(py::module_& m)
{
  py::class_<Trait>(m, "Trait", "Distribution of one parameter over simulated people; limits clamp every draw.")
      .def_readonly("key", &Trait::key)
      .def_readonly("unit", &Trait::unit)
      .def_property_readonly("log_normal", [](const Trait& trait) { return trait.shape == Trait::Shape::LogNormal; })
      .def_readonly("median", &Trait::median)
      .def_readonly("spread", &Trait::spread, "standard deviation; of a log-normal: coefficient of variation")
      .def_readonly("low", &Trait::low)
      .def_readonly("high", &Trait::high)
      .def_readonly("help", &Trait::help);

  py::class_<Participant> participant(m, "Participant", "Parameters of one simulated person.");
  participant.def(py::init<>()).def_readonly("index", &Participant::index);
  static const Population population;
  for (const Trait& trait : population.traits)
    participant.def_readwrite(trait.key.c_str(), trait.field, (trait.help + " [" + trait.unit + "]").c_str());

  py::class_<HumanPartner>(m, "HumanPartner", "One simulated person alone: position and velocity in, force out.")
      .def(py::init(&makePartner), py::arg("experiment"), py::arg("person"), py::arg("practice"), py::arg("mass"),
           py::arg("damping"), py::arg("seed"),
           "In the scene of the experiment; mass [kg] and damping [Ns/m] of the object that the person has learned.")
      .def(
          "step",
          [](HumanPartner& human, double t, const Eigen::Vector2d& x, const Eigen::Vector2d& v,
             const Eigen::Vector2d& robot_force) { return human.step(t, x, v, robot_force, {}); },
          py::arg("t"), py::arg("x"), py::arg("v"), py::arg("robot_force") = Eigen::Vector2d(0, 0),
          "One millisecond without moving obstacles; returns the force [N] BY the person ON the handle. The person\n"
          "starts to move at t = 0.3 s; with t = 0 for ever he or she holds the start.")
      .def_property_readonly("intended_position", [](const HumanPartner& human) { return human.intention().position; });
}

/// One value per pixel of the picture, row 0 on top.
template <typename Value>
py::array_t<Value> pixels(const Scene& scene, const std::function<Value(int column, int row)>& value)
{
  py::array_t<Value> out({ scene.image.height, scene.image.width });
  Value* data = out.mutable_data();
  for (int row = 0; row < scene.image.height; ++row)
    for (int column = 0; column < scene.image.width; ++column)
      *data++ = value(column, row);
  return out;
}

void addScene(py::module_& m)
{
  py::register_exception<PictureError>(m, "PictureError", PyExc_ValueError);
  py::class_<Scene, std::shared_ptr<Scene>>(m, "Scene", "A picture as a maze, in metres; what load_scene gives.")
      .def_readonly("name", &Scene::name)
      .def_readonly("image_path", &Scene::image_path)
      .def_readonly("start", &Scene::start)
      .def_readonly("goal", &Scene::goal)
      .def_readonly("object_radius", &Scene::object_radius)
      .def_readonly("goal_radius", &Scene::goal_radius)
      .def_property_readonly(
          "resolution", [](const Scene& s) { return s.walls.resolution(); }, "[m/pixel]")
      .def_property_readonly(
          "origin",
          [](const Scene& s) {
            return Eigen::Vector2d(s.walls.origin() + Eigen::Vector2d::Constant(s.walls.resolution()));
          },
          "Lower left corner of the picture [m].")
      .def_property_readonly(
          "image",
          [](const Scene& s) {
            return pixels<std::uint8_t>(s, [&](int i, int j) { return s.image.pixels[j * s.image.width + i]; });
          },
          "Luma, (height, width), row 0 on top, 0 black to 255 white; dots are white.")
      .def_property_readonly(
          "distances",
          [](const Scene& s) {
            return pixels<double>(s, [&](int i, int j) { return s.walls.cell(i + 1, s.image.height - j); });
          },
          "Distance to the nearest wall [m] at the pixels' centres, (height, width), row 0 on top; negative inside.")
      .def(
          "distance", [](const Scene& s, const Eigen::Vector2d& x) { return s.walls.distance(x); }, py::arg("x"),
          "Distance of the point x to the nearest wall [m].")
      .def(
          "route", [](const Scene& s, double clearance) { return planRoute(s, clearance).points; },
          py::arg("clearance") = 0.012, "Comfortable way from start to goal, list of (2,) [m].");
  m.def("load_scene", &loadScene, py::arg("name_or_path"),
        "A scene of config/scenes, a yaml file or a picture alone (docs/scenes.md). Raises ValueError: PictureError\n"
        "for the picture, phri_core.ParameterError for keys of the yaml file.");
}
}  // namespace

PYBIND11_MODULE(phri_sim, m)
{
  m.doc() = "Experiments with simulated people in lockstep: the same tick as in ROS, without ROS.";
  py::module_::import("phri_core");
  py::module_::import("phri_control");

  bindPeople(m);
  py::class_<Experiment, std::shared_ptr<Experiment>>(m, "Experiment", "A validated experiment, by name or YAML path.")
      .def(py::init([](const std::string& name, const py::dict& overrides) {
             return std::make_shared<Experiment>(loadExperiment(name, parameters(overrides)));
           }),
           py::arg("name"), py::arg("overrides") = py::dict(),
           "overrides: flat keys such as 'model/states' or 'override/robots/admittance/mass'.")
      .def_readonly("name", &Experiment::name)
      .def_readonly("path", &Experiment::path)
      .def_readonly("controllers", &Experiment::controllers)
      .def_readonly("participants", &Experiment::participants)
      .def_readonly("trials", &Experiment::trials)
      .def_readonly("seed", &Experiment::seed)
      .def_readonly("assistance_off", &Experiment::assistance_off, "Trials with predictions, but without assistance.")
      .def_readonly("pace", &Experiment::pace, "[s] of the exemplary run to follow; 0: none")
      .def_property_readonly(
          "learns_on", [](const Experiment& e) { return e.model.emerging(); },
          "Whether the model learns during the trials, not between them.")
      .def_property_readonly(
          "traits",
          [](const Experiment& e) {
            if (e.planar())
              return e.population.traits;
            std::vector<Trait> traits;
            for (const CarryingTrait& t : e.carriers.traits)
              traits.push_back({ nullptr, t.key, t.unit, t.shape, t.median, t.spread, t.low, t.high, t.help });
            return traits;
          },
          "Distributions of the population: [Trait].")
      .def("person",
           [](const Experiment& e, std::uint64_t seed, int index) { return e.population.person(seed, index); })
      .def(
          "route",
          [](const Experiment& e, double clearance) {
            if (!e.scene)
              throw py::value_error("experiment " + e.name + " is no maze: it has no route from start to goal");
            return planRoute(*e.scene, clearance).points;
          },
          py::arg("clearance") = 0.012, "Comfortable way from start to goal, list of (2,) [m].");

  py::class_<TrialSpec>(m, "TrialSpec")
      .def(py::init(&trialSpec), py::arg("participant"), py::arg("controller"), py::arg("trial"), py::arg("trials"),
           py::arg("practice"), py::arg("study_seed"))
      .def_readonly("participant", &TrialSpec::participant)
      .def_readonly("controller", &TrialSpec::controller)
      .def_readonly("trial", &TrialSpec::trial)
      .def_readonly("practice", &TrialSpec::practice)
      .def_readonly("evaluated", &TrialSpec::evaluated)
      .def_readonly("seed", &TrialSpec::seed)
      .def_readonly("study_seed", &TrialSpec::study_seed);
  py::class_<Block>(m, "Block", "All trials of one participant under one controller.")
      .def_readonly("participant", &Block::participant)
      .def_readonly("controller", &Block::controller)
      .def_readonly("seed", &Block::seed)
      .def_readonly("trials", &Block::trials)
      .def(py::pickle(
          [](const Block& b) {
            return py::make_tuple(b.participant, b.controller, b.seed, b.trials.size(),
                                  b.trials.empty() ? 0 : b.trials.front().practice);
          },
          [](const py::tuple& state) {
            Block block{ state[0].cast<int>(), state[1].cast<std::string>(), state[2].cast<std::uint64_t>(), {} };
            const int trials = state[3].cast<int>(), practice = state[4].cast<int>();
            for (int trial = 1; trial <= trials; ++trial)
              block.trials.push_back(
                  trialSpec(block.participant, block.controller, trial, trials, practice + trial - 1, block.seed));
            return block;
          }));

  m.def("schedule", &schedule, py::arg("experiment"), py::arg("participants") = 0, py::arg("trials") = 0,
        py::arg("seed") = 7, "Blocks of the study in balanced order; 0: the experiment's own numbers.");
  m.def(
      "run_block",
      [](const std::shared_ptr<Experiment>& experiment, const Block& block) {
        py::list tables;
        for (const TrialLog& log : runUnlocked(experiment, block))
          tables.append(table(*experiment, log));
        return tables;
      },
      py::arg("experiment"), py::arg("block"), "All trials of a block, learning in between: a list of trial tables.");
  m.def("run_trial", &runOne, py::arg("experiment"), py::arg("controller") = "none", py::arg("participant") = 0,
        py::arg("seed") = 7, py::arg("trial") = 0,
        "Runs trial number `trial` (default: the last, evaluated one) of a participant under a controller, after the\n"
        "trials before it, from which the robot learns. Returns its table: one row per millisecond, SI units.");
  m.def("run_alone", &runAlone, py::arg("experiment"), py::arg("spec"),
        "The trial `spec` without a model: nobody predicts or assists. Returns its table.");
  m.def(
      "demonstration",
      [](const py::object& frame, int every) {
        py::object rows = frame.attr("iloc")[py::slice(0, std::int64_t(py::len(frame)), every)];
        const std::vector<std::string> names{ "x", "y", "vx", "vy", "human_x", "human_y" };
        return rows.attr("__getitem__")(names).attr("to_numpy")();
      },
      py::arg("table"), py::arg("every") = 20, "Samples [x; xdot; u_h] (T, 6) of a trial table, every 20 ms.");
  addScene(m);
  bindContactRun(m, &parameters);
  m.def("parameter_reference", &parameterReference, "Every parameter of every configuration file, as Markdown.");
}
