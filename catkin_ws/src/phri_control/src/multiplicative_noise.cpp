#include "phri_control/multiplicative_noise.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>

namespace phri_control
{
namespace
{
using Eigen::MatrixXd;

/// W through the dynamics and the channels: E x+'W x+ as a quadratic form of (xi, u), which has no cost.
MatrixXd spread(const MatrixXd& W, const MatrixXd& joint, const std::vector<MatrixXd>& channels)
{
  MatrixXd H = joint.transpose() * W * joint;
  for (const MatrixXd& G : channels)
    H += G.transpose() * W * G;
  return H;
}

/// True if no gain shrinks W: min_L of the form above, minus W, is positive semi-definite. The recursion from such a W
/// never comes down again.
bool neverShrinks(const MatrixXd& H, const MatrixXd& W)
{
  const Eigen::Index n = W.rows(), m = H.rows() - n;
  const MatrixXd Huu = H.bottomRightCorner(m, m), Hux = H.bottomLeftCorner(m, n);
  const Eigen::CompleteOrthogonalDecomposition<MatrixXd> inverse(Huu);
  const MatrixXd change = H.topLeftCorner(n, n) - Hux.transpose() * inverse.solve(Hux) - W;
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(0.5 * (change + change.transpose()), Eigen::EigenvaluesOnly);
  return solver.eigenvalues().minCoeff() >= 0.0;
}
}  // namespace

NoiseChannel NoiseChannel::fromMatrices(const Eigen::MatrixXd& C, const Eigen::MatrixXd& D, const Eigen::VectorXd& e)
{
  phri_core::requireShape("channel D", D, C.rows(), D.cols());
  phri_core::requireShape("channel e", e, C.rows(), 1);
  MatrixXd map(C.rows(), C.cols() + D.cols() + 1);
  map << C, D, e;
  return { { map } };
}

namespace detail
{
void requireChannels(const MultiplicativeSource& source, Eigen::Index n, Eigen::Index m, std::size_t horizon)
{
  const std::string name = "noise \"" + source.name + "\"";
  for (std::size_t j = 0; j < source.channels.size(); ++j)
  {
    const std::vector<MatrixXd>& maps = source.channels[j].map;
    const std::string channel = name + ".channels[" + std::to_string(j) + "].map";
    if (maps.size() != 1 && maps.size() != horizon)
      throw std::invalid_argument(channel + " has " + std::to_string(maps.size()) + " matrices, expected 1 or " +
                                  std::to_string(horizon) + " (one per stage)");
    for (const MatrixXd& map : maps)
    {
      phri_core::requireShape(channel, map, n, n + m + 1);
      phri_core::requireFinite(channel, map);
    }
  }
}

void requireAttitude(const CostCumulants& attitude, std::size_t sources)
{
  if (attitude.gamma.cols() == 0)
    return;
  if (attitude.gamma.cols() > 1)
    throw std::invalid_argument("CostCumulants with K = " + std::to_string(attitude.gamma.cols() + 1) +
                                ", expected K = 2 at most for multiplicative noise: mean and variance");
  if (attitude.gamma.rows() != static_cast<Eigen::Index>(sources))
    throw std::invalid_argument("CostCumulants.gamma has " + std::to_string(attitude.gamma.rows()) +
                                " rows, expected " + std::to_string(sources) + ", one per source of noise");
  phri_core::requireFinite("CostCumulants.gamma", attitude.gamma);
}

void requireAttitude(const RiskSensitive& attitude, std::size_t sources)
{
  const std::size_t count = attitude.theta.size();
  if (count != sources)
    throw std::invalid_argument("RiskSensitive has " + std::to_string(count) + " thetas, expected " +
                                std::to_string(sources) + ", one per source of noise");
  phri_core::requireFinite("RiskSensitive.theta", Eigen::Map<const Eigen::VectorXd>(attitude.theta.data(), count));
}
}  // namespace detail

MeanSquareGain meanSquareGain(const MultiplicativeNoiseProblem<>& problem, double tolerance, int max_iterations)
{
  validate(problem);
  phri_core::requireRange("meanSquareGain: tolerance", tolerance, 0.0, 1.0, "");
  phri_core::requireRange("meanSquareGain: max_iterations", max_iterations, 1.0, 1e9, "stages");
  const LqStage<>& stage = problem.lq.stages.front();
  const Eigen::Index n = stage.A.rows(), m = stage.B.cols();
  const double lowest = Eigen::SelfAdjointEigenSolver<MatrixXd>(stage.Q, Eigen::EigenvaluesOnly).eigenvalues()(0);
  constexpr double kRounding = 1e-12;
  if (lowest < -kRounding * stage.Q.cwiseAbs().maxCoeff())
    throw std::invalid_argument("meanSquareGain: Q has the eigenvalue " + std::to_string(lowest) +
                                ", expected positive semi-definite");
  if (Eigen::LLT<MatrixXd>(stage.R).info() != Eigen::Success)
    throw std::invalid_argument("meanSquareGain: R is not positive definite");

  MatrixXd joint(n, n + m);
  joint << stage.A, stage.B;
  std::vector<MatrixXd> channels;
  for (const MultiplicativeSource& source : problem.noise)
    for (const NoiseChannel& channel : source.channels)
      channels.push_back(channel.at(0).leftCols(n + m));

  MeanSquareGain result;
  result.W.setZero(n, n);
  while (result.iterations < max_iterations)
  {
    ++result.iterations;
    const MatrixXd H = spread(result.W, joint, channels);
    if (!H.allFinite() || (result.W.cwiseAbs().maxCoeff() > 0.0 && neverShrinks(H, result.W)))
    {
      result.status = MeanSquareGain::Status::NotStabilisable;
      return result;
    }
    const MatrixXd Hux = H.bottomLeftCorner(m, n);
    const MatrixXd L = -Eigen::LLT<MatrixXd>(stage.R + H.bottomRightCorner(m, m)).solve(Hux);
    MatrixXd next = stage.Q + H.topLeftCorner(n, n) + Hux.transpose() * L;
    next = (0.5 * (next + next.transpose())).eval();
    const double change = (next - result.W).cwiseAbs().maxCoeff(), size = next.cwiseAbs().maxCoeff();
    result.W = next;
    if (change <= tolerance * size)
    {
      result.status = MeanSquareGain::Status::Converged;
      result.gain = L;
      return result;
    }
  }
  return result;
}
}  // namespace phri_control
