// OnlineSegmentation and segment_offline.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "phri_learning/segmentation.hpp"

namespace py = pybind11;
using namespace phri_learning;

namespace
{
WindowDistance distanceNamed(const std::string& name)
{
  if (name != "normalized" && name != "squared")
    throw std::invalid_argument("distance = '" + name + "', expected 'normalized' or 'squared'");
  return name == "normalized" ? WindowDistance::kNormalized : WindowDistance::kSquared;
}
}  // namespace

void bindSegmentation(py::module_& m)
{
  py::class_<SegmentationOptions>(m, "SegmentationOptions", "See segmentation.hpp for units and ranges.")
      .def(py::init<>())
      .def_readwrite("window", &SegmentationOptions::window)
      .def_readwrite("embedding", &SegmentationOptions::embedding)
      .def_readwrite("delay", &SegmentationOptions::delay)
      .def_readwrite("switch_cost", &SegmentationOptions::switch_cost)
      .def_readwrite("lag", &SegmentationOptions::lag)
      .def_readwrite("slack", &SegmentationOptions::slack)
      .def_readwrite("horizon", &SegmentationOptions::horizon)
      .def_readwrite("prototypes", &SegmentationOptions::prototypes)
      .def_readwrite("sigma", &SegmentationOptions::sigma)
      .def_readwrite("sigma_samples", &SegmentationOptions::sigma_samples)
      .def_readwrite("dt", &SegmentationOptions::dt)
      .def_readwrite("scale", &SegmentationOptions::scale)
      .def_property(
          "distance",
          [](const SegmentationOptions& o) {
            return o.distance == WindowDistance::kNormalized ? "normalized" : "squared";
          },
          [](SegmentationOptions& o, const std::string& name) { o.distance = distanceNamed(name); },
          "'normalized' (default) or 'squared'");

  py::class_<Boundary>(m, "Boundary", "A committed change of regime.")
      .def_readonly("index", &Boundary::index, "first sample of the new segment")
      .def_readonly("time", &Boundary::time, "[s]")
      .def_readonly("ended", &Boundary::ended, "id of the prototype of the segment that ended")
      .def_readonly("margin", &Boundary::margin)
      .def_readonly("delay", &Boundary::delay, "samples until it was committed")
      .def_readonly("forced", &Boundary::forced)
      .def("__repr__", [](const Boundary& b) {
        return "<Boundary index=" + std::to_string(b.index) + " ended=" + std::to_string(b.ended) +
               " margin=" + std::to_string(b.margin) + " delay=" + std::to_string(b.delay) + ">";
      });

  py::class_<OnlineSegmentation>(m, "OnlineSegmentation", "Cuts a series where its recent distribution changes.")
      .def(py::init<const SegmentationOptions&, int>(), py::arg("options"), py::arg("dimension"))
      .def("push", &OnlineSegmentation::push, py::arg("sample"), "A Boundary committed by this sample, or None.")
      .def("finish", &OnlineSegmentation::finish, "The boundaries still open; the index starts again at 0.")
      .def_property_readonly("sigma", &OnlineSegmentation::sigma)
      .def_property_readonly("samples", &OnlineSegmentation::samples)
      .def_property_readonly("open_windows", &OnlineSegmentation::openWindows)
      .def_property_readonly("known_prototypes", &OnlineSegmentation::knownPrototypes)
      .def_property_readonly("memory_bytes", &OnlineSegmentation::memoryBytes);

  m.def("segment_offline", &segmentOffline, py::arg("samples"), py::arg("options"),
        "The exact optimum of a whole series (T, d): a list of Boundary.");
  m.def("neighbour_sigma", &neighbourSigma, py::arg("samples"), py::arg("neighbours"));
}
