#include "phri_sim/configuration.hpp"

#include <yaml-cpp/yaml.h>

#include <cstdlib>
#include <filesystem>
#include <stdexcept>

namespace phri_sim
{
namespace
{
phri_core::ParameterValue scalar(const YAML::Node& node)
{
  const std::string text = node.Scalar();
  if (node.Tag() == "!")  // quoted
    return text;
  if (text == "true" || text == "True")
    return true;
  if (text == "false" || text == "False")
    return false;
  double number = 0.0;
  if (YAML::convert<double>::decode(node, number))
    return number;
  return text;
}

void flatten(const YAML::Node& node, const std::string& key, Parameters& out)
{
  if (node.IsMap())
  {
    for (const auto& child : node)
      flatten(child.second, key.empty() ? child.first.Scalar() : key + '/' + child.first.Scalar(), out);
    return;
  }
  if (node.IsScalar())
  {
    out[key] = scalar(node);
    return;
  }
  if (!node.IsSequence())
    throw std::invalid_argument(key + " has no value: expected a number, a flag, a text or a list");
  std::vector<double> numbers;
  std::vector<std::string> texts;
  for (const YAML::Node& element : node)
  {
    if (!element.IsScalar())
      throw std::invalid_argument(key + " is a list of lists or maps: expected a list of numbers or texts");
    const auto value = scalar(element);
    if (const auto* number = std::get_if<double>(&value))
      numbers.push_back(*number);
    texts.push_back(element.Scalar());
  }
  if (!numbers.empty() && numbers.size() == texts.size())
    out[key] = numbers;
  else
    out[key] = texts;
}
}  // namespace

std::string shareFolder()
{
  const char* folder = std::getenv("PHRI_SIM_SHARE");
  if (folder && *folder)
    return folder;
  return std::filesystem::exists(PHRI_SIM_SOURCE "/config") ? PHRI_SIM_SOURCE : PHRI_SIM_INSTALL;
}

std::string findConfiguration(const std::string& kind, const std::string& name_or_path)
{
  namespace fs = std::filesystem;
  if (fs::is_regular_file(name_or_path))
    return name_or_path;
  const fs::path folder = fs::path(shareFolder()) / "config" / kind, file = folder / (name_or_path + ".yaml");
  if (fs::is_regular_file(file))
    return file.string();
  std::string known;
  if (fs::is_directory(folder))
    for (const auto& entry : fs::directory_iterator(folder))
      if (entry.path().extension() == ".yaml")
        known += (known.empty() ? "" : ", ") + entry.path().stem().string();
  throw std::invalid_argument(kind + " \"" + name_or_path + "\": no such file, and no " + file.string() +
                              "; known: " + known);
}

Parameters loadYaml(const std::string& path)
{
  Parameters parameters;
  try
  {
    const YAML::Node root = YAML::LoadFile(path);
    if (!root.IsMap())
      throw std::invalid_argument("expected a map of keys and values");
    flatten(root, "", parameters);
  }
  catch (const std::exception& error)
  {
    throw std::invalid_argument(path + ": " + error.what());
  }
  return parameters;
}

Parameters underPrefix(const Parameters& all, const std::string& prefix)
{
  Parameters part;
  for (const auto& [key, value] : all)
    if (key.compare(0, prefix.size() + 1, prefix + '/') == 0)
      part[key.substr(prefix.size() + 1)] = value;
  return part;
}
}  // namespace phri_sim
