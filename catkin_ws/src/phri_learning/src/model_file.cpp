#include "phri_learning/model_file.hpp"

#include "model_json.hpp"

namespace phri_learning
{
namespace
{
constexpr const char* kSchema = "phri_learning/TimeHmm";
constexpr int kVersion = 1;
}  // namespace

ModelFileError::ModelFileError(const std::string& file, const std::string& cause, const std::string& expected,
                               const std::string& found)
  : std::runtime_error("E_MODEL_FILE file=" + file + " cause=\"" + cause + "\" expected=\"" + expected + "\" found=\"" +
                       found + "\""),
    file(file),
    cause(cause),
    expected(expected),
    found(found)
{
}

void saveTimeHmm(const TimeHmm& model, const std::string& path)
{
  writeDocument(toJson(model), kSchema, kVersion, path);
}

TimeHmm loadTimeHmm(const std::string& path, int dimension)
{
  TimeHmm result = timeHmmFromJson(path, readDocument(path, kSchema, kVersion));
  if (dimension > 0 && result.dimension() != dimension)
    throw ModelFileError(path, "dimension", std::to_string(dimension), std::to_string(result.dimension()));
  return result;
}
}  // namespace phri_learning
