#pragma once
#include <Eigen/Core>

/// Delay of a control loop from a recording, and the contact stiffness that it admits.
namespace phri_control
{
struct DelayOptions
{
  double max_delay = 0.2;          ///< [s] delays are looked for in [0, max_delay]
  double least_correlation = 0.7;  ///< between command and response, at the best delay
};

/// response(t) = gain * lag(command)(t - delay) + offset, lag: first order with the time constant `lag`.
struct DelayEstimate
{
  double delay = 0.0;            ///< pure delay T [s]; all of it where the lag was not identified
  double lag = 0.0;              ///< [s]; 0 where not identified
  bool lag_identified = false;   ///< the recording tells delay and lag apart
  double total = 0.0;            ///< delay + lag [s]: what slow signals see
  double total_deviation = 0.0;  ///< standard deviations [s], residuals taken as correlated in time
  double delay_deviation = 0.0;
  double lag_deviation = 0.0;
  double gain = 0.0, offset = 0.0;
  double correlation = 0.0;  ///< of command and response, at the best shift
  double explained = 0.0;    ///< share of the response's variance that the model explains
};

/// Both signals sampled at the same instants, every `dt` [s]; smooth between samples (a command that moves over at
/// least ten samples: a chirp, filtered noise, somebody's hand; a command held constant between samples counts half a
/// sample of delay, as the loop does). Cross-correlation gives the first guess, least squares over a shift by cubic
/// interpolation the rest. Not for the tick.
///
/// Throws std::invalid_argument naming value and expected range: fewer than 100 samples or less than 4 max_delay,
/// unequal lengths, values that are not finite, a command or response that does not move, no correlation, a response of
/// the opposite sign, one that leads the command (columns swapped, or clocks that differ), a delay at max_delay, a
/// periodic command whose delay is ambiguous.
DelayEstimate estimateDelay(const Eigen::VectorXd& command, const Eigen::VectorXd& response, double dt,
                            const DelayOptions& options = {});

/// Largest stiffness [N/m, Nm/rad] of a contact that an admittance M xdd + D xd = u renders stably per axis when u
/// reaches it `delay` late and through a first-order lag: the smallest k > 0 for which
///   (M s^2 + D s)(lag s + 1) + k exp(-delay s) = 0
/// has a root on the imaginary axis. About D / (delay + lag) for small delays, and never less than that. Infinite
/// without delay and lag. Throws std::invalid_argument unless mass > 0, damping > 0, delay >= 0 and lag >= 0.
double admittedStiffness(double mass, double damping, double delay, double lag = 0.0);
}  // namespace phri_control
