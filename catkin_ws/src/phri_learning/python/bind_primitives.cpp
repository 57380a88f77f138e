// PrimitiveLibrary and what it is made of.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "phri_learning/primitive_library.hpp"

namespace py = pybind11;
using namespace phri_learning;

namespace
{
PrimitiveLibrary makeLibrary(int states, double dt, int members, double cutoff, const std::string& rule, double spread,
                             double laplace, int remembered, int waiting)
{
  if (rule != "log_mean" && rule != "mean")
    throw std::invalid_argument("rule = '" + rule + "', expected 'log_mean' or 'mean'");
  PrimitiveOptions o;
  o.training.states = states;
  o.training.dt = dt;
  o.members = members;
  o.cutoff = cutoff;
  o.rule = rule == "mean" ? CutRule::kMean : CutRule::kLogMean;
  o.spread = spread;
  o.laplace = laplace;
  o.remembered = remembered;
  o.waiting = waiting;
  return PrimitiveLibrary(o);
}
}  // namespace

void bindPrimitives(py::module_& m)
{
  const PrimitiveOptions defaults;
  py::class_<PrimitiveNode>(m, "PrimitiveNode", "A node of the tree; 0 is the root.")
      .def_readonly("id", &PrimitiveNode::id)
      .def_readonly("parent", &PrimitiveNode::parent)
      .def_readonly("children", &PrimitiveNode::children)
      .def_readonly("count", &PrimitiveNode::count, "segments ever added to its branch")
      .def_property_readonly(
          "segments",
          [](const PrimitiveNode& node) {
            std::vector<int> ids;
            for (const PrimitiveSegment& segment : node.segments)
              ids.push_back(segment.id);
            return ids;
          },
          "ids of its own segments, the latest ones")
      .def(
          "samples",
          [](const PrimitiveNode& node) {
            std::vector<Eigen::MatrixXd> samples;
            for (const PrimitiveSegment& segment : node.segments)
              samples.push_back(*segment.samples);
            return samples;
          },
          "Those segments, (T_i, d) each.")
      .def_property_readonly(
          "output", [](const PrimitiveNode& node) { return node.model ? node.model->output : Eigen::MatrixXd(); },
          "Generalised output (T, d); empty for the root.")
      .def_property_readonly(
          "length", [](const PrimitiveNode& node) { return node.model ? node.model->hmm->length() : 0.0; }, "[s]");

  py::class_<PrimitiveLibrary>(m, "PrimitiveLibrary",
                               "Movement primitives learned one segment at a time: a tree and a graph of successions. "
                               "copy() is cheap: add to a copy in another thread and exchange the two.")
      .def(py::init(&makeLibrary), py::arg("states") = defaults.training.states, py::arg("dt") = defaults.training.dt,
           py::arg("members") = defaults.members, py::arg("cutoff") = defaults.cutoff, py::arg("rule") = "log_mean",
           py::arg("spread") = defaults.spread, py::arg("laplace") = defaults.laplace,
           py::arg("remembered") = defaults.remembered, py::arg("waiting") = defaults.waiting)
      .def("add", &PrimitiveLibrary::add, py::arg("segment"), py::arg("follows") = true,
           py::call_guard<py::gil_scoped_release>(),
           "Learns from a segment (T, d); the ids of its nodes from the root down.")
      .def("merge", &PrimitiveLibrary::merge, py::arg("other"), "Takes in another library of equal options.")
      .def("copy", [](const PrimitiveLibrary& library) { return PrimitiveLibrary(library); })
      .def_property_readonly("dimension", &PrimitiveLibrary::dimension)
      .def_property_readonly("segment_count", &PrimitiveLibrary::segmentCount)
      .def_property_readonly("node_ids", &PrimitiveLibrary::nodeIds)
      .def_property_readonly("upper_nodes", &PrimitiveLibrary::upperNodes, "the primitives that predict")
      .def("node", &PrimitiveLibrary::node, py::arg("id"), py::return_value_policy::copy)
      .def("path", &PrimitiveLibrary::path, py::arg("segment"), "Nodes of a segment from the root down.")
      .def("primitive_of", &PrimitiveLibrary::primitiveOf, py::arg("segment"), "Upper node, or -1.")
      .def(
          "successions",
          [](const PrimitiveLibrary& library) {
            const PrimitiveLibrary::Successions s = library.successions();
            return py::make_tuple(s.nodes, s.counts, s.probability);
          },
          "(upper nodes, counts, probabilities): row before, column after.")
      .def("to_json", &PrimitiveLibrary::save, py::arg("path"), "Writes the library, whole or not at all.")
      .def_static("from_json", &PrimitiveLibrary::load, py::arg("path"), "The library of a file, or ModelFileError.");
}
