#pragma once
/// E-step and M-step of the left-to-right HMM on SPATIAL emissions only; the times ride along with the
/// responsibilities.

#include <Eigen/Core>
#include <vector>

#include "phri_learning/time_hmm.hpp"

namespace phri_learning
{
/// Sums over all demonstrations e and samples t, weighted by the responsibility g = P(state i, component k | x); row c
/// = i K + k.
struct Expectation
{
  double log_likelihood = 0.0;      ///< sum_e log P(x^e | model)
  Eigen::VectorXd stay, next;       ///< (S) expected number of transitions i -> i and i -> i + 1
  Eigen::VectorXd start;            ///< (S) expected number of demonstrations that start in i
  Eigen::VectorXd n;                ///< (S K) sum g [samples]
  Eigen::VectorXd t;                ///< (S K) sum g t [s], t = 0 at each demonstration's first sample
  Eigen::VectorXd within_tt;        ///< (S K) sum g (t - mu_t^e)^2 with the demonstration's own mean mu_t^e [s^2]
  Eigen::VectorXd demo_tt;          ///< (S K) sum_e n^e (mu_t^e)^2 [s^2]
  Eigen::MatrixXd x, within_tx;     ///< (S K, d) sum g x', sum g (t - mu_t^e) x'
  std::vector<Eigen::MatrixXd> xx;  ///< S K times (d, d), sum g x x'
};

/// How forward-backward is computed; the result differs by rounding only.
enum class Numerics
{
  kAutomatic,  ///< scaled probabilities, and logarithms for a demonstration on which these could lose a path
  kLogarithms  ///< one sample can favour a state by e^1000; several times slower
};

/// Forward-backward over demonstrations (T_e, d), restricted to the two bands of the transition matrix: O(T S d^2).
/// Throws std::invalid_argument for samples of another dimension or not finite.
Expectation expectation(const TimeHmm& model, const std::vector<Eigen::MatrixXd>& demonstrations,
                        Numerics numerics = Numerics::kAutomatic);

/// The spatial M-step: initial, transition, weights, mean_s and ss of `p` from the sums; times stay. `strength` samples
/// of covariance `pooled` (d, d) are the prior of every covariance; without (0), this is Baum-Welch with eigenvalues >=
/// p->covariance_floor and transition probabilities within [1e-6, 1 - 1e-6]. A component that holds nothing keeps what
/// it had; what is 0 in `transition` stays 0.
void maximize(const Expectation& sums, const Eigen::MatrixXd& pooled, double strength, TimeHmmParameters* p);
}  // namespace phri_learning
