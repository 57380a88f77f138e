#include "request_pacer.hpp"

namespace phri_rviz
{
Values RequestPacer::take(double now)
{
  if (waiting_.isEmpty() || !sent_.isEmpty() || now < next_)
    return {};
  next_ = now + period_;
  sent_ = waiting_;
  waiting_.clear();
  return sent_;
}

void RequestPacer::clear()
{
  waiting_.clear();
  sent_.clear();
}
}  // namespace phri_rviz
