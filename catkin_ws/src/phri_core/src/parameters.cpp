#include "phri_core/parameters.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "phri_core/check.hpp"

namespace phri_core
{
namespace
{
std::string join(const std::vector<std::string>& parts, const std::string& separator)
{
  std::string text;
  for (const std::string& part : parts)
    text += (text.empty() ? "" : separator) + part;
  return text;
}

std::string show(double value)
{
  std::ostringstream text;
  text << value;
  return text.str();
}

std::string show(const ParameterValue& value)
{
  if (const auto* flag = std::get_if<bool>(&value))
    return *flag ? "true" : "false";
  if (const auto* number = std::get_if<double>(&value))
    return show(*number);
  if (const auto* text = std::get_if<std::string>(&value))
    return '"' + *text + '"';
  std::vector<std::string> parts;
  if (const auto* list = std::get_if<std::vector<double>>(&value))
    for (const double number : *list)
      parts.push_back(show(number));
  if (const auto* list = std::get_if<std::vector<std::string>>(&value))
    parts = *list;
  return '[' + join(parts, ", ") + ']';
}

std::string numberFault(double value, const std::string& unit, double low, double high)
{
  if (value >= low && value <= high)
    return "";
  return show(value) + (unit.empty() ? "" : " " + unit) + ": expected a number from " + show(low) + " to " + show(high);
}

std::string choiceFault(const std::string& value, const std::vector<std::string>& choices)
{
  if (choices.empty() || std::find(choices.begin(), choices.end(), value) != choices.end())
    return "";
  const std::string meant = closest(value, choices);
  return '"' + value + "\": expected one of " + join(choices, ", ") +
         (meant.empty() ? "" : "; did you mean " + meant + '?');
}
}  // namespace

ParameterError::ParameterError(const std::string& where, std::vector<std::string> errors)
  : std::invalid_argument(where + ": " + std::to_string(errors.size()) + " error" + (errors.size() == 1 ? "" : "s") +
                          "\n  " + join(errors, "\n  ")),
    errors_(std::move(errors))
{
}

void ParameterTable::add(Entry entry, Setter setter)
{
  entries_.push_back(std::move(entry));
  setters_.push_back(std::move(setter));
}

ParameterTable& ParameterTable::number(const std::string& key, double* field, const std::string& unit, double low,
                                       double high, const std::string& help, bool tunable)
{
  add({ key, unit, help, low, high, {}, "number", show(*field), tunable, *field },
      [=](const ParameterValue& value, bool commit) -> std::string {
        const auto* given = std::get_if<double>(&value);
        if (!given)
          return show(value) + ": expected a number" + (unit.empty() ? "" : " [" + unit + "]") + " from " + show(low) +
                 " to " + show(high);
        if (commit)
          *field = *given;
        return numberFault(*given, unit, low, high);
      });
  return *this;
}

ParameterTable& ParameterTable::integer(const std::string& key, int* field, const std::string& unit, int low, int high,
                                        const std::string& help)
{
  add({ key, unit, help, double(low), double(high), {}, "integer", std::to_string(*field), false },
      [=](const ParameterValue& value, bool commit) -> std::string {
        const auto* given = std::get_if<double>(&value);
        if (!given || *given != std::floor(*given))
          return show(value) + ": expected a whole number from " + show(low) + " to " + show(high);
        const std::string fault = numberFault(*given, unit, low, high);
        if (commit && fault.empty())
          *field = static_cast<int>(*given);
        return fault;
      });
  return *this;
}

ParameterTable& ParameterTable::flag(const std::string& key, bool* field, const std::string& help)
{
  add({ key, "", help, 0.0, 0.0, {}, "flag", *field ? "true" : "false", false },
      [=](const ParameterValue& value, bool commit) -> std::string {
        const auto* given = std::get_if<bool>(&value);
        if (!given)
          return show(value) + ": expected true or false";
        if (commit)
          *field = *given;
        return "";
      });
  return *this;
}

ParameterTable& ParameterTable::text(const std::string& key, std::string* field,
                                     const std::vector<std::string>& choices, const std::string& help)
{
  add({ key, "", help, 0.0, 0.0, choices, "text", *field, false },
      [=](const ParameterValue& value, bool commit) -> std::string {
        const auto* given = std::get_if<std::string>(&value);
        if (!given)
          return show(value) + ": expected a text" + (choices.empty() ? "" : ", one of " + join(choices, ", "));
        if (commit)
          *field = *given;
        return choiceFault(*given, choices);
      });
  return *this;
}

ParameterTable& ParameterTable::list(const std::string& key, std::vector<double>* field, std::size_t size,
                                     const std::string& unit, double low, double high, const std::string& help)
{
  add({ key, unit, help, low, high, {}, "list", show(ParameterValue(*field)), false },
      [=](const ParameterValue& value, bool commit) -> std::string {
        const auto* given = std::get_if<std::vector<double>>(&value);
        if (!given || (size != 0 && given->size() != size))
          return show(value) + ": expected a list of " + (size ? std::to_string(size) + " " : "") + "numbers [" + unit +
                 "] from " + show(low) + " to " + show(high);
        for (const double number : *given)
        {
          const std::string fault = numberFault(number, unit, low, high);
          if (!fault.empty())
            return fault;
        }
        if (commit)
          *field = *given;
        return "";
      });
  return *this;
}

ParameterTable& ParameterTable::names(const std::string& key, std::vector<std::string>* field,
                                      const std::vector<std::string>& choices, const std::string& help)
{
  add({ key, "", help, 0.0, 0.0, choices, "names", show(ParameterValue(*field)), false },
      [=](const ParameterValue& value, bool commit) -> std::string {
        const auto* given = std::get_if<std::vector<std::string>>(&value);
        if (!given)
          return show(value) + ": expected a list of names" + (choices.empty() ? "" : " out of " + join(choices, ", "));
        for (const std::string& name : *given)
        {
          const std::string fault = choiceFault(name, choices);
          if (!fault.empty())
            return fault;
        }
        if (commit)
          *field = *given;
        return "";
      });
  return *this;
}

ParameterTable ParameterTable::tunable() const
{
  ParameterTable part;
  for (std::size_t i = 0; i < entries_.size(); ++i)
    if (entries_[i].tunable)
      part.add(entries_[i], setters_[i]);
  return part;
}

void ParameterTable::assign(const std::string& where, const std::map<std::string, ParameterValue>& values)
{
  std::vector<std::string> errors, keys;
  for (const Entry& entry : entries_)
    keys.push_back(entry.key);
  for (const bool commit : { false, true })
  {
    for (const auto& [key, value] : values)
    {
      const auto found = std::find(keys.begin(), keys.end(), key);
      if (found == keys.end())
      {
        const std::string meant = closest(key, keys);
        errors.push_back(key + " = " + show(value) + ": unknown key" +
                         (meant.empty() ? "; known: " + join(keys, ", ") : "; did you mean " + meant + '?'));
        continue;
      }
      const std::string fault = setters_[found - keys.begin()](value, commit);
      if (!fault.empty())
        errors.push_back(key + " = " + fault);
    }
    if (!errors.empty())
      throw ParameterError(where, errors);
  }
}

std::string ParameterTable::markdown() const
{
  std::ostringstream text;
  text << "| key | default | unit | range | meaning |\n|---|---|---|---|---|\n";
  for (const Entry& entry : entries_)
  {
    text << "| `" << entry.key << "` | " << entry.initial << " | " << entry.unit << " | ";
    if (entry.low != entry.high)
      text << entry.low << " to " << entry.high;
    else
      text << join(entry.choices, ", ");
    text << " | " << entry.help << " |\n";
  }
  return text.str();
}
}  // namespace phri_core
