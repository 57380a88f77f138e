// Contact tasks of 5.4 in Python: ContactTask, teach_contact, run_contact.
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <functional>
#include <optional>

#include "phri_sim/contact_run.hpp"

namespace py = pybind11;
using namespace phri_sim;

namespace
{
using TaskPtr = std::shared_ptr<const ContactTask>;
using TaughtPtr = std::shared_ptr<const TaughtTask>;

template <typename Rows>
py::array_t<double> column(const Rows& rows, const std::function<double(const typename Rows::value_type&)>& value)
{
  py::array_t<double> out(rows.size());
  double* data = out.mutable_data();
  for (const auto& row : rows)
    *data++ = value(row);
  return out;
}

py::dict outcomeOf(const ContactTask& task, const ContactOutcome& o)
{
  py::dict d;
  d["touches"] = o.touches;
  d["clicks"] = o.clicks;
  d["deepest"] = o.deepest;
  d["pointing_error"] = o.pointing_error;
  d["wiped"] = o.wiped;
  d["peak_force"] = o.peak_force;
  d["faulted"] = o.faulted;
  d["limited"] = o.limited;
  if (task.scene.wipes)
    d["wiping"] = wipingVerdict(task, o);
  else
  {
    d["pressing"] = pressingVerdict(o);
    d["pointing"] = pointingVerdict(task, o);
  }
  return d;
}

py::dict columnsOf(const std::vector<ContactSample>& log)
{
  py::dict d;
  const auto scalar = [&](const char* name, double ContactSample::*member) {
    d[name] = column(log, [member](const ContactSample& row) { return row.*member; });
  };
  const auto vector = [&](const std::string& name, Eigen::Vector3d ContactSample::*member) {
    for (int i = 0; i < 3; ++i)
      d[py::str(name + (i == 0   ? "x"
                        : i == 1 ? "y"
                                 : "z"))] =
          column(log, [member, i](const ContactSample& row) { return (row.*member)(i); });
  };
  scalar("t", &ContactSample::t);
  vector("", &ContactSample::position);
  vector("learned_", &ContactSample::learned);
  vector("reference_", &ContactSample::reference);
  vector("stiffness_", &ContactSample::stiffness);
  vector("noise_", &ContactSample::noise);
  vector("input_", &ContactSample::input);
  vector("force_", &ContactSample::force);
  vector("taught_", &ContactSample::taught);
  scalar("contact", &ContactSample::contact);
  scalar("travel", &ContactSample::travel);
  scalar("wiped", &ContactSample::wiped);
  return d;
}

py::tuple runContact(const TaskPtr& task, const std::string& controller, const TaughtPtr& taught, std::uint64_t seed,
                     double displacement)
{
  std::optional<ContactRun> run;
  {
    py::gil_scoped_release unlocked;
    run.emplace(task, controller, taught, ContactTrial{ seed, displacement, -1 });
    while (!run->finished())
      run->step();
  }
  return py::make_tuple(columnsOf(run->log()), outcomeOf(*task, run->outcome()));
}
}  // namespace

/// `parameters`: how the module reads a dict of overrides.
void bindContactRun(py::module_& m, Parameters (*parameters)(const py::dict&))
{
  py::class_<ContactTask, std::shared_ptr<ContactTask>>(m, "ContactTask",
                                                        "A validated contact task (5.4), by name or YAML path.")
      .def(py::init([parameters](const std::string& name, const py::dict& overrides) {
             return std::make_shared<ContactTask>(loadContactTask(name, parameters(overrides)));
           }),
           py::arg("name"), py::arg("overrides") = py::dict(),
           "overrides: flat keys of the experiment file such as 'contact/seeking'.")
      .def_readonly("name", &ContactTask::name)
      .def_readonly("path", &ContactTask::path)
      .def_readonly("controllers", &ContactTask::controllers)
      .def_readonly("displacements", &ContactTask::displacements, "Conditions [m].")
      .def_readonly("demonstrations", &ContactTask::demonstrations)
      .def_readonly("states", &ContactTask::states, "Of the time-based HMM.")
      .def_readonly("seeds", &ContactTask::seeds)
      .def_readonly("seed", &ContactTask::seed)
      .def_readonly("pointing_tolerance", &ContactTask::pointing_tolerance, "[m]")
      .def_readonly("wiped_success", &ContactTask::wiped_success, "[-]")
      .def_readonly("wiped_partial", &ContactTask::wiped_partial, "[-]")
      .def_property_readonly(
          "seeking", [](const ContactTask& t) { return t.control.seeking; }, "-theta of the seeking controllers.")
      .def_property_readonly(
          "press_direction", [](const ContactTask& t) { return t.scene.motion.press; }, "Unit vector.")
      .def_property_readonly("wipes", [](const ContactTask& t) { return t.scene.wipes; });

  py::class_<TaughtTask, std::shared_ptr<TaughtTask>>(m, "TaughtTask", "What demonstrations leave: teach_contact.")
      .def_readonly("repeated", &TaughtTask::repeated, "Demonstrations that failed and were done again.")
      .def_readonly("length", &TaughtTask::length, "Of the learned motion [s].")
      .def_property_readonly(
          "demonstrations",
          [](const TaughtTask& t) {
            py::list all;
            for (const Demonstration& d : t.demonstrations)
              all.append(d.samples);
            return all;
          },
          "[(T, 9)] position, velocity, force by the environment, every 20 ms [m, m/s, N].");

  m.def(
      "teach_contact",
      [](const TaskPtr& task, std::uint64_t seed) {
        py::gil_scoped_release unlocked;
        return std::make_shared<TaughtTask>(teach(task, seed));
      },
      py::arg("task"), py::arg("seed"), "Simulated kinesthetic demonstrations, and the model learned from them.");
  m.def("run_contact", &runContact, py::arg("task"), py::arg("controller"), py::arg("taught"), py::arg("seed"),
        py::arg("displacement"),
        "One reproduction, what is touched displaced by `displacement` [m]. Returns (columns, outcome): a dict of\n"
        "arrays, one element every 20 ms, for pandas.DataFrame, and a dict of what the world says about it.");
}
