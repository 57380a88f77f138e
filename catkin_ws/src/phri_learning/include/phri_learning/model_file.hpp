#pragma once
/// Models on disk: JSON {"schema", "schema_version", "sha256", "model"}. The checksum covers the compact text of
/// "model" with sorted keys and shortest round-trip numbers, so white space and key order do not matter but every value
/// does; doubles come back bit by bit.

#include <stdexcept>
#include <string>

#include "phri_learning/time_hmm.hpp"

namespace phri_learning
{
/// A model file that cannot be written, read or trusted. One line: E_MODEL_FILE file=... cause=... expected=...
/// found=...
class ModelFileError : public std::runtime_error
{
public:
  ModelFileError(const std::string& file, const std::string& cause, const std::string& expected,
                 const std::string& found);
  std::string file, cause, expected, found;
};

/// Writes beside the target and renames, so that a reader sees the old file or the new one, never a part.
void saveTimeHmm(const TimeHmm& model, const std::string& path);

/// The whole model or a ModelFileError: not readable, larger than 64 MB, no JSON (truncated), another schema or
/// version, wrong checksum, or contents that TimeHmm refuses (shapes, not a number, not positive definite). `dimension`
/// > 0 also requires that many spatial dimensions.
TimeHmm loadTimeHmm(const std::string& path, int dimension = 0);
}  // namespace phri_learning
