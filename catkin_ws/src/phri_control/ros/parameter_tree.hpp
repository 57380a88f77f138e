#pragma once
#include <xmlrpcpp/XmlRpcValue.h>

#include <map>
#include <string>
#include <vector>

#include "phri_core/parameters.hpp"

namespace phri_control
{
using ParameterMap = std::map<std::string, phri_core::ParameterValue>;

namespace detail
{
using XmlRpc::XmlRpcValue;

/// False for what is not a number.
inline bool number(XmlRpcValue& value, double& out)
{
  if (value.getType() == XmlRpcValue::TypeInt)
    out = int(value);
  else if (value.getType() == XmlRpcValue::TypeDouble)
    out = double(value);
  else
    return false;
  return true;
}

inline void flattenInto(XmlRpcValue& value, const std::string& key, ParameterMap& out, std::vector<std::string>& errors)
{
  double scalar = 0.0;
  if (value.getType() == XmlRpcValue::TypeStruct)
  {
    for (auto& member : value)
      flattenInto(member.second, key.empty() ? member.first : key + '/' + member.first, out, errors);
  }
  else if (value.getType() == XmlRpcValue::TypeBoolean)
    out[key] = bool(value);
  else if (value.getType() == XmlRpcValue::TypeString)
    out[key] = std::string(value);
  else if (number(value, scalar))
    out[key] = scalar;
  else if (value.getType() == XmlRpcValue::TypeArray)
  {
    std::vector<double> numbers;
    for (int i = 0; i < value.size(); ++i)
      if (number(value[i], scalar))
        numbers.push_back(scalar);
    if (int(numbers.size()) == value.size())
      out[key] = numbers;
    else
      errors.push_back(key + ": expected a list of numbers");
  }
  else
    errors.push_back(key + ": expected a number, a flag, a text or a list of numbers");
}
}  // namespace detail

/// A tree of ROS parameters as a flat map, keys joined by '/'; integers become numbers. Appends what it cannot take to
/// `errors`.
inline ParameterMap flatten(XmlRpc::XmlRpcValue tree, std::vector<std::string>& errors)
{
  ParameterMap out;
  if (tree.getType() == XmlRpc::XmlRpcValue::TypeStruct)
    detail::flattenInto(tree, "", out, errors);
  return out;
}
}  // namespace phri_control
