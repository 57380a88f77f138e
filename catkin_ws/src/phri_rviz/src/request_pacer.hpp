#pragma once
#include "tunable.hpp"

namespace phri_rviz
{
/// Turns a stream of changed values into requests: at most one per period, one at a time (two on their way could
/// overtake each other), and always the last value of each parameter. Times are [s] of any clock that does not go back.
class RequestPacer
{
public:
  explicit RequestPacer(double period) : period_(period) {}

  void put(const QString& name, double value) { waiting_.insert(name, value); }
  /// What is to be sent now; empty: nothing. After a request `answered` must follow, also when it failed.
  Values take(double now);
  void answered() { sent_.clear(); }
  void clear();

  /// The newest value of this parameter is not yet known to have arrived.
  bool isPending(const QString& name) const { return waiting_.contains(name) || sent_.contains(name); }
  bool isWaiting(const QString& name) const { return waiting_.contains(name); }
  bool idle() const { return waiting_.isEmpty(); }

private:
  double period_;
  double next_ = -1e300;
  Values waiting_, sent_;
};
}  // namespace phri_rviz
