// What the table of a transport has beside the columns of every trial; see `run_trial`.
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>

#include "phri_sim/trial.hpp"

namespace py = pybind11;
using namespace phri_sim;

namespace
{
constexpr int kPlaces = 9, kObservation = 12;
/// True poses in the world, then the observation of 5.1.2: position, angular velocity, force and torque.
constexpr std::array<const char*, kPlaces + kObservation> kNames = {
  "grasp_x", "grasp_y", "grasp_yaw", "far_x", "far_y", "far_yaw", "base_x", "base_y", "base_yaw", "p_x", "p_y",
  "p_z",     "w_x",     "w_y",       "w_z",   "f_x",   "f_y",     "f_z",    "m_x",    "m_y",      "m_z"
};

double valueOf(const TransportSample& sample, int i)
{
  if (i >= kPlaces)
    return sample.observation(i - kPlaces);
  const Eigen::Vector3d& place = i < 3 ? sample.grasp : i < 6 ? sample.far_grasp : sample.base;
  return place(i % 3);
}

std::vector<double> pair(const Eigen::Vector2d& x)
{
  return { x(0), x(1) };
}

/// In `odom`, from above: [[[x, y, yaw], ..], ..].
py::list outputsOf(const TrialLog& log)
{
  py::list outputs;
  for (const Eigen::MatrixXd& output : log.primitive_outputs)
  {
    std::vector<std::vector<double>> path;
    for (Eigen::Index t = 0; t < output.rows(); ++t)
      path.push_back({ output(t, 0), output(t, 1), output(t, 2) });
    outputs.append(path);
  }
  return outputs;
}
}  // namespace

/// The same on every row until the next sample, `every` ticks later.
void addTransportColumns(const TrialLog& log, int every, py::dict& columns)
{
  if (log.transport.empty())
    return;
  const std::size_t rows = log.ticks.size(), step = std::size_t(every);
  for (int i = 0; i < int(kNames.size()); ++i)
  {
    py::array_t<double> out(rows);
    double* data = out.mutable_data();
    for (std::size_t k = 0; k < rows; ++k)
      data[k] = valueOf(log.transport[std::min(k / step, log.transport.size() - 1)], i);
    columns[kNames[std::size_t(i)]] = out;
  }
}

/// The lab, the way taken, what was learned, and how far `odom` had drifted from the world at the end [m].
void addTransportAttributes(const Experiment& experiment, const TrialLog& log, py::dict& attrs)
{
  const Lab& lab = *experiment.lab;
  const LabRoute& route = lab.route(experiment.routes[std::size_t(log.spec.trial - 1) % experiment.routes.size()]);
  attrs["scene"] = lab.name;
  attrs["route"] = route.name;
  attrs["start"] = pair(lab.start);
  attrs["goal"] = pair(lab.goal);
  attrs["grasp_distance"] = lab.grasp_distance;
  py::list boxes;
  for (const LabBox& box : lab.boxes)
  {
    py::dict entry;
    entry["name"] = box.name;
    entry["center"] = pair(box.center);
    entry["size"] = pair(box.size);
    entry["yaw"] = box.yaw;
    boxes.append(entry);
  }
  attrs["boxes"] = boxes;
  if (!log.primitive_outputs.empty())
    attrs["primitive_outputs"] = outputsOf(log);
  if (!log.transport.empty())
    attrs["odometry_drift"] =
        (log.transport.back().observation.head<2>() - log.transport.back().grasp.head<2>()).norm();
}
