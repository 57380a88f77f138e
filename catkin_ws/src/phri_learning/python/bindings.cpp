// Module `phri_learning`: behaviour models learned from demonstrations.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <memory>
#include <optional>

#include "phri_learning/behavior_models.hpp"
#include "phri_learning/displacement_mixture.hpp"
#include "phri_learning/hmm_chain.hpp"
#include "phri_learning/hmm_training.hpp"
#include "phri_learning/model_file.hpp"
#include "phri_learning/primitive_library.hpp"

namespace py = pybind11;
using namespace phri_learning;

void bindPartner(py::module_& m);
void bindPrimitives(py::module_& m);
void bindSegmentation(py::module_& m);

namespace
{
/// The scikit-learn manners around the value TimeHmm.
struct Estimator
{
  TrainingOptions options;
  std::shared_ptr<const TimeHmm> model;
  std::vector<double> log_likelihood;
  std::vector<int> starved, collapsed;
  int iterations = 0;
  bool converged = false;
  std::uint64_t random_state = 0;

  const TimeHmm& fitted() const
  {
    if (!model)
      throw py::value_error(
          "this TimeHmm is not fitted yet: call fit(demonstrations) or TimeHmm.from_json(path) first");
    return *model;
  }
};

Estimator makeEstimator(int states, int components, double dt, const std::string& mode, int max_iterations,
                        double tolerance, double covariance_floor, double shrinkage, std::uint64_t random_state)
{
  if (mode != "corrected" && mode != "thesis")
    throw std::invalid_argument("mode = '" + mode + "', expected 'corrected' or 'thesis'");
  Estimator e;
  e.options.states = states;
  e.options.components = components;
  e.options.dt = dt;
  e.options.formulas = mode == "thesis" ? Formulas::kThesis : Formulas::kCorrected;
  e.options.max_iterations = max_iterations;
  e.options.tolerance = tolerance;
  e.options.covariance_floor = covariance_floor;
  e.options.shrinkage = shrinkage;
  e.random_state = random_state;
  checkOptions(e.options);
  return e;
}

/// What holds a model that was not fitted here.
Estimator estimatorOf(TimeHmm model)
{
  Estimator e;
  e.options.states = model.states();
  e.options.components = model.components();
  e.options.dt = model.dt();
  e.options.formulas = model.formulas();
  e.options.covariance_floor = model.parameters().covariance_floor;
  e.model = std::make_shared<const TimeHmm>(std::move(model));
  return e;
}

/// (N, d, d) from N matrices, or (S, K, d, d) if `components` > 1.
py::array_t<double> stacked(const std::vector<Eigen::MatrixXd>& matrices, Eigen::Index d, int components = 1)
{
  std::vector<py::ssize_t> shape = { static_cast<py::ssize_t>(matrices.size()) / components, d, d };
  if (components > 1)
    shape.insert(shape.begin() + 1, components);
  py::array_t<double> result(shape);
  double* out = result.mutable_data();
  for (const Eigen::MatrixXd& matrix : matrices)
    for (Eigen::Index i = 0; i < d; ++i)
      for (Eigen::Index j = 0; j < d; ++j)
        *out++ = matrix(i, j);
  return result;
}

phri_core::Gaussian predicted(const Estimator& e, const Eigen::MatrixXd& window, double horizon,
                              const std::string& reference, const std::optional<std::string>& time,
                              const std::optional<std::pair<int, int>>& velocity,
                              const std::optional<std::string>& predictor)
{
  const bool thesis = e.fitted().formulas() == Formulas::kThesis;
  if (window.rows() < 1)
    throw std::invalid_argument("window has 0 samples, expected at least 1");
  ForecastSettings settings = forecastNamed(predictor.value_or(thesis ? "thesis" : "displacement"));
  if (!reference.empty())
    settings.reference = referenceNamed(reference);
  if (time)
    settings.time = timeEstimateNamed(*time);
  if (velocity)
  {
    settings.velocity_first = velocity->first;
    settings.velocity_count = velocity->second - velocity->first;
  }
  TimeTracker tracker(e.model, static_cast<int>(window.rows()));
  for (Eigen::Index t = 0; t < window.rows(); ++t)
    tracker.observe(window.row(t).transpose());
  phri_core::Gaussian result;
  tracker.forecast(horizon, settings, &result);
  return result;
}

/// The scikit-learn manners around a DisplacementRegression and the mixture that runs on it.
struct DisplacementEstimator
{
  DisplacementOptions options;
  std::shared_ptr<const DisplacementRegression> model;
  std::shared_ptr<DisplacementMixture> mixture;

  DisplacementMixture& fitted() const
  {
    if (!mixture)
      throw py::value_error("this DisplacementMixture is not fitted yet: call fit(demonstrations) first");
    return *mixture;
  }
};

/// Forecasts `horizon` [s] ahead from every sample of one movement: (T, d), (T, d, d).
py::tuple followed(const DisplacementEstimator& e, const Eigen::MatrixXd& samples, double horizon)
{
  e.fitted();
  Eigen::MatrixXd means(samples.rows(), e.model->dimension);
  std::vector<Eigen::MatrixXd> covariances;
  {
    py::gil_scoped_release release;
    DisplacementMixture mixture(e.model);
    phri_core::Gaussian forecast;
    for (Eigen::Index t = 0; t < samples.rows(); ++t)
    {
      mixture.observe(samples.row(t).transpose());
      mixture.forecast(horizon, &forecast);
      means.row(t) = forecast.mean;
      covariances.push_back(forecast.covariance);
    }
  }
  return py::make_tuple(means, stacked(covariances, e.model->dimension));
}
}  // namespace

PYBIND11_MODULE(phri_learning, m)
{
  py::module_::import("phri_core");
  m.doc() = "Behaviour models learned from demonstrations: time-based hidden Markov models (section 3.1.1).";

  py::register_exception<ModelFileError>(m, "ModelFileError", PyExc_ValueError);

  py::class_<Estimator>(m, "TimeHmm",
                        "Left-to-right HMM over d-dimensional samples, any d and any unit, whose states know when they "
                        "are visited. mode 'thesis' keeps (3.8) and (3.12) as printed. Training is deterministic; "
                        "random_state seeds sample().")
      .def(py::init(&makeEstimator), py::arg("states"), py::arg("components") = 1, py::arg("dt") = 0.02,
           py::arg("mode") = "corrected", py::arg("max_iterations") = TrainingOptions().max_iterations,
           py::arg("tolerance") = TrainingOptions().tolerance,
           py::arg("covariance_floor") = TrainingOptions().covariance_floor,
           py::arg("shrinkage") = TrainingOptions().shrinkage, py::arg("random_state") = 0)
      .def(
          "fit",
          [](py::object self, const std::vector<Eigen::MatrixXd>& demonstrations) {
            Estimator& e = self.cast<Estimator&>();
            const TrainingOptions options = e.options;
            std::optional<TrainingResult> result;
            {
              py::gil_scoped_release release;
              result = train(demonstrations, options);
            }
            e.model = std::make_shared<const TimeHmm>(std::move(result->model));
            e.log_likelihood = std::move(result->log_likelihood);
            e.starved = std::move(result->starved);
            e.collapsed = std::move(result->collapsed);
            e.iterations = result->iterations;
            e.converged = result->converged;
            return self;
          },
          py::arg("demonstrations"), "Learns from a list of (T_i, d) arrays sampled every dt; returns self.")
      .def(
          "score", [](const Estimator& e, const Eigen::MatrixXd& x) { return e.fitted().score(x); }, py::arg("x"),
          "log P(x | model), spatial part only.")
      .def(
          "viterbi", [](const Estimator& e, const Eigen::MatrixXd& x) { return e.fitted().viterbi(x); }, py::arg("x"),
          "Most likely state of each sample.")
      .def(
          "regress",
          [](const Estimator& e, const Eigen::VectorXd& times, bool full_covariance, bool return_cov) -> py::object {
            const TimeHmm::Trajectory result = e.fitted().regress(times, full_covariance);
            if (!return_cov)
              return py::cast(result.means);
            return py::make_tuple(result.means, stacked(result.covariances, e.model->dimension()));
          },
          py::arg("times"), py::arg("full_covariance") = true, py::arg("return_cov") = true,
          "Means (N, d) and, with return_cov, covariances (N, d, d) at times [s] since the start; "
          "full_covariance=False: (3.6) as printed.")
      .def(
          "predict",
          [](const Estimator& e, const Eigen::MatrixXd& window, double horizon, const std::string& reference,
             const std::optional<std::string>& time, const std::optional<std::pair<int, int>>& velocity,
             const std::optional<std::string>& predictor, bool return_cov) -> py::object {
            const phri_core::Gaussian result = predicted(e, window, horizon, reference, time, velocity, predictor);
            if (!return_cov)
              return py::cast(result.mean);
            return py::make_tuple(result.mean, result.covariance);
          },
          py::arg("window"), py::arg("horizon"), py::arg("reference") = "", py::arg("time") = py::none(),
          py::arg("velocity") = py::none(), py::arg("predictor") = py::none(), py::arg("return_cov") = true,
          "Mean (d,) and, with return_cov, covariance (d, d) of the sample `horizon` [s] after the window (n, d), "
          "which may begin "
          "anywhere.\n"
          "predictor: 'displacement' (default), 'entry_corrected', 'thesis' (default in mode 'thesis'): names for a "
          "reference, 'displacement' or 'path', and a time, 'regressed', 'entry_corrected' or 'thesis', which can also "
          "be given by themselves; velocity: (first, end) columns that are velocities, to adapt the pace.")
      .def(
          "sample",
          [](Estimator& e, int samples) {
            e.fitted();
            phri_core::Random random(e.random_state++);
            return sample(*e.model, samples, &random);
          },
          py::arg("samples"), "A random sequence (samples, d) of the spatial model; another one at every call.")
      .def(
          "concatenate",
          [](const Estimator& e, const Estimator& next) { return estimatorOf(concatenate(e.fitted(), next.fitted())); },
          py::arg("next"), "This movement and then the next, by (3.13), as a model.")
      .def(
          "window",
          [](const Estimator& e, int center, int states) {
            WindowHmm result = windowHmm(e.fitted(), center, states);
            return py::make_tuple(estimatorOf(std::move(result.model)), result.first);
          },
          py::arg("center"), py::arg("states"), "The window HMM around a state, and its first state.")
      .def(
          "distance",
          [](const Estimator& e, const Estimator& other) { return modelDistance(e.fitted(), other.fitted()); },
          py::arg("other"), "Symmetric distance of two models [nat per sample].")
      .def(
          "to_json", [](const Estimator& e, const std::string& path) { saveTimeHmm(e.fitted(), path); },
          py::arg("path"), "Writes the model, whole or not at all.")
      .def_static(
          "from_json", [](const std::string& path) { return estimatorOf(loadTimeHmm(path)); }, py::arg("path"),
          "The model of a file, or ModelFileError.")
      .def_property_readonly("states", [](const Estimator& e) { return e.options.states; })
      .def_property_readonly("components", [](const Estimator& e) { return e.options.components; })
      .def_property_readonly("dt", [](const Estimator& e) { return e.options.dt; })
      .def_property_readonly(
          "mode", [](const Estimator& e) { return e.options.formulas == Formulas::kThesis ? "thesis" : "corrected"; })
      .def_property_readonly("transition_", [](const Estimator& e) { return e.fitted().parameters().transition; })
      .def_property_readonly("initial_", [](const Estimator& e) { return e.fitted().parameters().initial; })
      .def_property_readonly("weights_", [](const Estimator& e) { return e.fitted().parameters().weights; })
      .def_property_readonly(
          "means_", [](const Estimator& e) { return e.fitted().parameters().mean_s; },
          "(S components, d), row state * components + component")
      .def_property_readonly(
          "covariances_", [](const Estimator& e) { return stacked(e.fitted().parameters().ss, e.model->dimension()); },
          "(S components, d, d)")
      .def_property_readonly(
          "time_means_", [](const Estimator& e) { return e.fitted().parameters().mean_t; }, "[s]")
      .def_property_readonly(
          "time_variances_", [](const Estimator& e) { return e.fitted().parameters().tt; }, "[s^2]")
      .def_property_readonly("time_covariances_", [](const Estimator& e) { return e.fitted().parameters().ts; })
      .def_property_readonly(
          "between_time_variances_", [](const Estimator& e) { return e.fitted().parameters().between_tt; }, "[s^2]")
      .def_property_readonly(
          "durations_", [](const Estimator& e) { return e.fitted().durations(); }, "[samples]")
      .def_property_readonly(
          "length_", [](const Estimator& e) { return e.fitted().length(); }, "(3.10) [s]")
      .def_property_readonly(
          "log_likelihood_",
          [](const Estimator& e) {
            e.fitted();
            return e.log_likelihood;
          },
          "What EM maximised, per iteration; empty for a loaded model.")
      .def_property_readonly(
          "starved_", [](const Estimator& e) { return e.starved; }, "States that the data never reached.")
      .def_property_readonly(
          "collapsed_", [](const Estimator& e) { return e.collapsed; }, "States with a covariance at its floor.")
      .def_property_readonly("iterations_", [](const Estimator& e) { return e.iterations; })
      .def_property_readonly("converged_", [](const Estimator& e) { return e.converged; });

  py::class_<TimeHmmModel, phri_core::BehaviorModel, std::shared_ptr<TimeHmmModel>>(
      m, "TimeHmmModel", "A fitted TimeHmm over [x; xdot; u_h] as a behaviour model.")
      .def(py::init([](const Estimator& e, int dof, int window, const std::string& reference, const std::string& time,
                       const std::string& recognition, bool adapt_pace) {
             e.fitted();
             TimeHmmModelSettings settings;
             settings.dof = dof;
             settings.window = window;
             settings.reference = referenceNamed(reference);
             settings.time = timeEstimateNamed(time);
             settings.recognition = recognitionNamed(recognition);
             settings.adapt_pace = adapt_pace;
             return std::make_shared<TimeHmmModel>(e.model, settings);
           }),
           py::arg("model"), py::arg("dof") = 2, py::arg("window") = 30, py::arg("reference") = "path",
           py::arg("time") = "entry_corrected", py::arg("recognition") = "position", py::arg("adapt_pace") = false)
      .def_property_readonly("state", [](const TimeHmmModel& model) { return model.tracker().state(); });

  py::class_<DisplacementEstimator>(
      m, "DisplacementMixture",
      "The default predictor: displacement regressed on place and motion in the states of a time-HMM, mixed with a "
      "velocity model by recent error. Samples (d,): `axes` positions first, then companions (velocity, wrench).")
      .def(py::init([](int axes, double dt, double horizon, int states) {
             DisplacementEstimator e;
             e.options.axes = axes;
             e.options.dt = dt;
             e.options.horizon = horizon;
             e.options.states = states;
             return e;
           }),
           py::arg("axes") = DisplacementOptions().axes, py::arg("dt") = DisplacementOptions().dt,
           py::arg("horizon") = DisplacementOptions().horizon, py::arg("states") = DisplacementOptions().states)
      .def(
          "fit",
          [](py::object self, const std::vector<Eigen::MatrixXd>& demonstrations) {
            DisplacementEstimator& e = self.cast<DisplacementEstimator&>();
            const DisplacementOptions options = e.options;
            std::shared_ptr<const DisplacementRegression> model;
            {
              py::gil_scoped_release release;
              model = std::make_shared<const DisplacementRegression>(trainDisplacements(demonstrations, options));
            }
            e.model = model;
            e.mixture = std::make_shared<DisplacementMixture>(model);
            return self;
          },
          py::arg("demonstrations"), "Learns from a list of (T_i, d) arrays sampled every dt; returns self.")
      .def(
          "reset", [](const DisplacementEstimator& e) { e.fitted().reset(); }, "Forgets the movement followed so far.")
      .def(
          "observe", [](const DisplacementEstimator& e, const Eigen::VectorXd& y) { e.fitted().observe(y); },
          py::arg("sample"), "The next sample (d,), dt after the last one.")
      .def(
          "forecast",
          [](const DisplacementEstimator& e, double horizon) {
            phri_core::Gaussian result;
            e.fitted().forecast(horizon, &result);
            return py::make_tuple(result.mean, result.covariance);
          },
          py::arg("horizon"), "Mean (d,) and covariance (d, d) of the sample `horizon` [s] from now.")
      .def(
          "follow", &followed, py::arg("samples"), py::arg("horizon"),
          "Means (T, d) and covariances (T, d, d) of the samples `horizon` [s] after each sample of a movement (T, d); "
          "leaves the movement followed by observe() alone.")
      .def(
          "weights",
          [](const DisplacementEstimator& e, double horizon) {
            if (!e.fitted().started())
              throw std::invalid_argument("weights: no sample observed yet, expected at least 1");
            return e.fitted().weights(horizon);
          },
          py::arg("horizon"), "Weights of velocity model and local model at `horizon` [s].")
      .def_property_readonly(
          "length_", [](const DisplacementEstimator& e) { return e.fitted().model().recogniser->length(); },
          "(3.10) [s]")
      .def_property_readonly("states_", [](const DisplacementEstimator& e) { return e.fitted().model().states(); });

  py::class_<DisplacementModel, phri_core::BehaviorModel, std::shared_ptr<DisplacementModel>>(
      m, "DisplacementModel", "A fitted DisplacementMixture over [x; xdot; u_h] as a behaviour model.")
      .def(py::init([](const DisplacementEstimator& e) {
             e.fitted();
             return std::make_shared<DisplacementModel>(e.model);
           }),
           py::arg("model"));

  m.def("demonstration", &demonstration, py::arg("observations"), py::arg("dof") = 2,
        "A list of observations as training data (T, 3 dof).");

  bindPrimitives(m);
  bindSegmentation(m);
  bindPartner(m);
}
