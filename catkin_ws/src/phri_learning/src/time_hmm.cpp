#include "phri_learning/time_hmm.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "phri_core/check.hpp"

namespace phri_learning
{
namespace
{
constexpr double kLogTwoPi = 1.8378770664093454836;

void requireProbabilities(const std::string& name, const Eigen::MatrixXd& rows)
{
  constexpr double kTolerance = 1e-9;  // rounding of sums of up to some hundred probabilities
  for (Eigen::Index i = 0; i < rows.rows(); ++i)
  {
    if (!(rows.row(i).minCoeff() >= 0.0))
      throw std::invalid_argument(name + " row " + std::to_string(i) + ": " + std::to_string(rows.row(i).minCoeff()) +
                                  " is not a probability (0..1)");
    if (!(std::abs(rows.row(i).sum() - 1.0) <= kTolerance))
      throw std::invalid_argument(name + " row " + std::to_string(i) + " sums to " + std::to_string(rows.row(i).sum()) +
                                  ", expected 1");
  }
}

}  // namespace

Eigen::MatrixXd withEigenvalueFloor(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& scale, double floor,
                                    bool* raised)
{
  const Eigen::MatrixXd units = scale * scale.transpose(), unitless = covariance.cwiseQuotient(units);
  const Eigen::Index d = scale.size();
  // positive definite above the floor: cheaper to see than eigenvalues
  const bool fine =
      Eigen::LLT<Eigen::MatrixXd>(unitless - floor * Eigen::MatrixXd::Identity(d, d)).info() == Eigen::Success;
  if (raised)
    *raised = !fine;
  if (fine)
    return 0.5 * (covariance + covariance.transpose());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(unitless);
  const Eigen::VectorXd values = eigen.eigenvalues().cwiseMax(floor);
  const Eigen::MatrixXd clipped = eigen.eigenvectors() * values.asDiagonal() * eigen.eigenvectors().transpose();
  return (0.5 * (clipped + clipped.transpose())).cwiseProduct(units);
}

TimeHmm::TimeHmm(TimeHmmParameters parameters, Formulas formulas)
  : parameters_(std::move(parameters)), formulas_(formulas)
{
  states_ = static_cast<int>(parameters_.transition.rows());
  components_ = static_cast<int>(parameters_.weights.cols());
  dimension_ = static_cast<int>(parameters_.mean_s.cols());
  validate();
  precompute();
}

void TimeHmm::validate() const
{
  const TimeHmmParameters& p = parameters_;
  const Eigen::Index states = states_, count = static_cast<Eigen::Index>(states_) * components_, d = dimension_;
  phri_core::requireRange("dt", p.dt, 1e-9, 1e9, "s");
  phri_core::requireRange("states", states_, 1, 1e5, "");
  phri_core::requireRange("components", components_, 1, 1e3, "");
  phri_core::requireRange("dimension", dimension_, 1, 1e3, "");
  phri_core::requireRange("covariance_floor", p.covariance_floor, 1e-12, 1.0, "");
  phri_core::requireRange("repeat_variance", p.repeat_variance, 0.0, 1e6, "");
  phri_core::requireRange("pace_variance", p.pace_variance, 0.0, 1e6, "");
  const auto check = [](const std::string& name, const Eigen::MatrixXd& value, Eigen::Index rows, Eigen::Index cols) {
    phri_core::requireShape(name, value, rows, cols);
    phri_core::requireFinite(name, value);
  };
  check("transition", p.transition, states, states);
  check("initial", p.initial, states, 1);
  check("weights", p.weights, states, components_);
  check("mean_s", p.mean_s, count, d);
  check("mean_t", p.mean_t, count, 1);
  check("tt", p.tt, count, 1);
  check("ts", p.ts, count, d);
  check("between_tt", p.between_tt, count, 1);
  check("scale", p.scale, d, 1);
  check("memory", p.memory, d, 1);
  requireProbabilities("transition", p.transition);
  requireProbabilities("initial", p.initial.transpose());
  requireProbabilities("weights", p.weights);
  for (Eigen::Index i = 0; i < states; ++i)
    for (Eigen::Index j = 0; j < states; ++j)
      if (j != i && j != i + 1 && p.transition(i, j) != 0.0)
        throw std::invalid_argument("transition from state " + std::to_string(i) + " to " + std::to_string(j) + " is " +
                                    std::to_string(p.transition(i, j)) + ", expected 0 (left-to-right)");
  for (Eigen::Index j = 0; j < d; ++j)
  {
    phri_core::requireRange("scale of dimension " + std::to_string(j), p.scale(j), std::numeric_limits<double>::min(),
                            1e150, "");
    phri_core::requireRange("memory of dimension " + std::to_string(j), p.memory(j), 1e-9, 1e12, "s");
  }
  if (static_cast<Eigen::Index>(p.ss.size()) != count)
    throw std::invalid_argument("ss holds " + std::to_string(p.ss.size()) + " covariances, expected " +
                                std::to_string(count));
  const Eigen::MatrixXd units = p.scale * p.scale.transpose();
  for (Eigen::Index c = 0; c < count; ++c)
  {
    const std::string at = " of state " + std::to_string(c / components_);
    check("ss" + at, p.ss[c], d, d);
    const Eigen::MatrixXd unitless = p.ss[c].cwiseQuotient(units);
    if (!((unitless - unitless.transpose()).cwiseAbs().maxCoeff() <= 1e-9 * unitless.cwiseAbs().maxCoeff()))
      throw std::invalid_argument("ss" + at + " is not symmetric");
    if (Eigen::LLT<Eigen::MatrixXd>(unitless).info() != Eigen::Success)
      throw std::invalid_argument(
          "ss" + at + " has the smallest eigenvalue " +
          std::to_string(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(unitless).eigenvalues().minCoeff()) +
          " (in units of scale), expected > 0");
    phri_core::requireRange("tt" + at, p.tt(c), 1e-6 * p.dt * p.dt, 1e300, "s^2");
    phri_core::requireRange("between_tt" + at, p.between_tt(c), 0.0, 1e300, "s^2");
    const double explained = p.ts.row(c) * p.ss[c].llt().solve(p.ts.row(c).transpose());
    if (!(explained <= p.tt(c) * (1.0 + 1e-6)))
      throw std::invalid_argument("ts" + at + " explains " + std::to_string(explained) + " s^2 of a time variance of " +
                                  std::to_string(p.tt(c)) + " s^2: the joint covariance is not positive semi-definite");
  }
}

void TimeHmm::precompute()
{
  const TimeHmmParameters& p = parameters_;
  const Eigen::Index count = static_cast<Eigen::Index>(states_) * components_, d = dimension_;
  const double least_time_variance = p.dt * p.dt / 12.0;

  log_stay_ = p.transition.diagonal().array().log();
  log_next_.resize(states_ - 1);
  for (int i = 0; i + 1 < states_; ++i)
    log_next_(i) = std::log(p.transition(i, i + 1));

  center_ = p.mean_s.colwise().mean();
  mean_columns_ = p.mean_s.transpose();
  whitening_.setZero(kLanes * (d * (d + 3) / 2), (count + kLanes - 1) / kLanes);
  log_norm_.resize(count);
  log_time_norm_.resize(count);
  slope_.resize(d, count);
  time_slope_.resize(d, count);
  time_residual_.resize(count);
  conditional_.resize(d * d, count);
  for (Eigen::Index c = 0; c < count; ++c)
  {
    const Eigen::LLT<Eigen::MatrixXd> cholesky(p.ss[c]);
    const Eigen::MatrixXd factor = cholesky.matrixL();
    const Eigen::MatrixXd whitening = factor.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd::Identity(d, d));
    const Eigen::VectorXd whitened_mean = whitening * (mean_columns_.col(c) - center_);
    double* lane = whitening_.col(c / kLanes).data() + c % kLanes;
    for (Eigen::Index i = 0; i < d; ++i)
      for (Eigen::Index j = -1; j <= i; ++j, lane += kLanes)
        *lane = j < 0 ? -whitened_mean(i) : whitening(i, j);
    const double log_weight = std::log(p.weights(c / components_, c % components_));
    log_norm_(c) = log_weight - 0.5 * static_cast<double>(d) * kLogTwoPi - factor.diagonal().array().log().sum();
    log_time_norm_(c) = log_weight - 0.5 * std::log(p.tt(c));
    slope_.col(c) = p.ts.row(c).transpose() / p.tt(c);
    time_slope_.col(c) = cholesky.solve(p.ts.row(c).transpose());
    time_residual_(c) = std::max(p.tt(c) - p.ts.row(c).dot(time_slope_.col(c)), least_time_variance);
    const Eigen::MatrixXd conditional = p.ss[c] - p.ts.row(c).transpose() * p.ts.row(c) / p.tt(c);
    conditional_.col(c) = withEigenvalueFloor(conditional, p.scale, p.covariance_floor).reshaped();
  }

  state_time_.resize(states_);
  durations_.resize(states_);
  for (int i = 0; i < states_; ++i)
  {
    const Eigen::VectorXd w = p.weights.row(i), times = p.mean_t.segment(i * components_, components_);
    state_time_(i) = w.dot(times);
    // of the mixture: with one component the printed sum w_ik S_tt,ik
    double variance = w.dot(p.tt.segment(i * components_, components_));
    if (formulas_ == Formulas::kCorrected)
      variance += w.dot((times.array() - state_time_(i)).square().matrix());
    const double v = variance / (p.dt * p.dt);
    const double duration =
        formulas_ == Formulas::kCorrected ? std::sqrt(1.0 + 12.0 * v) : (-3.0 + std::sqrt(1.0 + 48.0 * v)) / 4.0;
    durations_(i) = std::max(1.0, duration);
  }
  length_ = state_time_(states_ - 1) + 0.5 * p.dt * durations_(states_ - 1);
}

TimeHmm TimeHmm::leading(int dimensions) const
{
  phri_core::requireRange("dimensions", dimensions, 1, dimension_, "");
  TimeHmmParameters p = parameters_;
  p.mean_s.conservativeResize(Eigen::NoChange, dimensions);
  p.ts.conservativeResize(Eigen::NoChange, dimensions);
  p.scale.conservativeResize(dimensions);
  p.memory.conservativeResize(dimensions);
  for (Eigen::MatrixXd& covariance : p.ss)
    covariance.conservativeResize(dimensions, dimensions);
  return TimeHmm(std::move(p), formulas_);
}

TimeHmm::Scratch TimeHmm::scratch() const
{
  const Eigen::Index count = static_cast<Eigen::Index>(states_) * components_;
  Scratch s;
  s.component.resize(count);
  s.weight.resize(count);
  s.mean.resize(dimension_);
  s.other.resize(dimension_);
  s.covariance.resize(dimension_, dimension_);
  return s;
}

}  // namespace phri_learning
