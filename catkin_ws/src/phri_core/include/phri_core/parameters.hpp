#pragma once
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

namespace phri_core
{
/// A value from a YAML file or a ROS parameter, before it is checked.
using ParameterValue = std::variant<bool, double, std::string, std::vector<double>, std::vector<std::string>>;

/// All that is wrong with a configuration, at once: one line per error.
class ParameterError : public std::invalid_argument
{
public:
  ParameterError(const std::string& where, std::vector<std::string> errors);
  const std::vector<std::string>& errors() const { return errors_; }

private:
  std::vector<std::string> errors_;
};

/// The schema of one configuration struct: key, unit, range and meaning of each field, bound to the field's storage.
/// The only place where a parameter is described: validation, run-time changes and the reference page all read it. Keys
/// are paths such as "admittance/mass".
class ParameterTable
{
public:
  struct Entry
  {
    std::string key, unit, help;
    double low = 0.0, high = 0.0;      ///< inclusive range of a number; equal when the entry is not a number
    std::vector<std::string> choices;  ///< allowed strings; empty: any
    std::string kind;                  ///< "number", "integer", "flag", "text", "list", "names"
    std::string initial;               ///< default, as text
    bool tunable = false;              ///< may change while running
    double value = 0.0;                ///< default of a number, with all its digits
  };

  ParameterTable& number(const std::string& key, double* field, const std::string& unit, double low, double high,
                         const std::string& help, bool tunable = false);
  ParameterTable& integer(const std::string& key, int* field, const std::string& unit, int low, int high,
                          const std::string& help);
  ParameterTable& flag(const std::string& key, bool* field, const std::string& help);
  ParameterTable& text(const std::string& key, std::string* field, const std::vector<std::string>& choices,
                       const std::string& help);
  /// Numbers, each within the range; `size` elements, any number of them if 0.
  ParameterTable& list(const std::string& key, std::vector<double>* field, std::size_t size, const std::string& unit,
                       double low, double high, const std::string& help);
  ParameterTable& names(const std::string& key, std::vector<std::string>* field,
                        const std::vector<std::string>& choices, const std::string& help);

  /// Checks all values, then assigns all of them; on any error assigns none and throws ParameterError naming `where`
  /// and, per error, key, value, unit, range and, for an unknown key, the closest known one. Keys not given keep their
  /// value.
  void assign(const std::string& where, const std::map<std::string, ParameterValue>& values);

  const std::vector<Entry>& entries() const { return entries_; }
  /// The part of it that may change while running.
  ParameterTable tunable() const;
  /// The entries as a Markdown table.
  std::string markdown() const;

private:
  using Setter = std::function<std::string(const ParameterValue&, bool commit)>;
  void add(Entry entry, Setter setter);
  std::vector<Entry> entries_;
  std::vector<Setter> setters_;
};
}  // namespace phri_core
