#pragma once
#include <map>
#include <string>

#include "phri_core/parameters.hpp"

namespace phri_sim
{
using Parameters = std::map<std::string, phri_core::ParameterValue>;

/// Folder that holds `config/`: the environment variable PHRI_SIM_SHARE, or where the package was built or installed.
std::string shareFolder();

/// Path of a configuration file: `name_or_path` itself if such a file exists, else `config/<kind>/<name>.yaml`. Throws
/// std::invalid_argument naming what was looked for and what there is.
std::string findConfiguration(const std::string& kind, const std::string& name_or_path);

/// A YAML file as a flat map: nested keys are joined by '/', so that `limits: {velocity: 1}` is "limits/velocity".
/// Throws std::invalid_argument naming file and line if it is not YAML, or if a value is neither a number, a flag, a
/// text nor a list of numbers or texts.
Parameters loadYaml(const std::string& path);

/// The entries of `all` whose key starts with `prefix` + '/', without that prefix.
Parameters underPrefix(const Parameters& all, const std::string& prefix);
}  // namespace phri_sim
