#include "phri_control/delay_estimation.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>

#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
using Eigen::Index;
using Eigen::Vector2d;
using Eigen::VectorXd;

constexpr Index kFewestSamples = 100;
constexpr double kStill = 1e-12;         // variance of a signal that does not move, relative to its square
constexpr double kAmbiguous = 0.95;      // a second peak of the correlation as high as this share of the first
constexpr double kLagSignificant = 4.0;  // lag over its deviation, beyond which the recording tells it from delay
constexpr int kIterations = 60;
constexpr double kGain = 1e-12;      // least relative decrease of the squared residuals worth another iteration
constexpr double kConverged = 1e-6;  // change of delay and lag, of a sample

[[noreturn]] void fail(const std::string& text)
{
  throw std::invalid_argument("delay estimation: " + text);
}

template <typename... Parts>
std::string text(const Parts&... parts)
{
  std::ostringstream out;
  (out << ... << parts);
  return out.str();
}

/// Pearson's correlation of command(t) with response(t + shift), over the samples that both have.
double correlationAt(const VectorXd& command, const VectorXd& response, Index shift)
{
  const Index count = command.size() - std::abs(shift);
  const auto a = command.segment(std::max<Index>(0, -shift), count).array();
  const auto b = response.segment(std::max<Index>(0, shift), count).array();
  const double mean_a = a.mean(), mean_b = b.mean();
  const double norm = std::sqrt((a - mean_a).square().sum() * (b - mean_b).square().sum());
  return norm > 0.0 ? ((a - mean_a) * (b - mean_b)).sum() / norm : 0.0;
}

/// Shift [samples] of the best correlation among 0 .. most; throws what makes it meaningless.
Index bestShift(const VectorXd& command, const VectorXd& response, Index most, double dt, const DelayOptions& options,
                double& best)
{
  VectorXd correlation(2 * most + 1);
  for (Index i = 0; i < correlation.size(); ++i)
    correlation(i) = correlationAt(command, response, i - most);
  Index peak = 0, trough = 0;
  best = correlation.maxCoeff(&peak);
  const double worst = correlation.minCoeff(&trough);
  if (best < options.least_correlation && -worst > best && -worst >= options.least_correlation)
    fail(text("the response has the opposite sign of the command: correlation ", worst, " at ",
              1e3 * dt * static_cast<double>(trough - most), " ms; negate one of them"));
  if (best < options.least_correlation)
    fail(text("correlation of command and response is at most ", best, ", expected at least ",
              options.least_correlation,
              ": they are not related, or the delay is beyond max_delay = ", options.max_delay, " s"));
  if (peak == correlation.size() - 1)
    fail(text("the best delay is at the end of the range, ", 1e3 * options.max_delay, " ms: give a larger max_delay"));
  for (Index i = 1; i + 1 < correlation.size(); ++i)
    if (std::abs(i - peak) > 1 && correlation(i) >= correlation(i - 1) && correlation(i) >= correlation(i + 1) &&
        correlation(i) > kAmbiguous * best &&
        correlation.segment(std::min(i, peak), std::abs(i - peak) + 1).minCoeff() < 0.5 * best)
      fail(text("the command is periodic: delays of ", 1e3 * dt * static_cast<double>(peak - most), " ms and ",
                1e3 * dt * static_cast<double>(i - most), " ms fit alike (correlation ", best, " and ", correlation(i),
                "); excite with a chirp or noise, or give a smaller max_delay"));
  if (peak < most - 1)
    fail(text("the response leads the command by ", 1e3 * dt * static_cast<double>(most - peak),
              " ms, expected it to follow: columns swapped, or two clocks"));
  return std::max<Index>(0, peak - most);
}

/// Output of the first-order lag, exact for an input that is linear between samples. Starts at the first sample.
VectorXd lagged(const VectorXd& input, double lag)  // lag in samples
{
  if (lag < 1e-6)
    return input;
  const double decay = std::exp(-1.0 / lag), share = -std::expm1(-1.0 / lag);
  VectorXd output(input.size());
  output(0) = input(0);
  for (Index k = 1; k < input.size(); ++k)
  {
    const double slope = input(k) - input(k - 1);
    output(k) = decay * output(k - 1) + share * input(k - 1) + (1.0 - lag * share) * slope;
  }
  return output;
}

/// A signal `shift` samples later, by the cubic through the four samples around.
double shifted(const VectorXd& signal, Index k, double shift)
{
  const double at = static_cast<double>(k) - shift, whole = std::floor(at), f = at - whole;
  const Index i = static_cast<Index>(whole);
  const double a = signal(i - 1), b = signal(i), c = signal(i + 1), d = signal(i + 2);
  return -f * (f - 1.0) * (f - 2.0) / 6.0 * a + (f + 1.0) * (f - 1.0) * (f - 2.0) / 2.0 * b -
         (f + 1.0) * f * (f - 2.0) / 2.0 * c + (f + 1.0) * f * (f - 1.0) / 6.0 * d;
}

struct Fit
{
  VectorXd residual, model;  // model without gain and offset
  double gain = 0.0, offset = 0.0, cost = 0.0;
};

class Model
{
public:
  Model(const VectorXd& command, const VectorXd& response, Index margin)
    : command_(command), margin_(margin), measured_(response.segment(margin, response.size() - margin - 2))
  {
  }

  /// Best gain and offset for a delay and a lag [samples]; the first samples, which depend on what was before, are out.
  Fit fit(double delay, double lag) const
  {
    const VectorXd filtered = lagged(command_, lag);
    Fit result;
    result.model.resize(measured_.size());
    for (Index k = 0; k < measured_.size(); ++k)
      result.model(k) = shifted(filtered, k + margin_, delay);
    const double mean_x = result.model.mean(), mean_y = measured_.mean();
    const VectorXd x = result.model.array() - mean_x;
    result.gain = x.dot(measured_) / x.squaredNorm();
    result.offset = mean_y - result.gain * mean_x;
    result.residual = (measured_ - result.gain * result.model).array() - result.offset;
    result.cost = result.residual.squaredNorm();
    return result;
  }
  double variation() const { return (measured_.array() - measured_.mean()).square().sum(); }
  /// Of the residual with respect to delay and lag, gain and offset re-fitted (variable projection, by differences).
  Eigen::MatrixX2d jacobian(double delay, double lag) const
  {
    constexpr double step = 1e-3;
    Eigen::MatrixX2d columns(measured_.size(), 2);
    columns.col(0) = (fit(delay + step, lag).residual - fit(delay - step, lag).residual) / (2.0 * step);
    const double low = std::max(0.0, lag - step), high = lag + step;
    columns.col(1) = (fit(delay, high).residual - fit(delay, low).residual) / (high - low);
    return columns;
  }

private:
  const VectorXd& command_;
  Index margin_;
  VectorXd measured_;
};

/// Where to begin the search for both: of lags from half a sample up, with what is left of the pure delay, the best.
Vector2d bestSplit(const Model& model, double pure, double most)
{
  Vector2d best(pure, 0.5);
  double least = std::numeric_limits<double>::infinity();
  for (double lag = 0.5; lag < most; lag *= 1.6)
    for (const double share : { 0.5, 0.8, 1.0 })
    {
      const Vector2d at(std::max(0.0, pure - share * lag), lag);
      const double cost = model.fit(at(0), at(1)).cost;
      if (cost < least)
      {
        least = cost;
        best = at;
      }
    }
  return best;
}

/// Gauss-Newton with damping on delay, or on delay and lag, within 0 <= delay <= most, 0 <= lag <= most.
Vector2d minimise(const Model& model, Vector2d at, bool with_lag, double most)
{
  double damping = 1e-3, cost = model.fit(at(0), at(1)).cost;
  for (int i = 0; i < kIterations; ++i)
  {
    const Eigen::MatrixX2d J = model.jacobian(at(0), at(1));
    const VectorXd r = model.fit(at(0), at(1)).residual;
    Eigen::Matrix2d H = J.transpose() * J;
    Vector2d g = J.transpose() * r;
    if (!with_lag)
    {
      H(0, 1) = H(1, 0) = g(1) = 0.0;
      H(1, 1) = 1.0;
    }
    bool better = false;
    Vector2d step(0, 0);
    double gained = 0.0;
    for (int tries = 0; tries < 12 && !better; ++tries)
    {
      Eigen::Matrix2d damped = H;
      damped.diagonal() *= 1.0 + damping;
      const Vector2d next = (at - damped.ldlt().solve(g)).cwiseMax(0.0).cwiseMin(most);
      const double next_cost = model.fit(next(0), next(1)).cost;
      better = next_cost < cost;
      damping *= better ? 0.1 : 10.0;
      if (better)
      {
        step = next - at;
        gained = cost - next_cost;
        at = next;
        cost = next_cost;
      }
    }
    if (!better || step.cwiseAbs().maxCoeff() < kConverged || gained < kGain * cost)
      break;
  }
  return at;
}

/// Covariance of (delay, lag) [samples^2]. Residuals are correlated in time: their effective number follows from the
/// correlation of neighbours, as of a first-order process.
Eigen::Matrix2d covariance(const Model& model, const Vector2d& at, bool with_lag)
{
  const VectorXd r = model.fit(at(0), at(1)).residual;
  const Eigen::MatrixX2d J = model.jacobian(at(0), at(1));
  const Index n = r.size();
  const double power = r.squaredNorm();
  const double neighbour = power > 0.0 ? r.head(n - 1).dot(r.tail(n - 1)) / power : 0.0;
  const double inflation = (1.0 + std::clamp(neighbour, 0.0, 0.999)) / (1.0 - std::clamp(neighbour, 0.0, 0.999));
  const double variance = power / static_cast<double>(n - 4) * inflation;
  Eigen::Matrix2d result = Eigen::Matrix2d::Zero();
  if (with_lag)
    result = variance * (J.transpose() * J).inverse();
  else
    result(0, 0) = variance / J.col(0).squaredNorm();
  return result;
}
}  // namespace

DelayEstimate estimateDelay(const VectorXd& command, const VectorXd& response, double dt, const DelayOptions& options)
{
  phri_core::requireRange("delay estimation: dt", dt, 1e-6, 1.0, "s");
  phri_core::requireRange("delay estimation: max_delay", options.max_delay, 2.0 * dt, 60.0, "s");
  if (command.size() != response.size())
    fail(text(command.size(), " samples of the command and ", response.size(), " of the response, expected as many"));
  const auto most = static_cast<Index>(std::ceil(options.max_delay / dt));
  if (command.size() < std::max(kFewestSamples, 4 * most))
    fail(text(command.size(), " samples, expected at least ", std::max(kFewestSamples, 4 * most), " (",
              1e3 * dt * static_cast<double>(std::max(kFewestSamples, 4 * most)),
              " ms: four times max_delay, and 100 samples)"));
  phri_core::requireFinite("delay estimation: command", command);
  phri_core::requireFinite("delay estimation: response", response);
  for (const auto& [name, signal] : { std::pair("command", &command), std::pair("response", &response) })
    if ((signal->array() - signal->mean()).square().mean() <= kStill * signal->array().square().mean())
      fail(text("the ", name, " does not move: it is ", signal->mean(), " throughout"));

  DelayEstimate estimate;
  const Index shift = bestShift(command, response, most, dt, options, estimate.correlation);
  const Model model(command, response, 2 * most + 2);
  const double limit = static_cast<double>(most);
  const Vector2d pure = minimise(model, Vector2d(shift, 0.0), false, limit);
  const Vector2d split = minimise(model, bestSplit(model, pure(0), limit), true, limit);

  const Eigen::Matrix2d spread = covariance(model, split, true);
  const bool better = model.fit(split(0), split(1)).cost < model.fit(pure(0), 0.0).cost;
  estimate.lag_identified = better && split(1) > kLagSignificant * std::sqrt(spread(1, 1));
  const Vector2d at = estimate.lag_identified ? split : pure;
  const Eigen::Matrix2d chosen = estimate.lag_identified ? spread : covariance(model, pure, false);
  const Fit fit = model.fit(at(0), at(1));
  estimate.delay = dt * at(0);
  estimate.lag = dt * at(1);
  estimate.total = estimate.delay + estimate.lag;
  estimate.delay_deviation = dt * std::sqrt(chosen(0, 0));
  estimate.lag_deviation = dt * std::sqrt(chosen(1, 1));
  estimate.total_deviation = dt * std::sqrt(std::max(0.0, chosen.sum()));
  estimate.gain = fit.gain;
  estimate.offset = fit.offset;
  estimate.explained = 1.0 - fit.cost / model.variation();
  return estimate;
}

double admittedStiffness(double mass, double damping, double delay, double lag)
{
  constexpr double least = std::numeric_limits<double>::min(), most = std::numeric_limits<double>::max();
  phri_core::requireRange("mass", mass, least, most, "kg, kgm2");
  phri_core::requireRange("damping", damping, least, most, "Ns/m, Nms/rad");
  phri_core::requireRange("delay", delay, 0.0, most, "s");
  phri_core::requireRange("lag", lag, 0.0, most, "s");
  if (delay + lag == 0.0)
    return std::numeric_limits<double>::infinity();
  // The phase of the loop falls with the frequency w: it passes -180 degrees where
  //   w delay + atan(w lag) + atan(w M / D) = 90 degrees
  const auto phase = [&](double w) { return w * delay + std::atan(w * lag) + std::atan(w * mass / damping) - M_PI_2; };
  double low = 0.0, high = 1.0;
  while (phase(high) < 0.0)
    high *= 2.0;
  for (int i = 0; i < 200 && high - low > 1e-15 * high; ++i)
  {
    const double middle = 0.5 * (low + high);
    (phase(middle) < 0.0 ? low : high) = middle;
  }
  const double w = 0.5 * (low + high);
  return w * std::hypot(mass * w, damping) * std::hypot(1.0, lag * w);
}
}  // namespace phri_control
