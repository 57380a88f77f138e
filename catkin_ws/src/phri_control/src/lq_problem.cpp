#include "phri_control/lq_problem.hpp"

#include <Eigen/Eigenvalues>

namespace phri_control
{
namespace detail
{
void requireSymmetric(const std::string& name, const Eigen::Ref<const Eigen::MatrixXd>& value, Eigen::Index size)
{
  constexpr double kAsymmetry = 1e-9;  // of the largest element: rounding of a product, not a mistake
  phri_core::requireShape(name, value, size, size);
  phri_core::requireFinite(name, value);
  const double difference = (value - value.transpose()).cwiseAbs().maxCoeff();
  if (difference > kAsymmetry * value.cwiseAbs().maxCoeff())
    throw std::invalid_argument(name + " is not symmetric: it differs from its transpose by " +
                                std::to_string(difference) + ", expected at most 1e-9 of its largest element");
}

void requireNoise(const NoiseSource& source, Eigen::Index state_size, std::size_t horizon)
{
  const std::string name = "noise \"" + source.name + "\"";
  if (source.factor.size() != 1 && source.factor.size() != horizon)
    throw std::invalid_argument(name + " has " + std::to_string(source.factor.size()) + " factors, expected 1 or " +
                                std::to_string(horizon) + " (one per stage)");
  for (const Eigen::MatrixXd& factor : source.factor)
  {
    phri_core::requireShape(name + ".factor", factor, state_size, factor.cols());
    phri_core::requireFinite(name + ".factor", factor);
  }
}
}  // namespace detail

NoiseSource NoiseSource::fromCovariance(const std::string& name, const std::vector<Eigen::MatrixXd>& covariance)
{
  NoiseSource source{ name, {} };
  for (const Eigen::MatrixXd& value : covariance)
  {
    phri_core::requireCovariance("noise \"" + name + "\".covariance", value);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(value);
    source.factor.push_back(solver.eigenvectors() * solver.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal());
  }
  return source;
}

NoiseSource NoiseSource::fromCovariance(const std::string& name, const Eigen::MatrixXd& covariance)
{
  return fromCovariance(name, std::vector<Eigen::MatrixXd>{ covariance });
}

NoiseSource NoiseSource::fromFactor(const std::string& name, std::vector<Eigen::MatrixXd> factor)
{
  for (const Eigen::MatrixXd& value : factor)
    phri_core::requireFinite("noise \"" + name + "\".factor", value);
  return { name, std::move(factor) };
}

NoiseSource NoiseSource::fromFactor(const std::string& name, const Eigen::MatrixXd& factor)
{
  return fromFactor(name, std::vector<Eigen::MatrixXd>{ factor });
}
}  // namespace phri_control
