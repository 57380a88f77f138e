#include "phri_control/iterative_solver.hpp"

#include <cmath>
#include <sstream>
#include <stdexcept>

namespace phri_control
{
const char* toString(IterativeStatus status)
{
  switch (status)
  {
    case IterativeStatus::Converged:
      return "Converged";
    case IterativeStatus::MaxIterations:
      return "MaxIterations";
    case IterativeStatus::Breakdown:
      return "Breakdown";
    case IterativeStatus::LineSearch:
      return "LineSearch";
    case IterativeStatus::NotFinite:
      return "NotFinite";
  }
  return "unknown";
}

namespace detail
{
namespace
{
[[noreturn]] void fail(const std::string& text)
{
  throw std::invalid_argument(text);
}

void requireOption(bool valid, const std::string& name, double value, const std::string& expected)
{
  if (valid)
    return;
  std::ostringstream text;
  text << "IterativeOptions." << name << " = " << value << ", expected " << expected;
  fail(text.str());
}
}  // namespace

void requireAttitude(const Attitude& attitude, std::size_t sources)
{
  if (const RiskSensitive* risk = std::get_if<RiskSensitive>(&attitude))
  {
    if (risk->theta.size() != sources)
      fail("RiskSensitive.theta has " + std::to_string(risk->theta.size()) + " elements, expected " +
           std::to_string(sources) + ", one per source of noise");
    for (std::size_t s = 0; s < risk->theta.size(); ++s)
      if (!std::isfinite(risk->theta[s]))
        fail("RiskSensitive.theta[" + std::to_string(s) + "] = " + std::to_string(risk->theta[s]) +
             ", expected a finite number");
    return;
  }
  const Eigen::MatrixXd& gamma = std::get_if<CostCumulants>(&attitude)->gamma;
  if (gamma.cols() > 0 && gamma.rows() != static_cast<Eigen::Index>(sources))
    fail("CostCumulants.gamma has " + std::to_string(gamma.rows()) + " rows, expected " + std::to_string(sources) +
         ", one per source of noise");
  phri_core::requireFinite("CostCumulants.gamma", gamma);
}

void requireOptions(const IterativeOptions& options)
{
  requireOption(options.tolerance > 0.0, "tolerance", options.tolerance, "above 0");
  requireOption(options.max_iterations >= 0, "max_iterations", options.max_iterations, "at least 0");
  requireOption(options.max_passes >= 0, "max_passes", options.max_passes, "at least 0 (0: no limit)");
  requireOption(options.min_step > 0.0 && options.min_step <= 1.0, "min_step", options.min_step, "in (0, 1]");
  requireOption(options.cumulants >= 0, "cumulants", options.cumulants, "at least 0");
}

void requireStart(const Eigen::Ref<const Eigen::VectorXd>& x0, Eigen::Index n, std::size_t count, int horizon)
{
  phri_core::requireShape("x0", x0, n, 1);
  phri_core::requireFinite("x0", x0);
  if (count != 0 && count != static_cast<std::size_t>(horizon))
    fail("start has " + std::to_string(count) + " controls, expected " + std::to_string(horizon) + " or none");
}

void requireControl(std::size_t k, const Eigen::Ref<const Eigen::VectorXd>& control, Eigen::Index m)
{
  const std::string name = "start[" + std::to_string(k) + "]";
  phri_core::requireShape(name, control, m, 1);
  phri_core::requireFinite(name, control);
}

void scaleAttitude(const Attitude& attitude, double share, bool all, Attitude& used)
{
  used = attitude;
  if (RiskSensitive* risk = std::get_if<RiskSensitive>(&used))
  {
    for (double& theta : risk->theta)
      if (all || theta > 0.0)
        theta *= share;
    return;
  }
  Eigen::MatrixXd& gamma = std::get_if<CostCumulants>(&used)->gamma;
  for (double& weight : gamma.reshaped())
    if (all || weight < 0.0)
      weight *= share;
}

std::string describe(IterativeStatus status, const RiskStatus& risk, Fallback fallback, double share, double refused,
                     int iterations, double max_feedforward)
{
  std::ostringstream text;
  text << toString(status) << " after " << iterations << " iterations, max |l| = " << max_feedforward;
  if (!risk)
    text << "; " << RiskBreakdown(risk).what();
  if (fallback == Fallback::Reduced)
    text << "; fallback: the attitude times " << share;
  if (refused > 0.0)
    text << "; solutions followed from the risk-neutral one end before " << refused << " of the attitude"
         << (risk ? ": no step shrinks max |l|" : "");
  if (fallback == Fallback::RiskNeutral)
    text << "; fallback: the risk-neutral solution";
  return text.str();
}
}  // namespace detail

template class IterativeSolver<>;
template IterativeResult<> solveIterative(const OptimalControlProblem<>&, const Eigen::VectorXd&, const Attitude&,
                                          const IterativeOptions&, const std::vector<Eigen::VectorXd>&);
}  // namespace phri_control
