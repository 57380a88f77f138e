#pragma once
#include <dynamic_reconfigure/Config.h>
#include <dynamic_reconfigure/Reconfigure.h>
#include <ros/ros.h>

#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "phri_core/parameters.hpp"

namespace phri_sim
{
/// Offers the numbers of a parameter table to the clients of dynamic_reconfigure (dynparam, rqt_reconfigure on another
/// machine, the rviz panel): latched topics ~parameter_descriptions and ~parameter_updates, service ~set_parameters.
/// Keys, units, ranges and meanings come from the table itself, so that they stand in one place; hence no .cfg file.
/// Other than the stock server, which silently clamps, it refuses a request with anything wrong in it, names everything
/// that is wrong, and changes nothing.
class TuningServer
{
public:
  using Values = std::map<std::string, phri_core::ParameterValue>;
  using Entries = std::vector<phri_core::ParameterTable::Entry>;
  /// `entries()` describes the parameters with the values in force; `apply` puts new ones in force, or throws
  /// phri_core::ParameterError. Both are called from ROS callbacks, one at a time.
  TuningServer(ros::NodeHandle& private_node, std::function<Entries()> entries,
               std::function<void(const Values&)> apply);

private:
  bool set(dynamic_reconfigure::Reconfigure::Request& request, dynamic_reconfigure::Reconfigure::Response& response);
  dynamic_reconfigure::Config inForce() const;
  void describe() const;

  const std::function<Entries()> entries_;
  const std::function<void(const Values&)> apply_;
  std::mutex mutex_;
  ros::Publisher descriptions_, updates_;
  ros::ServiceServer service_;
};
}  // namespace phri_sim
