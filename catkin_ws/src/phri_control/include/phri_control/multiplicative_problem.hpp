#pragma once
/// The linear-quadratic problem of lq_problem.hpp with noise that grows with the state and the control, as a value:
///
///   xi+ = A xi + B u + d + eps + sum_j (C_j xi + D_j u + e_j) w_j,      w_j ~ N(0, 1), all independent
///
/// C_j (n, n), D_j (n, m), e_j (n), per sample; eps are the additive sources of `lq`, which are counted first. Channels
/// of one source act together; see multiplicative_noise.hpp for what sources mean to an attitude. Motor noise whose
/// standard deviation is the fraction f of u_i has one channel per control, with D = f B e_i e_i'.

#include <Eigen/Core>
#include <stdexcept>
#include <string>
#include <vector>

#include "phri_control/lq_problem.hpp"

namespace phri_control
{
struct NoiseChannel
{
  std::vector<Eigen::MatrixXd> map;  ///< [C D e] (n, n + m + 1): one for all stages, or one per stage

  const Eigen::MatrixXd& at(std::size_t k) const { return map.size() == 1 ? map.front() : map[k]; }

  /// C (n, n), D (n, m), e (n). Throws std::invalid_argument unless the rows agree.
  static NoiseChannel fromMatrices(const Eigen::MatrixXd& C, const Eigen::MatrixXd& D, const Eigen::VectorXd& e);
};

struct MultiplicativeSource
{
  std::string name;
  std::vector<NoiseChannel> channels;
};

template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct MultiplicativeNoiseProblem
{
  LinearQuadraticProblem<N, M> lq;  ///< with its additive sources
  std::vector<MultiplicativeSource> noise;

  std::size_t sources() const { return lq.noise.size() + noise.size(); }
};

/// Where variance and risk are expanded, one point (xi, u) per stage; empty: at 0, the nominal of the deviations.
template <int N = Eigen::Dynamic, int M = Eigen::Dynamic>
struct ExpansionPoints
{
  std::vector<Eigen::Matrix<double, N, 1>> states;
  std::vector<Eigen::Matrix<double, M, 1>> controls;
};

/// Gain of the infinite horizon for the expected cost, constant A, B, Q, R, C_j, D_j (e_j and linear terms do not
/// change it): the limit of the recursion from W = 0. Beyond a noise level no gain keeps E |xi|^2 finite ("uncertainty
/// threshold"): the recursion then has no limit.
struct MeanSquareGain
{
  enum class Status
  {
    Converged,
    NotStabilisable,  ///< W grows without bound: some X >= 0 has min_L (A + BL)'X(A + BL) + noise >= X
    IterationLimit    ///< undecided: too close to the threshold for the number of iterations
  };
  Eigen::MatrixXd gain;  ///< L (m, n); empty unless converged
  Eigen::MatrixXd W;     ///< the last one
  Status status = Status::IterationLimit;
  int iterations = 0;

  explicit operator bool() const { return status == Status::Converged; }
};

/// Looks at the first stage and the first map of every channel. Throws std::invalid_argument (see `validate`) and
/// unless Q is positive semi-definite and R positive definite.
MeanSquareGain meanSquareGain(const MultiplicativeNoiseProblem<>& problem, double tolerance = 1e-13,
                              int max_iterations = 100000);

namespace detail
{
void requireChannels(const MultiplicativeSource& source, Eigen::Index n, Eigen::Index m, std::size_t horizon);
}  // namespace detail

/// Throws std::invalid_argument naming what does not fit.
template <int N, int M>
void validate(const MultiplicativeNoiseProblem<N, M>& problem, const ExpansionPoints<N, M>& points = {})
{
  validate(problem.lq);
  const Eigen::Index n = problem.lq.stateSize(), m = problem.lq.controlSize();
  const std::size_t horizon = problem.lq.horizon();
  for (const MultiplicativeSource& source : problem.noise)
    detail::requireChannels(source, n, m, horizon);
  if (points.states.size() != points.controls.size() || (!points.states.empty() && points.states.size() != horizon))
    throw std::invalid_argument("ExpansionPoints: " + std::to_string(points.states.size()) + " states and " +
                                std::to_string(points.controls.size()) + " controls, expected none or " +
                                std::to_string(horizon) + " of each (one per stage)");
  for (std::size_t k = 0; k < points.states.size(); ++k)
  {
    const std::string index = "[" + std::to_string(k) + "]";
    phri_core::requireShape("ExpansionPoints.states" + index, points.states[k], n, 1);
    phri_core::requireShape("ExpansionPoints.controls" + index, points.controls[k], m, 1);
    phri_core::requireFinite("ExpansionPoints.states" + index, points.states[k]);
    phri_core::requireFinite("ExpansionPoints.controls" + index, points.controls[k]);
  }
}
}  // namespace phri_control
