#pragma once
/// Set-up checks: every function here throws std::invalid_argument with the name, the value, its unit and the expected
/// range. They are for constructors and configuration only, never for the tick.

#include <Eigen/Core>
#include <string>
#include <vector>

namespace phri_core
{
/// Throws unless `low <= value <= high` (NaN fails). `unit` may be empty.
void requireRange(const std::string& name, double value, double low, double high, const std::string& unit);

/// Throws unless every element of `value` is finite; the message names the first offending element.
void requireFinite(const std::string& name, const Eigen::Ref<const Eigen::MatrixXd>& value);

/// Throws unless `value` is `rows` x `cols`.
void requireShape(const std::string& name, const Eigen::Ref<const Eigen::MatrixXd>& value, Eigen::Index rows,
                  Eigen::Index cols);

/// Throws unless `value` is square, finite, symmetric to 1e-9 of its largest element and has no eigenvalue below
/// `min_eigenvalue` (minus 1e-9 of the largest). The message names the smallest eigenvalue.
void requireCovariance(const std::string& name, const Eigen::MatrixXd& value, double min_eigenvalue = 0.0);

/// The candidate closest to `key` by edit distance, or an empty string when none is close enough to be a typing error.
std::string closest(const std::string& key, const std::vector<std::string>& candidates);
}  // namespace phri_core
