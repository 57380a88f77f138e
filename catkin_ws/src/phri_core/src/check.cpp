#include "phri_core/check.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>
#include <stdexcept>

namespace phri_core
{
namespace
{
std::size_t editDistance(const std::string& a, const std::string& b)
{
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 1; i <= a.size(); ++i)
  {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j)
    {
      const std::size_t substituted = diagonal + (a[i - 1] != b[j - 1]);
      diagonal = row[j];
      row[j] = std::min({ row[j] + 1, row[j - 1] + 1, substituted });
    }
  }
  return row[b.size()];
}
}  // namespace

void requireRange(const std::string& name, double value, double low, double high, const std::string& unit)
{
  if (value >= low && value <= high)
    return;
  std::ostringstream text;
  text << name << " = " << value << (unit.empty() ? "" : " " + unit) << ": expected a number from " << low << " to "
       << high;
  throw std::invalid_argument(text.str());
}

void requireFinite(const std::string& name, const Eigen::Ref<const Eigen::MatrixXd>& value)
{
  for (Eigen::Index column = 0; column < value.cols(); ++column)
    for (Eigen::Index row = 0; row < value.rows(); ++row)
      if (!std::isfinite(value(row, column)))
      {
        std::ostringstream text;
        text << name << '(' << row << ", " << column << ") = " << value(row, column) << ": expected a finite number";
        throw std::invalid_argument(text.str());
      }
}

void requireShape(const std::string& name, const Eigen::Ref<const Eigen::MatrixXd>& value, Eigen::Index rows,
                  Eigen::Index cols)
{
  if (value.rows() == rows && value.cols() == cols)
    return;
  std::ostringstream text;
  text << name << " has shape (" << value.rows() << ", " << value.cols() << "): expected (" << rows << ", " << cols
       << ')';
  throw std::invalid_argument(text.str());
}

void requireCovariance(const std::string& name, const Eigen::MatrixXd& value, double min_eigenvalue)
{
  requireShape(name, value, value.rows(), value.rows());
  requireFinite(name, value);
  if (value.rows() == 0)
    return;
  const double scale = value.cwiseAbs().maxCoeff();
  if ((value - value.transpose()).cwiseAbs().maxCoeff() > 1e-9 * scale)
    throw std::invalid_argument(name + " is not symmetric: expected a covariance matrix");
  const double smallest =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(value, Eigen::EigenvaluesOnly).eigenvalues().minCoeff();
  if (smallest >= min_eigenvalue - 1e-9 * scale)
    return;
  std::ostringstream text;
  text << name << " has the eigenvalue " << smallest << ": expected none below " << min_eigenvalue;
  throw std::invalid_argument(text.str());
}

std::string closest(const std::string& key, const std::vector<std::string>& candidates)
{
  std::string best;
  std::size_t best_distance = std::max<std::size_t>(2, key.size() / 3) + 1;
  for (const std::string& candidate : candidates)
  {
    const std::size_t distance = editDistance(key, candidate);
    if (distance < best_distance)
    {
      best_distance = distance;
      best = candidate;
    }
  }
  return best;
}
}  // namespace phri_core
