#include "node_settings.hpp"

#include "stage_view.hpp"

namespace phri_sim
{
namespace
{
using XmlRpc::XmlRpcValue;

bool isNumber(const XmlRpcValue& value)
{
  return value.getType() == XmlRpcValue::TypeInt || value.getType() == XmlRpcValue::TypeDouble;
}

double number(XmlRpcValue& value)
{
  return value.getType() == XmlRpcValue::TypeInt ? double(int(value)) : double(value);
}

void addList(XmlRpcValue& list, const std::string& key, Parameters& out, std::vector<std::string>& errors)
{
  std::vector<double> numbers;
  std::vector<std::string> texts;
  for (int i = 0; i < list.size(); ++i)
    if (isNumber(list[i]))
      numbers.push_back(number(list[i]));
    else if (list[i].getType() == XmlRpcValue::TypeString)
      texts.push_back(list[i]);
  if (texts.empty() && int(numbers.size()) == list.size())
    out[key] = numbers;
  else if (numbers.empty() && int(texts.size()) == list.size())
    out[key] = texts;
  else
    errors.push_back(key + ": a list of mixed or nested elements; expected a list of numbers or of texts");
}

void add(XmlRpcValue& value, const std::string& key, Parameters& out, std::vector<std::string>& errors)
{
  switch (value.getType())
  {
    case XmlRpcValue::TypeStruct:
      for (auto& member : value)
        add(member.second, key.empty() ? member.first : key + '/' + member.first, out, errors);
      return;
    case XmlRpcValue::TypeBoolean:
      out[key] = bool(value);
      return;
    case XmlRpcValue::TypeInt:
    case XmlRpcValue::TypeDouble:
      out[key] = number(value);
      return;
    case XmlRpcValue::TypeString:
      out[key] = std::string(value);
      return;
    case XmlRpcValue::TypeArray:
      addList(value, key, out, errors);
      return;
    default:
      errors.push_back(key + ": expected a number, a flag, a text or a list");
  }
}

phri_core::ParameterTable table(NodeSettings& settings)
{
  phri_core::ParameterTable t;
  t.text("experiment", &settings.experiment, {}, "file in config/experiments, or a path")
      .text("clock", &settings.clock, { "lockstep", "realtime" },
            "as fast as it can, or 1 kHz by the clock on the wall")
      .number("pace", &settings.pace, "-", 0.0, 1000.0, "lockstep no faster than this times real time; 0: no bound")
      .text("human", &settings.human, handKinds(), "whose hand moves the object")
      .text("model_node", &settings.model_node, {}, "node that learns and answers observations; empty: none");
  addParameters(t, settings.hand);
  return t;
}

/// A person's hand knows one clock only.
bool needsRealtime(const std::string& human)
{
  return human != "simulated" && human != "replay";
}
}  // namespace

Parameters flatten(XmlRpcValue tree, std::vector<std::string>& errors)
{
  Parameters out;
  if (tree.getType() == XmlRpcValue::TypeStruct)
    add(tree, "", out, errors);
  return out;
}

NodeSetup loadSetup(const XmlRpcValue& private_parameters, const std::string& where)
{
  NodeSetup setup;
  std::vector<std::string> errors;
  const Parameters all = flatten(private_parameters, errors);
  setup.overrides = underPrefix(all, "overrides");
  Parameters own;
  for (const auto& [key, value] : all)
    if (key.rfind("overrides/", 0) != 0)
      own[key] = value;
  try
  {
    table(setup.settings).assign(where, own);
    if (needsRealtime(setup.settings.human) && !setup.settings.realtime())
      errors.push_back("clock = \"lockstep\": expected \"realtime\" with human = \"" + setup.settings.human + '"');
  }
  catch (const phri_core::ParameterError& error)
  {
    errors.insert(errors.end(), error.errors().begin(), error.errors().end());
    if (const auto given = own.find("experiment"); given != own.end())
      if (const auto* name = std::get_if<std::string>(&given->second))
        setup.settings.experiment = *name;  // so that its errors are listed too
  }
  try
  {
    setup.experiment = std::make_shared<const Experiment>(loadExperiment(setup.settings.experiment, setup.overrides));
    if (!hasView(*setup.experiment))
      errors.push_back("experiment = \"" + setup.settings.experiment + "\": task " + setup.experiment->task +
                       " has no live view; run it without ROS (phri-analysis)");
    if (!setup.experiment->planar() && setup.settings.human != "simulated")
      errors.push_back("human = \"" + setup.settings.human +
                       "\": expected \"simulated\" in a task other than planar (" + setup.settings.experiment + " is " +
                       setup.experiment->task + ')');
  }
  catch (const phri_core::ParameterError& error)
  {
    errors.insert(errors.end(), error.errors().begin(), error.errors().end());
  }
  catch (const PictureError& error)
  {
    if (errors.empty())
      throw;
    errors.push_back(error.what());
  }
  catch (const std::exception& error)
  {
    errors.push_back(error.what());
  }
  if (!errors.empty())
    throw phri_core::ParameterError(where, errors);
  return setup;
}
}  // namespace phri_sim
