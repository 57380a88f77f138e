// Delay of a loop from a recording, against signals whose delayed and lagged version is known in closed form, and the
// stiffness that a delay admits, against published numbers and a simulated contact.
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <deque>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "phri_control/delay_estimation.hpp"
#include "phri_core/random.hpp"

using namespace phri_control;
using Eigen::VectorXd;

namespace
{
constexpr double kDt = 0.001;  // [s]
constexpr int kSamples = 10000;
// Cubic interpolation of 25 Hz at 1 kHz: error (2 pi 25 / 1000)^4 / 40 = 2e-5 of the amplitude, a millisecond changes
// the signal by 0.16: at most 2e-7 s.
constexpr double kExact = 1e-6;  // [s]

/// Sum of tones from 0.3 to 25 Hz with random phases: smooth, aperiodic, and its delayed and lagged version is exact.
struct Tones
{
  std::vector<double> omega, phase, size;

  explicit Tones(std::uint64_t seed)
  {
    phri_core::Random random(seed);
    for (int i = 0; i < 60; ++i)
    {
      omega.push_back(2.0 * M_PI * random.uniform(0.3, 25.0));
      phase.push_back(random.uniform(0.0, 2.0 * M_PI));
      size.push_back(random.uniform(0.1, 1.0));
    }
  }
  double at(double t, double delay = 0.0, double lag = 0.0) const
  {
    double sum = 0.0;
    for (std::size_t i = 0; i < omega.size(); ++i)
      sum += size[i] / std::hypot(1.0, omega[i] * lag) *
             std::sin(omega[i] * (t - delay) + phase[i] - std::atan(omega[i] * lag));
    return sum;
  }
  VectorXd recorded(double delay = 0.0, double lag = 0.0, int samples = kSamples) const
  {
    VectorXd signal(samples);
    for (int k = 0; k < samples; ++k)
      signal(k) = at(k * kDt, delay, lag);
    return signal;
  }
};

std::string errorOf(const std::function<void()>& action)
{
  try
  {
    action();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

void expectError(const VectorXd& command, const VectorXd& response, const std::string& part,
                 const DelayOptions& options = {})
{
  const std::string error = errorOf([&] { estimateDelay(command, response, kDt, options); });
  EXPECT_NE(error.find(part), std::string::npos) << error;
}
}  // namespace

TEST(EstimateDelay, FindsDelayAndLagBelowASample)
{
  int seed = 0;
  for (const double delay : { 0.0, 0.0004, 0.0037, 0.02, 0.08137 })
    for (const double lag : { 0.002, 0.0113, 0.05 })
    {
      const Tones tones(++seed);
      const VectorXd response = (2.5 * tones.recorded(delay, lag)).array() - 7.0;
      const DelayEstimate found = estimateDelay(tones.recorded(), response, kDt);
      EXPECT_TRUE(found.lag_identified);
      // The lag is discretised for an input that is linear between samples, which moves delay and lag against each
      // other by a twentieth of a sample; their sum does not feel it.
      EXPECT_NEAR(found.delay, delay, 0.05 * kDt) << lag;
      EXPECT_NEAR(found.lag, lag, 0.05 * kDt + 2e-3 * lag) << delay;
      EXPECT_NEAR(found.total, delay + lag, 0.01 * kDt + 2e-3 * lag) << delay << ' ' << lag;
      EXPECT_NEAR(found.gain, 2.5, 0.01);
      EXPECT_NEAR(found.offset, -7.0, 0.05);
      EXPECT_GT(found.explained, 0.9999);
    }
}

TEST(EstimateDelay, FindsAPureDelayBelowASample)
{
  int seed = 100;
  for (const double delay : { 0.0, 0.0003, 0.0128, 0.15 })
  {
    const Tones tones(++seed);
    const DelayEstimate found = estimateDelay(tones.recorded(), tones.recorded(delay), kDt);
    EXPECT_NEAR(found.total, delay, kExact);
    EXPECT_NEAR(found.correlation, 1.0, 0.01);  // at whole samples
  }
}

TEST(EstimateDelay, StatesItsErrorUnderNoise)
{
  // Monte Carlo oracle: the scatter of the estimates is what they state. 200 runs tell a deviation to 5 %.
  constexpr int kRuns = 200;
  constexpr double delay = 0.0085, lag = 0.012, kSpread = 0.2;
  double errors[3] = {}, stated[3] = {};
  for (int run = 0; run < kRuns; ++run)
  {
    phri_core::Random random(1000 + run);
    const Tones tones(500);
    VectorXd response = tones.recorded(delay, lag, 3000);
    for (double& value : response)
      value += random.normal(0.0, 0.3);
    const DelayEstimate found = estimateDelay(tones.recorded(0.0, 0.0, 3000), response, kDt);
    ASSERT_TRUE(found.lag_identified);
    const double error[3] = { found.delay - delay, found.lag - lag, found.total - delay - lag };
    const double deviation[3] = { found.delay_deviation, found.lag_deviation, found.total_deviation };
    for (int i = 0; i < 3; ++i)
    {
      errors[i] += error[i] * error[i];
      stated[i] += deviation[i] * deviation[i];
    }
  }
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(std::sqrt(errors[i] / stated[i]), 1.0, kSpread) << i;
  EXPECT_LT(std::sqrt(stated[2] / kRuns), 1e-4);  // a tenth of a sample
}

TEST(EstimateDelay, DoesNotSplitWhatTheNoiseHides)
{
  // a lag of 0.2 samples under noise of 2, the signal having 3: the total is right, the split is not claimed
  int claimed = 0;
  for (int run = 0; run < 50; ++run)
  {
    phri_core::Random random(2000 + run);
    const Tones tones(600 + run);
    VectorXd response = tones.recorded(0.01, 0.0002, 3000);
    for (double& value : response)
      value += random.normal(0.0, 2.0);
    const DelayEstimate found = estimateDelay(tones.recorded(0.0, 0.0, 3000), response, kDt);
    claimed += found.lag_identified;
    EXPECT_NEAR(found.total, 0.0102, 5.0 * found.total_deviation + 1e-5);
    EXPECT_EQ(found.lag > 0.0, found.lag_identified);
  }
  EXPECT_LE(claimed, 1);
}

TEST(EstimateDelay, CountsHalfASampleOfAHeldCommand)
{
  // A command held between samples is a command half a sample later, for a loop's stability and for this estimate.
  constexpr int kFine = 50;
  const Tones tones(7);
  const VectorXd command = tones.recorded();
  const double lag = 0.008, decay = std::exp(-kDt / kFine / lag);
  VectorXd response(kSamples);
  double state = command(0);
  for (int k = 0; k < kSamples; ++k)
  {
    response(k) = state;
    for (int i = 0; i < kFine; ++i)  // transport of 3 samples, then the lag
      state = decay * state + (1.0 - decay) * command(std::max(0, k - 3));
  }
  const DelayEstimate found = estimateDelay(command, response, kDt);
  EXPECT_NEAR(found.total, 0.003 + 0.5 * kDt + lag, 3e-5);
}

TEST(EstimateDelay, RefusesWhatItCannotTell)
{
  const Tones tones(8);
  const VectorXd command = tones.recorded(), response = tones.recorded(0.01);
  expectError(command, -response, "opposite sign");
  expectError(response, command, "the response leads the command by 10 ms");
  expectError(command, Tones(9).recorded(), "expected at least 0.7: they are not related");
  expectError(command, tones.recorded(0.35), "related, or the delay is beyond max_delay = 0.2 s");
  expectError(command.head(300), response.head(300), "300 samples, expected at least 800");
  expectError(command, response.head(500), "10000 samples of the command and 500 of the response");
  expectError(VectorXd::Constant(kSamples, 3.0), response, "the command does not move: it is 3 throughout");
  expectError(command, VectorXd::Zero(kSamples), "the response does not move");
  VectorXd holed = response;
  holed(17) = std::numeric_limits<double>::quiet_NaN();
  expectError(command, holed, "response(17, 0) = nan");

  // a ramp's correlation is 1 at every shift, a hum's every period
  VectorXd sine(kSamples), later(kSamples);
  for (int k = 0; k < kSamples; ++k)
  {
    sine(k) = std::sin(2.0 * M_PI * 20.0 * k * kDt);
    later(k) = std::sin(2.0 * M_PI * 20.0 * (k - 12) * kDt);
  }
  expectError(sine, later, "the command is periodic");
  DelayOptions narrow;
  narrow.max_delay = 0.02;  // below half a period the same recording is good
  EXPECT_NEAR(estimateDelay(sine, later, kDt, narrow).total, 0.012, 1e-5);
}

TEST(AdmittedStiffness, IsThatOfTheThesisAdmittances)
{
  // Published for 1, 5, 10, 20, 50 ms; kN/m to the digits printed
  const auto k = [](double mass, double damping, double ms) {
    return admittedStiffness(mass, damping, 1e-3 * ms) / 1e3;
  };
  EXPECT_NEAR(k(40, 90, 1), 90.0, 0.5);
  EXPECT_NEAR(k(40, 90, 50), 1.8, 0.05);
  EXPECT_NEAR(k(15, 80, 5), 16.1, 0.05);
  EXPECT_NEAR(k(15, 80, 20), 4.1, 0.05);
  EXPECT_NEAR(k(15, 80, 50), 1.67, 0.005);
  EXPECT_NEAR(k(90, 200, 50), 4.1, 0.06);
  EXPECT_NEAR(k(10, 80, 50), 1.70, 0.005);
  EXPECT_EQ(k(10, 80, 0), std::numeric_limits<double>::infinity());
}

TEST(AdmittedStiffness, IsARootOnTheImaginaryAxisAndNeverBelowTheRule)
{
  phri_core::Random random(10);
  for (int i = 0; i < 2000; ++i)
  {
    const double mass = std::pow(10.0, random.uniform(-1.0, 2.0)), damping = std::pow(10.0, random.uniform(0.0, 3.0));
    const double delay = std::pow(10.0, random.uniform(-3.5, -1.0)), lag = random.uniform(0.0, 0.1);
    const double k = admittedStiffness(mass, damping, delay, lag);
    EXPECT_GE(k, damping / (delay + lag) * (1.0 - 1e-12));
    // |M s^2 + D s| |lag s + 1| = k has one w > 0, for the left side rises; there the phases must agree, too
    double low = 0.0, high = 1e9;
    for (int n = 0; n < 200; ++n)
    {
      const double w = 0.5 * (low + high);
      (w * std::hypot(mass * w, damping) * std::hypot(1.0, lag * w) < k ? low : high) = w;
    }
    const std::complex<double> s(0.0, low);
    const std::complex<double> value = (mass * s * s + damping * s) * (lag * s + 1.0) + k * std::exp(-delay * s);
    EXPECT_LT(std::abs(value), 1e-9 * k);
  }
}

TEST(AdmittedStiffness, PartsStableFromUnstableContacts)
{
  // Oracle: the contact itself, 20 us steps (delay = 250 of them), started at rest 1 mm deep.
  const double mass = 15.0, damping = 80.0, delay = 0.005, lag = 0.004, h = 2e-5;
  for (const double share : { 0.97, 1.03 })
  {
    const double k = share * admittedStiffness(mass, damping, delay, lag);
    std::deque<double> past(static_cast<std::size_t>(std::lround(delay / h)), 1e-3);
    double x = 1e-3, v = 0.0, force = -k * x, early = 0.0, late = 0.0;
    for (int i = 0; i * h < 8.0; ++i)
    {
      past.push_back(x);
      force += h / lag * (-k * past.front() - force);
      past.pop_front();
      v += h / mass * (force - damping * v);
      x += h * v;
      (i * h < 4.0 ? early : late) = std::max(i * h < 4.0 ? early : late, i * h > 2.0 ? std::abs(x) : 0.0);
    }
    EXPECT_EQ(late < early, share < 1.0) << share << ' ' << early << ' ' << late;
  }
}

TEST(AdmittedStiffness, RefusesBadInput)
{
  EXPECT_NE(errorOf([] { admittedStiffness(0.0, 80.0, 0.01); }).find("mass = 0 kg"), std::string::npos);
  EXPECT_NE(errorOf([] { admittedStiffness(10.0, -1.0, 0.01); }).find("damping = -1"), std::string::npos);
  EXPECT_NE(errorOf([] { admittedStiffness(10.0, 80.0, -0.01); }).find("delay = -0.01 s"), std::string::npos);
  EXPECT_NE(errorOf([] { admittedStiffness(10.0, 80.0, 0.01, NAN); }).find("lag = nan s"), std::string::npos);
}
