#include "tuning_server.hpp"

#include <dynamic_reconfigure/ConfigDescription.h>

namespace phri_sim
{
namespace
{
constexpr const char* kGroup = "Default";

dynamic_reconfigure::GroupState group()
{
  dynamic_reconfigure::GroupState state;
  state.name = kGroup;
  state.state = true;
  return state;
}

void add(dynamic_reconfigure::Config& config, const std::string& name, double value)
{
  dynamic_reconfigure::DoubleParameter parameter;
  parameter.name = name;
  parameter.value = value;
  config.doubles.push_back(parameter);
}

/// What is not a number is passed on as what it is: the table says what is wrong with it.
TuningServer::Values values(const dynamic_reconfigure::Config& config)
{
  TuningServer::Values out;
  for (const auto& parameter : config.doubles)
    out[parameter.name] = parameter.value;
  for (const auto& parameter : config.ints)
    out[parameter.name] = double(parameter.value);
  for (const auto& parameter : config.bools)
    out[parameter.name] = bool(parameter.value);
  for (const auto& parameter : config.strs)
    out[parameter.name] = parameter.value;
  return out;
}
}  // namespace

TuningServer::TuningServer(ros::NodeHandle& private_node, std::function<Entries()> entries,
                           std::function<void(const Values&)> apply)
  : entries_(std::move(entries)),
    apply_(std::move(apply)),
    descriptions_(private_node.advertise<dynamic_reconfigure::ConfigDescription>("parameter_descriptions", 1, true)),
    updates_(private_node.advertise<dynamic_reconfigure::Config>("parameter_updates", 1, true)),
    service_(private_node.advertiseService("set_parameters", &TuningServer::set, this))
{
  describe();
  updates_.publish(inForce());
}

dynamic_reconfigure::Config TuningServer::inForce() const
{
  dynamic_reconfigure::Config config;
  for (const auto& entry : entries_())
    add(config, entry.key, entry.value);
  config.groups.push_back(group());
  return config;
}

void TuningServer::describe() const
{
  dynamic_reconfigure::ConfigDescription description;
  dynamic_reconfigure::Group all;
  all.name = kGroup;
  for (const auto& entry : entries_())
  {
    dynamic_reconfigure::ParamDescription parameter;
    parameter.name = entry.key;
    parameter.type = "double";
    parameter.description = entry.help + " [" + (entry.unit.empty() ? "-" : entry.unit) + "]";
    all.parameters.push_back(parameter);
    add(description.min, entry.key, entry.low);
    add(description.max, entry.key, entry.high);
    add(description.dflt, entry.key, entry.value);
  }
  description.groups.push_back(all);
  for (auto* config : { &description.min, &description.max, &description.dflt })
    config->groups.push_back(group());
  descriptions_.publish(description);
}

bool TuningServer::set(dynamic_reconfigure::Reconfigure::Request& request,
                       dynamic_reconfigure::Reconfigure::Response& response)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  try
  {
    apply_(values(request.config));
  }
  catch (const std::exception& error)
  {
    // roscpp logs the text and hands it to the caller
    throw std::runtime_error(std::string("E_PARAMETER action=KEPT_OLD ") + error.what());
  }
  response.config = inForce();
  updates_.publish(response.config);
  return true;
}
}  // namespace phri_sim
