// PrimitiveRecogniser, EmergingPartner and what they need.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "phri_learning/emerging_partner.hpp"

namespace py = pybind11;
using namespace phri_learning;

namespace
{
/// The upper nodes' own models, with what is typical of them on their own latest segments.
PrimitiveRecogniser recogniserOf(const PrimitiveLibrary& library, int window, double leak, int confirm, double gate,
                                 double outlier, int least)
{
  RecogniserOptions o;
  o.window = window;
  o.leak = leak;
  o.confirm = confirm;
  o.gate = gate;
  o.outlier = outlier;
  o.least = least;
  checkOptions(o);
  std::vector<RecognisedModel> models;
  for (const auto& [hmm, id] : library.models())
  {
    const std::vector<Eigen::MatrixXd> examples = memberSamples(library, id);
    models.push_back({ hmm, typicalIncrement(*hmm, examples, o.leak) });
  }
  return PrimitiveRecogniser(std::move(models), o);
}

std::string referenceName(Reference reference)
{
  return reference == Reference::kPath ? "path" : "displacement";
}

std::string timeName(TimeEstimate time)
{
  return time == TimeEstimate::kThesis ? "thesis" : time == TimeEstimate::kRegressed ? "regressed" : "entry_corrected";
}

std::string recognitionName(Recognition recognition)
{
  return recognition == Recognition::kAll ? "all" : recognition == Recognition::kMotion ? "motion" : "position";
}
}  // namespace

void bindPartner(py::module_& m)
{
  const RecogniserOptions defaults;
  py::class_<PrimitiveRecogniser::Entry>(m, "Recognition", "One model's view of the samples so far.")
      .def_readonly("log_likelihood", &PrimitiveRecogniser::Entry::log_likelihood, "over the window [nat]")
      .def_readonly("state", &PrimitiveRecogniser::Entry::state, "likeliest now")
      .def_readonly("time", &PrimitiveRecogniser::Entry::time, "expected model time [s]")
      .def_readonly("progress", &PrimitiveRecogniser::Entry::progress, "time / length, 0..1");

  py::class_<PrimitiveRecogniser>(m, "PrimitiveRecogniser",
                                  "Which primitive of a library is being made, in constant time per sample.")
      .def(py::init(&recogniserOf), py::arg("library"), py::arg("window") = defaults.window,
           py::arg("leak") = defaults.leak, py::arg("confirm") = defaults.confirm, py::arg("gate") = defaults.gate,
           py::arg("outlier") = defaults.outlier, py::arg("least") = defaults.least)
      .def("filter", &PrimitiveRecogniser::filter, py::arg("sample"), py::return_value_policy::copy,
           "Takes the next sample (d,): a Recognition for every upper node, in the order of their ids.")
      .def("reset", &PrimitiveRecogniser::reset)
      .def("excess", &PrimitiveRecogniser::excess, py::arg("model"), "See primitive_recogniser.hpp.")
      .def_property_readonly("winner", &PrimitiveRecogniser::winner, "index of the primitive in force, -1: none");

  py::class_<EmergingOptions>(m, "EmergingOptions", "See emerging_options.hpp for units and ranges.")
      .def(py::init<>())
      .def_readwrite("dof", &EmergingOptions::dof)
      .def_readwrite("dt", &EmergingOptions::dt)
      .def_readwrite("horizon", &EmergingOptions::horizon)
      .def_readwrite("window_states", &EmergingOptions::window_states)
      .def_readwrite("spread", &EmergingOptions::spread)
      .def_readwrite("motion_spread", &EmergingOptions::motion_spread)
      .def_property(
          "progress", [](const EmergingOptions& o) { return recognitionName(o.progress); },
          [](EmergingOptions& o, const std::string& name) { o.progress = recognitionNamed(name); },
          "'position' (default), 'motion' or 'all'")
      .def_property(
          "leak", [](const EmergingOptions& o) { return o.recogniser.leak; },
          [](EmergingOptions& o, double leak) { o.recogniser.leak = leak; }, "of recognition")
      .def_readwrite("blend", &EmergingOptions::blend)
      .def_readwrite("shortest", &EmergingOptions::shortest)
      .def_readwrite("longest", &EmergingOptions::longest)
      .def_readwrite("queue", &EmergingOptions::queue)
      .def_readwrite("scale_samples", &EmergingOptions::scale_samples)
      .def_readwrite("segmentation", &EmergingOptions::segmentation)
      .def_property(
          "reference", [](const EmergingOptions& o) { return referenceName(o.reference); },
          [](EmergingOptions& o, const std::string& name) { o.reference = referenceNamed(name); },
          "'path' (default) or 'displacement'")
      .def_property(
          "time", [](const EmergingOptions& o) { return timeName(o.time); },
          [](EmergingOptions& o, const std::string& name) { o.time = timeEstimateNamed(name); },
          "'regressed' (default), 'entry_corrected' or 'thesis'")
      .def_property(
          "recognition", [](const EmergingOptions& o) { return recognitionName(o.recognition); },
          [](EmergingOptions& o, const std::string& name) { o.recognition = recognitionNamed(name); },
          "'motion' (default), 'position' or 'all'")
      .def_property(
          "segmented", [](const EmergingOptions& o) { return recognitionName(o.segmented); },
          [](EmergingOptions& o, const std::string& name) { o.segmented = recognitionNamed(name); },
          "'motion' (default), 'position' or 'all'")
      .def_property(
          "states", [](const EmergingOptions& o) { return o.primitives.training.states; },
          [](EmergingOptions& o, int states) { o.primitives.training.states = states; })
      .def_property(
          "members", [](const EmergingOptions& o) { return o.primitives.members; },
          [](EmergingOptions& o, int members) { o.primitives.members = members; })
      .def_property(
          "cutoff", [](const EmergingOptions& o) { return o.primitives.cutoff; },
          [](EmergingOptions& o, double cutoff) { o.primitives.cutoff = cutoff; })
      .def_property(
          "window", [](const EmergingOptions& o) { return o.recogniser.window; },
          [](EmergingOptions& o, int window) { o.recogniser.window = window; }, "of recognition [samples]")
      .def_property(
          "gate", [](const EmergingOptions& o) { return o.recogniser.gate; },
          [](EmergingOptions& o, double gate) { o.recogniser.gate = gate; }, "of recognition [nat]");

  py::class_<CommittedSegment>(m, "CommittedSegment", "Samples between two boundaries.")
      .def(py::init([](const Eigen::MatrixXd& samples, bool follows) {
             CommittedSegment segment;
             segment.samples = samples;
             segment.follows = follows;
             return segment;
           }),
           py::arg("samples"), py::arg("follows") = true)
      .def_readonly("samples", &CommittedSegment::samples, "(T, 3 dof)")
      .def_readonly("begin", &CommittedSegment::begin, "[s]")
      .def_readonly("follows", &CommittedSegment::follows)
      .def_readonly("margin", &CommittedSegment::margin);

  py::class_<LearnedPrimitives, std::shared_ptr<LearnedPrimitives>>(
      m, "LearnedPrimitives", "What a partner predicts with; immutable, may be handed to another thread.")
      .def_property_readonly("library", [](const LearnedPrimitives& l) { return l.library; })
      .def_property_readonly("nodes",
                             [](const LearnedPrimitives& l) {
                               std::vector<int> nodes;
                               for (const LearnedPrimitive& primitive : l.primitives)
                                 nodes.push_back(primitive.node);
                               return nodes;
                             })
      .def_property_readonly("successors", [](const LearnedPrimitives& l) {
        std::vector<int> nodes;
        for (const LearnedPrimitive& primitive : l.primitives)
          nodes.push_back(primitive.successor);
        return nodes;
      });
  const auto shared = [](const std::shared_ptr<const LearnedPrimitives>& learned) {
    return std::const_pointer_cast<LearnedPrimitives>(learned);  // bound without anything that changes it
  };

  py::class_<PrimitiveLearner>(m, "PrimitiveLearner", "The slow half: segments in, LearnedPrimitives out.")
      .def(py::init<const EmergingOptions&>(), py::arg("options"))
      .def(py::init<const EmergingOptions&, PrimitiveLibrary>(), py::arg("options"), py::arg("library"))
      .def(
          "add",
          [shared](PrimitiveLearner& learner, const CommittedSegment& segment) {
            py::gil_scoped_release release;
            return shared(learner.add(segment));
          },
          py::arg("segment"), "Learns from a segment; what is known then.")
      .def_property_readonly("snapshot",
                             [shared](const PrimitiveLearner& learner) { return shared(learner.snapshot()); })
      .def("to_json", &PrimitiveLearner::save, py::arg("path"), "Writes the library, whole or not at all.")
      .def_static("from_json", &PrimitiveLearner::load, py::arg("options"), py::arg("path"));

  py::class_<EmergingPartner, phri_core::BehaviorModel, std::shared_ptr<EmergingPartner>>(
      m, "EmergingPartner", "Learns primitives from what it observes and predicts with them; see emerging_partner.hpp.")
      .def(py::init<const EmergingOptions&>(), py::arg("options") = EmergingOptions())
      .def("take_segments", &EmergingPartner::takeSegments, "Segments committed since the last call.")
      .def(
          "adopt",
          [](EmergingPartner& partner, std::shared_ptr<LearnedPrimitives> learned) {
            partner.adopt(std::move(learned));
          },
          py::arg("learned"), "Predicts with this from now on.")
      .def(
          "learn", [](EmergingPartner& partner, PrimitiveLearner& learner) { return learn(&partner, &learner); },
          py::arg("learner"), py::call_guard<py::gil_scoped_release>(),
          "Learns from all segments that wait and adopts the result; their number.")
      .def_property_readonly("primitive", &EmergingPartner::primitive, "node recognised now, -1: none")
      .def_property_readonly("primitive_time", &EmergingPartner::primitiveTime, "[s] since its beginning")
      .def_property_readonly("excess",
                             [](const EmergingPartner& partner) {
                               std::vector<double> result;
                               for (std::size_t i = 0; i < partner.recogniser().entries().size(); ++i)
                                 result.push_back(partner.recogniser().excess(static_cast<int>(i)));
                               return result;
                             })
      .def_property_readonly("waiting_segments", &EmergingPartner::waitingSegments)
      .def_property_readonly("lost_segments", &EmergingPartner::lostSegments);
}
