#include "phri_sim/contact_task.hpp"

#include <cmath>
#include <filesystem>

namespace phri_sim
{
namespace
{
using Eigen::Vector3d;

constexpr double kFar = 10.0;  // [m] no coordinate of a scene is beyond it

/// The keys of a scene file.
struct SceneFile
{
  std::string task = "press";
  double tilt = 0.0, tip = 0.0;
  std::vector<double> start{ 0, 0, 0 }, press{ 0, 0, -1 }, button{ 0, 0, 0 }, point{ 0, 0, 0 };
  std::vector<double> board{ 0, 0, 0 }, board_size{ 1.2, 0.9 }, text{ 0, 0 }, text_size{ 0.3, 0.1 };
  double pressure = 1000.0;
  std::vector<double> x, y, z, duration, force, scatter;

  phri_core::ParameterTable table()
  {
    phri_core::ParameterTable t;
    t.text("task", &task, { "press", "wipe" }, "press a button and point, or wipe a text off a board")
        .number("tool/tilt", &tilt, "deg", 0.0, 120.0, "from straight down toward x")
        .number("tool/tip", &tip, "m", 0.0, 0.5, "from the gripper's tcp along the tool")
        .list("start", &start, 3, "m", -kFar, kFar, "of the tip")
        .list("press_direction", &press, 3, "-", -1.0, 1.0,
              "unit vector into the environment; displacements go along it")
        .list("button/position", &button, 3, "m", -kFar, kFar, "middle of the plate's back")
        .list("point", &point, 3, "m", -kFar, kFar, "where the tip is to be in the end")
        .list("board/position", &board, 3, "m", -kFar, kFar, "middle of the surface, which looks along -x")
        .list("board/size", &board_size, 2, "m", 0.01, kFar, "along y and z")
        .list("text/position", &text, 2, "m", -kFar, kFar, "middle, to the right and up from the board's")
        .list("text/size", &text_size, 2, "m", 0.01, kFar, "")
        .number("text/pressure", &pressure, "Pa", 1.0, 1e6, "that wipes")
        .list("motion/x", &x, 0, "m", -kFar, kFar, "ends of the intended legs")
        .list("motion/y", &y, 0, "m", -kFar, kFar, "")
        .list("motion/z", &z, 0, "m", -kFar, kFar, "")
        .list("motion/duration", &duration, 0, "s", 0.1, 60.0, "of each leg")
        .list("motion/force", &force, 0, "N", 0.0, 50.0, "pressed with at its end")
        .list("motion/scatter", &scatter, 0, "m", 0.0, 0.1, "standard deviation of its end between demonstrations");
    return t;
  }
};

Vector3d vector(const std::vector<double>& list)
{
  return { list[0], list[1], list[2] };
}

/// The keys of an experiment file.
struct TaskFile
{
  std::string task = "contact", scene = "button", robot = "lwr", safety = "lwr_contact";

  phri_core::ParameterTable table(ContactTask& c)
  {
    phri_core::ParameterTable t;
    t.text("task", &task, { "contact" }, "a demonstrated task with contact is repeated")
        .text("scene", &scene, {}, "file in config/scenes")
        .text("robot", &robot, {}, "file in config/robots")
        .text("safety", &safety, {}, "file in config/safety")
        .names("controllers", &c.controllers, phri_control::contactControllerNames(), "of the study")
        .list("displacements", &c.displacements, 0, "m", -0.2, 0.2, "conditions of the study")
        .integer("seeds", &c.seeds, "", 1, 100000, "repetitions of every cell, each with its own demonstrations")
        .integer("seed", &c.seed, "", 0, 2147483647, "of the study")
        .integer("demonstrations", &c.demonstrations, "", 1, 1000, "that a model is learned from")
        .integer("model/states", &c.states, "", 2, 1000, "of the time-based HMM")
        .number("rest", &c.rest, "s", 0.0, 60.0, "beyond the end of the learned motion")
        .number("success/pointing", &c.pointing_tolerance, "m", 1e-4, 0.1, "largest distance of the tip from the point")
        .number("success/wiped", &c.wiped_success, "-", 0.0, 1.0, "share of the text")
        .number("success/partly_wiped", &c.wiped_partial, "-", 0.0, 1.0, "more than this share: partial success");
    addParameters(t, c.teacher);
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
}  // namespace

Eigen::Matrix3d ContactScene::orientation() const
{
  Eigen::Matrix3d axes;
  axes.col(2) << std::sin(tilt), 0.0, -std::cos(tilt);
  axes.col(1) = Vector3d::UnitY();
  axes.col(0) = axes.col(1).cross(axes.col(2));
  return axes;
}

ContactScene loadContactScene(const std::string& name_or_path)
{
  const std::string path = findConfiguration("scenes", name_or_path);
  SceneFile file;
  file.table().assign(path, loadYaml(path));
  std::vector<std::string> errors;
  const std::size_t legs = file.x.size();
  const auto count = [&](const char* key, const std::vector<double>& list) {
    if (list.size() != legs)
      errors.push_back(std::string("motion/") + key + ": " + std::to_string(list.size()) + " elements; expected " +
                       std::to_string(legs) + ", as motion/x has");
  };
  count("y", file.y), count("z", file.z), count("duration", file.duration), count("force", file.force);
  count("scatter", file.scatter);
  if (legs == 0)
    errors.push_back("motion/x: no element; expected at least one leg");
  const Vector3d press = vector(file.press);
  constexpr double kUnit = 1e-6;
  if (std::abs(press.norm() - 1.0) > kUnit)
    errors.push_back("press_direction: of length " + std::to_string(press.norm()) + "; expected 1");
  if (!errors.empty())
    throw phri_core::ParameterError(path, errors);

  ContactScene scene;
  scene.name = std::filesystem::path(path).stem().string();
  scene.wipes = file.task == "wipe";
  scene.tilt = file.tilt * M_PI / 180.0;
  scene.tip = file.tip;
  scene.start = vector(file.start);
  scene.button = vector(file.button);
  scene.point = vector(file.point);
  scene.board.pose.translation() = vector(file.board);
  scene.board.pose.linear() << 0, 0, -1, -1, 0, 0, 0, 1, 0;
  scene.board.size << file.board_size[0], file.board_size[1];
  scene.board.text_centre << file.text[0], file.text[1];
  scene.board.text_size << file.text_size[0], file.text_size[1];
  scene.board.pressure = file.pressure;
  scene.motion.press = press;
  for (std::size_t i = 0; i < legs; ++i)
    scene.motion.legs.push_back(
        { { file.x[i], file.y[i], file.z[i] }, file.duration[i], file.force[i], file.scatter[i] });
  return scene;
}

ContactTask loadContactTask(const std::string& name_or_path, const Parameters& overrides)
{
  ContactTask c;
  c.path = findConfiguration("experiments", name_or_path);
  c.name = std::filesystem::path(c.path).stem().string();
  c.controllers = phri_control::contactControllerNames();
  c.displacements = { 0.0 };
  Parameters all = loadYaml(c.path), own;
  for (const auto& [key, value] : overrides)
    all[key] = value;
  for (const auto& [key, value] : all)
    if (key.rfind("contact/", 0) != 0)
      own[key] = value;

  TaskFile file;
  std::vector<double> mass(3, 10.0), damping(3, 80.0);
  std::vector<std::string> errors;
  collect(errors, [&] { file.table(c).assign(c.path, own); });
  collect(errors,
          [&] { phri_control::parameterTable(c.control).assign(c.path + " contact", underPrefix(all, "contact")); });
  collect(errors, [&] { c.scene = loadContactScene(file.scene); });
  collect(errors, [&] {
    phri_core::ParameterTable table;
    table.list("admittance/mass", &mass, 3, "kg", 0.01, 500.0, "rendered mass per axis")
        .list("admittance/damping", &damping, 3, "Ns/m", 0.0, 5000.0, "rendered damping per axis")
        .number("loop/replan_blend", &c.loop.replan_blend, "s", 0.0, 0.2, "a newer plan replaces the older one within");
    addParameters(table, c.robot);
    addParameters(table, c.force_sensor);
    const std::string path = findConfiguration("robots", file.robot);
    table.assign(path, loadYaml(path));
  });
  collect(errors, [&] {
    const std::string path = findConfiguration("safety", file.safety);
    phri_core::parameterTable(c.loop.safety).assign(path, loadYaml(path));
    if (!c.loop.safety.autonomous_completion)
      errors.push_back(path + ": autonomous_completion: false; expected true, for nobody holds the tool");
  });
  if (!errors.empty())
    throw phri_core::ParameterError(name_or_path, errors);
  c.control.mass = Eigen::Map<const Eigen::VectorXd>(mass.data(), 3);
  c.control.damping = Eigen::Map<const Eigen::VectorXd>(damping.data(), 3);
  c.loop.mass = c.control.mass.cwiseQuotient(c.control.force_gain);
  c.loop.damping = c.control.damping.cwiseQuotient(c.control.force_gain);
  c.force_sensor.dt = c.loop.dt;
  phri_control::requireValid(c.control);
  return c;
}
}  // namespace phri_sim
