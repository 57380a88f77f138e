#pragma once
/// JSON inside this package: what the files of model_file.hpp and primitive_file.cpp share. Not installed.

#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <string>

#include "phri_learning/model_file.hpp"

namespace phri_learning
{
using Json = nlohmann::json;  // objects sort their keys

Json rows(const Eigen::MatrixXd& matrix);
Json values(const Eigen::VectorXd& vector);

/// Reads typed fields of an object and says which one is wrong.
class Reader
{
public:
  Reader(const std::string& file, const Json& model) : file_(file), model_(model) {}

  [[noreturn]] void fail(const std::string& key, const std::string& expected, const std::string& found) const;
  const Json& field(const std::string& key) const;
  double number(const std::string& key, const Json& value) const;
  double number(const std::string& key) const { return number(key, field(key)); }
  std::string text(const std::string& key) const;
  Eigen::VectorXd vector(const std::string& key, const Json& value) const;
  Eigen::VectorXd vector(const std::string& key) const { return vector(key, field(key)); }
  Eigen::MatrixXd matrix(const std::string& key, const Json& value) const;
  Eigen::MatrixXd matrix(const std::string& key) const { return matrix(key, field(key)); }
  int integer(const std::string& key) const;
  std::vector<int> integers(const std::string& key) const;
  const Json& list(const std::string& key) const;
  const Json& object(const std::string& key) const;

private:
  const std::string& file_;
  const Json& model_;
};

Json toJson(const TimeHmm& model);
TimeHmm timeHmmFromJson(const std::string& file, const Json& model);

/// Wraps `contents` with schema, version and checksum and writes the file whole or not at all.
void writeDocument(const Json& contents, const char* schema, int version, const std::string& path);
/// The contents of such a file, or ModelFileError.
Json readDocument(const std::string& path, const char* schema, int version);
}  // namespace phri_learning
