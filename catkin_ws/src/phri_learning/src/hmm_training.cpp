#include "phri_learning/hmm_training.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

#include "phri_core/check.hpp"
#include "phri_learning/hmm_expectation.hpp"
#include "phri_learning/time_tracker.hpp"

namespace phri_learning
{
namespace
{
constexpr double kStarvedOccupancy = 0.5;  // a state that is passed at all holds at least one sample
constexpr double kEmpty = 1e-12;           // [samples] of responsibility that count as none
constexpr double kRepeatVariance = 0.01;   // before any repetition: it deviates by 10 % of the data's scale
constexpr int kWarmUp = 5;                 // iterations in which the pooled covariance still follows

using Demonstrations = std::vector<Eigen::MatrixXd>;

double priorStrength(const Expectation& sums, double shrinkage)
{
  return shrinkage * sums.n.sum() / static_cast<double>(sums.n.size());
}

Eigen::MatrixXd meanCovariance(const std::vector<Eigen::MatrixXd>& covariances)
{
  Eigen::MatrixXd sum = covariances.front();
  for (std::size_t c = 1; c < covariances.size(); ++c)
    sum += covariances[c];
  return sum / static_cast<double>(covariances.size());
}

/// Log of the inverse-Wishart-like prior that `maximize` assumes, up to a constant.
double logPrior(const TimeHmmParameters& p, const Eigen::MatrixXd& pooled, double strength)
{
  double sum = 0.0;
  for (std::size_t c = 0; strength > 0.0 && c < p.ss.size(); ++c)
  {
    const Eigen::LLT<Eigen::MatrixXd> cholesky(p.ss[c]);
    const Eigen::MatrixXd factor = cholesky.matrixL();
    sum -= 0.5 * strength * (2.0 * factor.diagonal().array().log().sum() + cholesky.solve(pooled).trace());
  }
  return sum;
}

/// Time statistics (3.2)-(3.3), and the final covariances: what the time explains within a state stays untouched, only
/// the rest is drawn towards its mean over the states. The joint covariance of time and space is then positive
/// definite. Returns the states in which that rest had to be raised to the floor.
std::vector<int> timeStatistics(const Expectation& sums, double strength, TimeHmmParameters* p)
{
  std::vector<int> collapsed;
  const std::size_t count = p->ss.size();
  const Eigen::Index d = p->scale.size();
  std::vector<Eigen::MatrixXd> rest(count, Eigen::MatrixXd::Zero(d, d));
  Eigen::MatrixXd pooled = Eigen::MatrixXd::Zero(d, d);
  for (std::size_t index = 0; index < count; ++index)
  {
    const Eigen::Index c = static_cast<Eigen::Index>(index);
    const double n = sums.n(c);
    if (!(n > kEmpty))
      continue;
    p->mean_t(c) = sums.t(c) / n;
    p->tt(c) = std::max(sums.within_tt(c) / n, p->dt * p->dt / 12.0);  // a sample stands for one sampling time
    p->ts.row(c) = sums.within_tx.row(c) / n;
    p->between_tt(c) = std::max(0.0, sums.demo_tt(c) / n - p->mean_t(c) * p->mean_t(c));
    rest[index] = sums.xx[index] / n - p->mean_s.row(c).transpose() * p->mean_s.row(c) -
                  p->ts.row(c).transpose() * p->ts.row(c) / p->tt(c);
    pooled += n / sums.n.sum() * rest[index];
  }
  for (std::size_t index = 0; index < count; ++index)
  {
    const Eigen::Index c = static_cast<Eigen::Index>(index);
    const double n = sums.n(c);
    if (!(n > kEmpty))
      continue;
    bool raised = false;
    p->ss[index] = p->ts.row(c).transpose() * p->ts.row(c) / p->tt(c) +
                   withEigenvalueFloor((n * rest[index] + strength * pooled) / (n + strength), p->scale,
                                       p->covariance_floor, &raised);
    const int state = static_cast<int>(c / p->weights.cols());
    if (raised && (collapsed.empty() || collapsed.back() != state))
      collapsed.push_back(state);
  }
  return collapsed;
}

/// Equal time slices of every demonstration; K components are spread along the slice's main axis.
TimeHmmParameters equalSlices(const Demonstrations& demonstrations, const TrainingOptions& options)
{
  const Eigen::Index states = options.states, components = options.components, count = states * components;
  const Eigen::Index d = demonstrations.front().cols();
  TimeHmmParameters p;
  p.dt = options.dt;
  p.covariance_floor = options.covariance_floor;
  p.scale = Eigen::VectorXd::Ones(d);
  p.memory = Eigen::VectorXd::Constant(d, options.dt);
  p.initial = Eigen::VectorXd::Unit(states, 0);
  p.weights = Eigen::MatrixXd::Constant(states, components, 1.0 / static_cast<double>(components));
  p.transition = Eigen::MatrixXd::Zero(states, states);
  p.mean_s.resize(count, d);
  p.ts = Eigen::MatrixXd::Zero(count, d);
  p.mean_t.resize(count);
  p.tt.resize(count);
  p.between_tt = Eigen::VectorXd::Zero(count);
  double mean_samples = 0.0;
  for (const Eigen::MatrixXd& x : demonstrations)
    mean_samples += static_cast<double>(x.rows()) / static_cast<double>(demonstrations.size());
  const double duration = std::max(1.0, mean_samples / static_cast<double>(states));
  for (Eigen::Index i = 0; i < states; ++i)
  {
    double n = 0.0;
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(d);
    Eigen::MatrixXd second = Eigen::MatrixXd::Zero(d, d);
    for (const Eigen::MatrixXd& x : demonstrations)
    {
      const Eigen::Index first = i * x.rows() / states;  // shorter than S: neighbouring slices share a sample
      const Eigen::Index last = std::max((i + 1) * x.rows() / states, first + 1);
      for (Eigen::Index t = first; t < last; ++t)
      {
        n += 1.0;
        mean += x.row(t);
        second += x.row(t).transpose() * x.row(t);
      }
    }
    mean /= n;
    const Eigen::MatrixXd covariance =
        withEigenvalueFloor(second / n - mean * mean.transpose(), p.scale, p.covariance_floor);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(covariance);
    Eigen::VectorXd axis = eigen.eigenvectors().col(d - 1) * std::sqrt(eigen.eigenvalues()(d - 1));
    Eigen::Index largest = 0;
    axis.cwiseAbs().maxCoeff(&largest);
    axis *= axis(largest) < 0.0 ? -1.0 : 1.0;  // the sign of an eigenvector is arbitrary
    for (Eigen::Index k = 0; k < components; ++k)
    {
      const Eigen::Index c = i * components + k;
      const double offset = (2.0 * static_cast<double>(k) + 1.0) / static_cast<double>(components) - 1.0;
      p.mean_s.row(c) = mean + offset * axis;
      p.ss.push_back(covariance);
      p.mean_t(c) = ((static_cast<double>(i) + 0.5) * duration - 0.5) * p.dt;
      p.tt(c) = std::max(duration * duration - 1.0, 1.0) / 12.0 * p.dt * p.dt;
    }
    p.transition(i, i) = i + 1 < states ? 1.0 - std::min(1.0 / duration, 0.5) : 1.0;
    if (i + 1 < states)
      p.transition(i, i + 1) = 1.0 - p.transition(i, i);
  }
  return p;
}

std::vector<int> replaceStarved(const Expectation& sums, const TimeHmmParameters& prior, TimeHmmParameters* p)
{
  std::vector<int> starved;
  const Eigen::Index components = p->weights.cols();
  for (Eigen::Index i = 0; i < p->transition.rows(); ++i)
  {
    if (sums.n.segment(i * components, components).sum() >= kStarvedOccupancy)
      continue;
    starved.push_back(static_cast<int>(i));
    p->transition.row(i) = prior.transition.row(i);
    p->weights.row(i) = prior.weights.row(i);
    double shift = 0.0;  // in time: not before the end of the state before it
    if (i > 0)
    {
      p->transition.row(i - 1) = prior.transition.row(i - 1);
      const double before = p->mean_t(i * components - 1) + 0.5 * std::sqrt(12.0 * p->tt(i * components - 1));
      shift = std::max(0.0, before + 0.5 * std::sqrt(12.0 * prior.tt(i * components)) - prior.mean_t(i * components));
    }
    for (Eigen::Index c = i * components; c < (i + 1) * components; ++c)
    {
      p->mean_s.row(c) = prior.mean_s.row(c);
      p->ss[static_cast<std::size_t>(c)] = prior.ss[static_cast<std::size_t>(c)];
      p->mean_t(c) = prior.mean_t(c) + shift;
      p->tt(c) = prior.tt(c);
      p->ts.row(c) = prior.ts.row(c);
      p->between_tt(c) = prior.between_tt(c);
    }
  }
  return starved;
}

/// How far the model can be trusted at run time, from tracking its own demonstrations: the spread of the pace at which
/// model time passes, and for how long a deviation from the model lasts.
void calibrate(const Demonstrations& demonstrations, TimeHmmParameters* p)
{
  constexpr Eigen::Index kLag = 10;       // samples over which progress and deviations are compared
  constexpr double kPaceVariance = 0.04;  // before any data: paces differ by 20 %; counts as one demonstration
  const auto model = std::make_shared<const TimeHmm>(*p);
  TimeTracker tracker(model);
  TimeHmm::Scratch scratch = model->scratch();
  const Eigen::Index d = p->scale.size();
  Eigen::VectorXd product = Eigen::VectorXd::Zero(d), square = product;
  double paces = kPaceVariance, weight = 1.0;
  for (const Eigen::MatrixXd& x : demonstrations)
  {
    const Eigen::Index samples = x.rows();
    Eigen::VectorXd time(samples);
    Eigen::MatrixXd deviation(samples, d);
    tracker.reset();
    for (Eigen::Index t = 0; t < samples; ++t)
    {
      tracker.observe(x.row(t).transpose());
      time(t) = tracker.time(TimeEstimate::kRegressed);
      model->regressMean(time(t), &scratch);
      deviation.row(t) = x.row(t) - scratch.mean.transpose();
    }
    double sum = 0.0;
    for (Eigen::Index t = 0; t + kLag < samples; ++t)
    {
      const double pace = (time(t + kLag) - time(t)) / (static_cast<double>(kLag) * p->dt);
      sum += std::min((pace - 1.0) * (pace - 1.0), 1.0);  // a jump of the tracked state is no pace
      product += deviation.row(t).cwiseProduct(deviation.row(t + kLag)).transpose();
      square +=
          0.5 * (deviation.row(t).array().square() + deviation.row(t + kLag).array().square()).matrix().transpose();
    }
    if (samples > kLag)
    {
      paces += sum / static_cast<double>(samples - kLag);
      weight += 1.0;
    }
  }
  p->pace_variance = paces / weight;
  for (Eigen::Index j = 0; j < d; ++j)
  {
    const double kept = square(j) > 0.0 ? product(j) / square(j) : 0.5;
    p->memory(j) = -static_cast<double>(kLag) * p->dt / std::log(std::min(std::max(kept, 0.01), 0.99));
  }
}

void checkDemonstrations(const Demonstrations& demonstrations)
{
  if (demonstrations.empty())
    throw std::invalid_argument("demonstrations: 0 given, expected at least 1");
  for (std::size_t e = 0; e < demonstrations.size(); ++e)
  {
    const std::string name = "demonstration " + std::to_string(e);
    const Eigen::MatrixXd& x = demonstrations[e];
    if (x.rows() < 1 || x.cols() < 1 || x.cols() != demonstrations.front().cols())
      throw std::invalid_argument(name + " has the shape (" + std::to_string(x.rows()) + ", " +
                                  std::to_string(x.cols()) + "), expected (at least 1, " +
                                  std::to_string(std::max<Eigen::Index>(1, demonstrations.front().cols())) + ")");
    phri_core::requireFinite(name, x);
  }
}
}  // namespace

void checkOptions(const TrainingOptions& options)
{
  phri_core::requireRange("states", options.states, 1, 1e4, "");
  phri_core::requireRange("components", options.components, 1, 100, "");
  phri_core::requireRange("dt", options.dt, 1e-9, 1e9, "s");
  phri_core::requireRange("max_iterations", options.max_iterations, 1, 1e6, "");
  phri_core::requireRange("shrinkage", options.shrinkage, 0.0, 1e3, "");
  phri_core::requireRange("tolerance", options.tolerance, 0.0, 1e6, "");
  phri_core::requireRange("covariance_floor", options.covariance_floor, 1e-12, 1.0, "");
}

TrainingResult train(const std::vector<Eigen::MatrixXd>& demonstrations, const TrainingOptions& options)
{
  checkOptions(options);
  checkDemonstrations(demonstrations);
  const Eigen::Index d = demonstrations.front().cols();

  double samples = 0.0;
  Eigen::VectorXd center = Eigen::VectorXd::Zero(d), scale = center, size = center;
  for (const Eigen::MatrixXd& x : demonstrations)
  {
    samples += static_cast<double>(x.rows());
    center += x.colwise().sum();
    size = size.cwiseMax(x.cwiseAbs().colwise().maxCoeff().transpose());
  }
  center /= samples;
  for (const Eigen::MatrixXd& x : demonstrations)
    scale += (x.rowwise() - center.transpose()).array().square().colwise().sum().matrix();
  for (Eigen::Index j = 0; j < d; ++j)
  {
    scale(j) = std::sqrt(scale(j) / samples);
    if (!(scale(j) > 1e-9 * size(j)))  // constant but for rounding
      scale(j) = size(j) > 0.0 ? size(j) : 1.0;
  }
  Demonstrations standard;
  for (const Eigen::MatrixXd& x : demonstrations)
    standard.push_back((x.rowwise() - center.transpose()).array().rowwise() / scale.transpose().array());
  const double unit = -samples * scale.array().log().sum();  // log-likelihood per unit of the data

  const TimeHmmParameters prior = equalSlices(standard, options);
  TimeHmmParameters p = prior;
  Expectation sums = expectation(TimeHmm(p), standard), used = sums;
  const double strength = priorStrength(sums, options.shrinkage);
  Eigen::MatrixXd pooled = meanCovariance(p.ss);
  const int warm_up = strength > 0.0 ? std::min(kWarmUp, options.max_iterations / 2) : 0;
  std::vector<double> trace;
  int iterations = 0;
  bool converged = false;
  while (true)
  {
    if (iterations < warm_up)
      pooled = meanCovariance(p.ss);  // a changing prior is another objective: the trace starts when it stands
    else
      trace.push_back(sums.log_likelihood + logPrior(p, pooled, strength) + unit);
    converged = trace.size() > 1 && trace.back() - trace[trace.size() - 2] < options.tolerance * samples;
    if (converged || iterations >= options.max_iterations)
      break;
    maximize(sums, pooled, strength, &p);
    used = std::move(sums);
    sums = expectation(TimeHmm(p), standard);
    ++iterations;
  }
  const std::vector<int> collapsed = timeStatistics(used, strength, &p);
  p.repeat_variance = kRepeatVariance / static_cast<double>(standard.size());
  std::vector<int> starved = replaceStarved(used, prior, &p);
  calibrate(standard, &p);

  for (Eigen::Index c = 0; c < p.mean_t.size(); ++c)
  {
    p.mean_s.row(c) = p.mean_s.row(c).cwiseProduct(scale.transpose()) + center.transpose();
    p.ts.row(c) = p.ts.row(c).cwiseProduct(scale.transpose());
    p.ss[static_cast<std::size_t>(c)] = p.ss[static_cast<std::size_t>(c)].cwiseProduct(scale * scale.transpose());
  }
  p.scale = scale;
  return { TimeHmm(p, options.formulas), trace, iterations, converged, starved, collapsed };
}
}  // namespace phri_learning
