#include "phri_sim/experiment.hpp"

#include <algorithm>
#include <filesystem>
#include <optional>

#include "phri_core/random.hpp"
#include "phri_learning/behavior_models.hpp"

namespace phri_sim
{
namespace
{
/// The keys of an experiment file.
struct ExperimentFile
{
  std::string scene = "maze", robot = "haptic_2dof", safety = "haptic_2dof", participants = "simulated_adults";
  std::vector<double> segmentation_scale;

  phri_core::ParameterTable table(Experiment& e)
  {
    phri_learning::EmergingOptions& l = e.model.learning;
    phri_core::ParameterTable t;
    t.text("task", &e.task, { "planar", "transport" }, "object on a plane, or bumper carried by robot and person")
        .text("scene", &scene, {}, "file in config/scenes")
        .names("routes", &e.routes, {}, "transport: of the scene, one per trial, again from the first; none: all")
        .text("robot", &robot, {}, "file in config/robots")
        .text("safety", &safety, {}, "file in config/safety")
        .text("population", &participants, {}, "file in config/participants")
        .names("controllers", &e.controllers, phri_control::assistanceNames(), "conditions of the study")
        .integer("participants", &e.participants, "", 1, 100000, "simulated people")
        .integer("trials", &e.trials, "", 1, 1000, "per person and controller; the last one is evaluated")
        .integer("seed", &e.seed, "", 0, 2147483647, "of the study")
        .number("timeout", &e.timeout, "s", 1.0, 3600.0, "after which a trial ends without the goal")
        .list("let_go/trials", &e.let_go_in, 0, "", 1.0, 1000.0, "in which the simulated person lets the handle go")
        .number("let_go/after", &e.let_go_after, "s", 0.0, 3600.0, "from the start of such a trial")
        .text("model/kind", &e.model.kind, { "time_hmm", "emerging" }, "learned between trials, or during them")
        .integer("model/states", &e.model.states, "", 2, 1000, "states of the time-based HMM, of a primitive")
        .number("pace", &e.pace, "s", 0.0, 3600.0, "of an exemplary run along the path, to be followed; 0: none")
        .list("assistance_off", &e.assistance_off, 0, "", 1.0, 1000.0, "trials with predictions but without assistance")
        .text("model/reference", &e.model.reference, { "path", "displacement" }, "what a prediction refers to")
        .text("model/time", &e.model.time, { "thesis", "entry_corrected", "regressed" }, "how progress is estimated")
        .text("model/recognition", &e.model.recognition, { "position", "motion", "all" }, "what tells the progress")
        .number("model/gate", &e.model.gate, "m", 0.0, 10.0, "farther predictions are ignored; 0: none are")
        .flag("model/adapt_pace", &e.model.adapt_pace, "model time passes at the observed pace")
        .integer("model/window", &e.model.window, "samples", 1, 1000, "that recognition looks back")
        .number("model/dt", &e.model.dt, "s", 0.005, 0.1, "observations, predictions and plans are this far apart")
        .number("model/horizon", &e.model.horizon, "s", 0.02, 5.0, "of the predictions")
        .number("model/learning/dt", &l.dt, "s", 0.005, 1.0, "emerging: samples learned from are this far apart")
        .integer("model/learning/members", &l.primitives.members, "", 2, 100, "segments that make a primitive")
        .number("model/learning/cutoff", &l.primitives.cutoff, "-", 0.01, 0.99, "K_cut of the clustering")
        .integer("model/learning/window_states", &l.window_states, "", 2, 1000, "of the window HMM, even")
        .integer("model/learning/segment_window", &l.segmentation.window, "samples", 2, 1000, "W of the segmentation")
        .number("model/learning/switch_cost", &l.segmentation.switch_cost, "-", 1e-3, 1e6, "C of the segmentation")
        .integer("model/learning/lag", &l.segmentation.lag, "samples", 1, 1000, "a boundary rests before it is final")
        .list("model/learning/scale", &segmentation_scale, 0, "m, rad, m/s, rad/s", 1e-6, 1e6,
              "what counts as a change, per coordinate and its rate; none: from the first samples");
    return t;
  }
};

struct RobotFile
{
  explicit RobotFile(const std::string& task)
    : planar(task == "planar"), mass(planar ? 2 : 3, 90.0), damping(mass.size(), 200.0)
  {
  }
  bool planar;
  std::vector<double> mass, damping;

  phri_core::ParameterTable table(Experiment& e)
  {
    phri_core::ParameterTable t;
    t.list("admittance/mass", &mass, mass.size(), planar ? "kg" : "kg, kgm2", 0.01, 500.0, "rendered mass per axis")
        .list("admittance/damping", &damping, mass.size(), planar ? "Ns/m" : "Ns/m, Nms/rad", 0.0, 5000.0,
              "rendered damping per axis")
        .number("loop/replan_blend", &e.loop.replan_blend, "s", 0.0, 0.2, "a newer plan replaces the older one within");
    if (planar)
      addParameters(t, e.sensors);
    else
    {
      addParameters(t, e.robot);
      addParameters(t, e.force_sensor);
    }
    return t;
  }
};

/// Runs `load`; collects what is wrong instead of throwing it.
template <typename Load>
void collect(std::vector<std::string>& errors, Load&& load)
{
  try
  {
    load();
  }
  catch (const phri_core::ParameterError& error)
  {
    const std::string text = error.what(), where = text.substr(0, text.find(": "));
    for (const std::string& line : error.errors())
      errors.push_back(where + ": " + line);
  }
  catch (const std::exception& error)
  {
    errors.push_back(error.what());
  }
}

Parameters merged(Parameters base, const Parameters& over)
{
  for (const auto& [key, value] : over)
    base[key] = value;
  return base;
}
}  // namespace

Experiment loadExperiment(const std::string& name_or_path, const Parameters& overrides)
{
  Experiment e;
  e.path = findConfiguration("experiments", name_or_path);
  e.name = std::filesystem::path(e.path).stem().string();
  const Parameters all = merged(loadYaml(e.path), overrides);
  Parameters own;
  for (const auto& [key, value] : all)
    if (key.rfind("assistance/", 0) != 0 && key.rfind("override/", 0) != 0)
      own[key] = value;

  ExperimentFile file;
  std::vector<std::string> errors;
  const auto part = [&](const std::string& kind, const std::string& name, phri_core::ParameterTable table) {
    const std::string path = findConfiguration(kind, name);
    table.assign(path, merged(loadYaml(path), underPrefix(all, "override/" + kind)));
  };
  collect(errors, [&] { file.table(e).assign(e.path, own); });
  RobotFile robot(e.task);
  collect(errors, [&] {
    phri_control::parameterTable(e.assistance).assign(e.path + " assistance", underPrefix(all, "assistance"));
  });
  std::optional<PictureError> picture;
  collect(errors, [&] {
    if (!e.planar())
    {
      e.lab = std::make_shared<const Lab>(loadLab(file.scene));
      return;
    }
    try
    {
      e.scene = std::make_shared<const Scene>(loadScene(file.scene));
    }
    catch (const PictureError& error)
    {
      picture = error;
      throw;
    }
  });
  collect(errors, [&] { part("robots", file.robot, robot.table(e)); });
  collect(errors, [&] { part("safety", file.safety, phri_core::parameterTable(e.loop.safety)); });
  collect(errors,
          [&] { part("participants", file.participants, e.planar() ? e.population.table() : e.carriers.table()); });
  for (const auto& [key, value] : all)
    if (key.rfind("override/", 0) == 0 && key.rfind("override/robots/", 0) != 0 &&
        key.rfind("override/safety/", 0) != 0 && key.rfind("override/participants/", 0) != 0)
      errors.push_back(e.path + ": " + key + ": unknown key; known: override/robots/..., override/safety/..., " +
                       "override/participants/...");
  if (errors.empty() && e.controllers.empty())
    errors.push_back(e.path + ": controllers: none given; expected at least one");
  if (std::abs(e.model.dt / e.loop.dt - e.replanTicks()) > 1e-9)
    errors.push_back(e.path + ": model/dt = " + std::to_string(e.model.dt) + " s: expected a multiple of the tick, " +
                     std::to_string(e.loop.dt) + " s");
  if (e.pace > 0.0 && e.scene && e.scene->path.empty())
    errors.push_back(e.path + ": pace = " + std::to_string(e.pace) + " s: expected 0 in a scene without a path");
  e.model.dof = e.planar() ? 2 : 3;
  e.model.learning.segmentation.scale =
      Eigen::Map<const Eigen::VectorXd>(file.segmentation_scale.data(), Eigen::Index(file.segmentation_scale.size()));
  if (e.lab)
  {
    if (e.routes.empty())
      for (const LabRoute& route : e.lab->routes)
        e.routes.push_back(route.name);
    for (const std::string& route : e.routes)
      collect(errors, [&] { e.lab->route(route); });
  }
  if (e.model.emerging())
    collect(errors, [&] { phri_learning::checkOptions(e.model.emergingOptions()); });
  if (picture && errors.size() == 1)
    throw *picture;  // nothing is wrong but the picture: bad data, not a bad configuration
  if (!errors.empty())
    throw phri_core::ParameterError(name_or_path, errors);

  e.loop.mass = Eigen::Map<const Eigen::VectorXd>(robot.mass.data(), Eigen::Index(robot.mass.size()));
  e.loop.damping = Eigen::Map<const Eigen::VectorXd>(robot.damping.data(), Eigen::Index(robot.damping.size()));
  e.loop.safety.rotations = e.assistance.rotations = e.planar() ? 0 : 1;
  e.assistance.mass = e.loop.mass;
  e.assistance.damping = e.loop.damping;
  return e;
}

phri_learning::EmergingOptions ModelSettings::emergingOptions() const
{
  phri_learning::EmergingOptions options = learning;
  options.dof = dof;
  options.horizon = horizon;
  options.reference = phri_learning::referenceNamed(reference);
  options.time = phri_learning::timeEstimateNamed(time);
  options.recognition = phri_learning::recognitionNamed(recognition);
  options.recogniser.window = window;
  options.primitives.training.states = states;
  return options;
}

std::string parameterReference()
{
  Experiment e;
  ExperimentFile file;
  RobotFile robot("planar");
  return "## Experiment (`config/experiments`)\n\n" + file.table(e).markdown() + "\n### `assistance/`\n\n" +
         phri_control::parameterTable(e.assistance).markdown() + "\n## Robot (`config/robots`)\n\n" +
         robot.table(e).markdown() + "\n## Safety profile (`config/safety`)\n\n" +
         phri_core::parameterTable(e.loop.safety).markdown() + "\n## Participants (`config/participants`)\n\n" +
         e.population.table().markdown();
}

TrialSpec trialSpec(int participant, const std::string& controller, int trial, int trials, int practice,
                    std::uint64_t study_seed)
{
  const std::uint64_t index = std::uint64_t(participant) * 100003u + std::uint64_t(trial);
  return { participant, controller,      trial,
           practice,    trial == trials, phri_core::Random::stream(study_seed, "trial", index).bits(),
           study_seed };
}

std::vector<Block> schedule(const Experiment& experiment, int participants, int trials, std::uint64_t seed)
{
  const int people = participants > 0 ? participants : experiment.participants;
  const int repetitions = trials > 0 ? trials : experiment.trials;
  const int n = int(experiment.controllers.size());
  std::vector<Block> blocks;
  for (int person = 0; person < people; ++person)
    for (int place = 0; place < n; ++place)
    {
      // Williams' square: 0, 1, n-1, 2, n-2, ... shifted by the row; odd n needs the mirrored rows too
      const bool mirrored = n % 2 == 1 && (person / n) % 2 == 1;
      const int position = mirrored ? n - 1 - place : place;
      const int first_row = position % 2 == 1 ? (position + 1) / 2 : (n - position / 2) % n;
      Block block{ person, experiment.controllers[(first_row + person) % n], seed, {} };
      for (int trial = 1; trial <= repetitions; ++trial)
        block.trials.push_back(
            trialSpec(person, block.controller, trial, repetitions, place * repetitions + trial - 1, seed));
      blocks.push_back(block);
    }
  return blocks;
}
}  // namespace phri_sim
