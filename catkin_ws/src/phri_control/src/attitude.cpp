#include "phri_control/attitude.hpp"

#include <sstream>

namespace phri_control
{
namespace
{
std::string words(const RiskStatus& status)
{
  std::ostringstream text;
  if (status.stage >= 0)
    text << "stage " << status.stage << ": ";
  switch (status.kind)
  {
    case BreakdownKind::None:
      text << "no breakdown";
      break;
    case BreakdownKind::Expectation:
      text << "E exp(theta J) is infinite";
      if (status.source >= 0)
        text << " for source " << status.source;
      text << ": theta = " << status.theta << ", expected " << (status.theta > 0.0 ? "below " : "above ")
           << status.limit;
      break;
    case BreakdownKind::Hessian:
      text << "R + B'W B is not positive definite: the criterion has no minimum over the control";
      break;
    case BreakdownKind::NotFinite:
      text << "a number is not finite";
      break;
  }
  return text.str();
}
}  // namespace

RiskBreakdown::RiskBreakdown(const RiskStatus& status) : std::runtime_error(words(status)), status_(status) {}
}  // namespace phri_control
