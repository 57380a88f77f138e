#include "model_json.hpp"

#include <fcntl.h>
#include <openssl/sha.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <limits>

namespace phri_learning
{
namespace
{
constexpr std::size_t kLargestFile = 64u << 20;  // [bytes]

std::string checksum(const Json& model)
{
  const std::string text = model.dump();
  unsigned char digest[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest);
  std::string hex;
  for (const unsigned char byte : digest)
  {
    char two[3];
    std::snprintf(two, sizeof(two), "%02x", byte);
    hex += two;
  }
  return hex;
}

std::string readAll(const std::string& path)
{
  std::ifstream stream(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = stream ? static_cast<std::streamoff>(stream.tellg()) : -1;
  if (size < 0)
    throw ModelFileError(path, "not readable", "a readable file", std::strerror(errno));
  if (static_cast<std::size_t>(size) > kLargestFile)
    throw ModelFileError(path, "too large", "at most " + std::to_string(kLargestFile) + " bytes",
                         std::to_string(size) + " bytes");
  std::string text(static_cast<std::size_t>(size), '\0');
  stream.seekg(0);
  stream.read(text.data(), size);
  if (stream.gcount() != size)
    throw ModelFileError(path, "not readable", std::to_string(size) + " bytes",
                         std::to_string(stream.gcount()) + " bytes");
  return text;
}
}  // namespace

Json rows(const Eigen::MatrixXd& matrix)
{
  Json result = Json::array();
  for (Eigen::Index i = 0; i < matrix.rows(); ++i)
  {
    Json row = Json::array();
    for (Eigen::Index j = 0; j < matrix.cols(); ++j)
      row.push_back(matrix(i, j));
    result.push_back(std::move(row));
  }
  return result;
}

Json values(const Eigen::VectorXd& vector)
{
  return Json(std::vector<double>(vector.data(), vector.data() + vector.size()));
}

void Reader::fail(const std::string& key, const std::string& expected, const std::string& found) const
{
  throw ModelFileError(file_, "field " + key, expected, found);
}

const Json& Reader::field(const std::string& key) const
{
  const auto found = model_.find(key);
  if (found == model_.end())
    fail(key, "present", "missing");
  return *found;
}

double Reader::number(const std::string& key, const Json& value) const
{
  if (!value.is_number())
    fail(key, "a finite number", value.is_null() ? "null (not a number)" : value.type_name());
  return value.get<double>();
}

std::string Reader::text(const std::string& key) const
{
  const Json& value = field(key);
  if (!value.is_string())
    fail(key, "text", value.type_name());
  return value.get<std::string>();
}

Eigen::VectorXd Reader::vector(const std::string& key, const Json& value) const
{
  if (!value.is_array())
    fail(key, "a list of numbers", value.type_name());
  Eigen::VectorXd result(static_cast<Eigen::Index>(value.size()));
  for (std::size_t i = 0; i < value.size(); ++i)
    result(static_cast<Eigen::Index>(i)) = number(key, value[i]);
  return result;
}

Eigen::MatrixXd Reader::matrix(const std::string& key, const Json& value) const
{
  if (!value.is_array() || value.empty())
    fail(key, "a list of rows", value.is_array() ? "an empty list" : value.type_name());
  const Eigen::VectorXd first = vector(key, value[0]);
  Eigen::MatrixXd result(static_cast<Eigen::Index>(value.size()), first.size());
  for (std::size_t i = 0; i < value.size(); ++i)
  {
    const Eigen::VectorXd row = vector(key, value[i]);
    if (row.size() != first.size())
      fail(key, "rows of " + std::to_string(first.size()), "a row of " + std::to_string(row.size()));
    result.row(static_cast<Eigen::Index>(i)) = row;
  }
  return result;
}

int Reader::integer(const std::string& key) const
{
  const Json& value = field(key);
  if (!value.is_number_integer() || value.get<std::int64_t>() > std::numeric_limits<int>::max() ||
      value.get<std::int64_t>() < std::numeric_limits<int>::min())
    fail(key, "an integer", value.dump());
  return value.get<int>();
}

std::vector<int> Reader::integers(const std::string& key) const
{
  std::vector<int> result;
  for (const Json& value : list(key))
  {
    if (!value.is_number_integer())
      fail(key, "integers", value.dump());
    result.push_back(value.get<int>());
  }
  return result;
}

const Json& Reader::list(const std::string& key) const
{
  const Json& value = field(key);
  if (!value.is_array())
    fail(key, "a list", value.type_name());
  return value;
}

const Json& Reader::object(const std::string& key) const
{
  const Json& value = field(key);
  if (!value.is_object())
    fail(key, "an object", value.type_name());
  return value;
}

Json toJson(const TimeHmm& model)
{
  const TimeHmmParameters& p = model.parameters();
  Json ss = Json::array();
  for (const Eigen::MatrixXd& covariance : p.ss)
    ss.push_back(rows(covariance));
  return Json{ { "formulas", model.formulas() == Formulas::kThesis ? "thesis" : "corrected" },
               { "dt", p.dt },
               { "transition", rows(p.transition) },
               { "initial", values(p.initial) },
               { "weights", rows(p.weights) },
               { "mean_s", rows(p.mean_s) },
               { "ss", std::move(ss) },
               { "mean_t", values(p.mean_t) },
               { "tt", values(p.tt) },
               { "ts", rows(p.ts) },
               { "between_tt", values(p.between_tt) },
               { "scale", values(p.scale) },
               { "covariance_floor", p.covariance_floor },
               { "repeat_variance", p.repeat_variance },
               { "pace_variance", p.pace_variance },
               { "memory", values(p.memory) } };
}

TimeHmm timeHmmFromJson(const std::string& file, const Json& model)
{
  const Reader read(file, model);
  const std::string formulas = read.text("formulas");
  if (formulas != "corrected" && formulas != "thesis")
    read.fail("formulas", "corrected or thesis", formulas);
  TimeHmmParameters p;
  p.dt = read.number("dt");
  p.transition = read.matrix("transition");
  p.initial = read.vector("initial");
  p.weights = read.matrix("weights");
  p.mean_s = read.matrix("mean_s");
  const Json& ss = read.field("ss");
  if (!ss.is_array())
    read.fail("ss", "a list of matrices", ss.type_name());
  for (const Json& covariance : ss)
    p.ss.push_back(read.matrix("ss", covariance));
  p.mean_t = read.vector("mean_t");
  p.tt = read.vector("tt");
  p.ts = read.matrix("ts");
  p.between_tt = read.vector("between_tt");
  p.scale = read.vector("scale");
  p.covariance_floor = read.number("covariance_floor");
  p.repeat_variance = read.number("repeat_variance");
  p.pace_variance = read.number("pace_variance");
  p.memory = read.vector("memory");
  try
  {
    return TimeHmm(std::move(p), formulas == "thesis" ? Formulas::kThesis : Formulas::kCorrected);
  }
  catch (const std::invalid_argument& error)
  {
    throw ModelFileError(file, "contents", "a valid model", error.what());
  }
}

void writeDocument(const Json& contents, const char* schema, int version, const std::string& path)
{
  const Json document = {
    { "schema", schema }, { "schema_version", version }, { "sha256", checksum(contents) }, { "model", contents }
  };
  const std::string text = document.dump(1) + "\n";
  std::string temporary = path + ".XXXXXX";
  const int descriptor = mkstemp(temporary.data());
  bool good = descriptor >= 0;
  for (std::size_t done = 0; good && done < text.size();)
  {
    const ssize_t count = write(descriptor, text.data() + done, text.size() - done);
    good = count > 0 || (count < 0 && errno == EINTR);
    done += static_cast<std::size_t>(std::max<ssize_t>(count, 0));
  }
  good = good && fchmod(descriptor, 0644) == 0 && fsync(descriptor) == 0;
  if (descriptor >= 0)
    good = close(descriptor) == 0 && good;
  if (!good || std::rename(temporary.c_str(), path.c_str()) != 0)
  {
    const std::string reason = std::strerror(errno);
    if (descriptor >= 0)
      unlink(temporary.c_str());
    throw ModelFileError(path, "not writable", "a writable place for " + std::to_string(text.size()) + " bytes",
                         reason);
  }
}

Json readDocument(const std::string& path, const char* schema, int version)
{
  Json document;
  try
  {
    document = Json::parse(readAll(path));
  }
  catch (const Json::exception& error)
  {
    throw ModelFileError(path, "no JSON, or truncated", "one complete JSON object", error.what());
  }
  const auto text = [&](const char* key) {
    const auto found = document.is_object() ? document.find(key) : document.end();
    return found == document.end() ? std::string("missing") : found->dump();
  };
  if (text("schema") != Json(schema).dump())
    throw ModelFileError(path, "schema", schema, text("schema"));
  if (text("schema_version") != std::to_string(version))
    throw ModelFileError(path, "schema_version", std::to_string(version), text("schema_version"));
  const auto model = document.find("model");
  if (model == document.end() || !model->is_object())
    throw ModelFileError(path, "model", "an object", model == document.end() ? "missing" : model->type_name());
  const std::string sum = checksum(*model);
  if (text("sha256") != Json(sum).dump())
    throw ModelFileError(path, "sha256", sum, text("sha256"));
  return *model;
}
}  // namespace phri_learning
