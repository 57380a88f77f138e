#pragma once
// Random pieces of linear-quadratic problems with every field in use, from a seeded generator.
#include <Eigen/Core>

#include "phri_control/lq_problem.hpp"
#include "phri_core/random.hpp"

namespace lq_fixtures
{
inline Eigen::MatrixXd randomMatrix(phri_core::Random& random, Eigen::Index rows, Eigen::Index cols)
{
  return Eigen::MatrixXd::NullaryExpr(rows, cols, [&]() { return random.normal(); });
}

inline Eigen::MatrixXd randomDefinite(phri_core::Random& random, Eigen::Index size)
{
  const Eigen::MatrixXd root = randomMatrix(random, size, size);
  return root * root.transpose() / double(size) + 0.1 * Eigen::MatrixXd::Identity(size, size);
}

/// A = keep I + spread N(0, 1), and a drift of this size; everything else of size 1.
template <int N, int M>
phri_control::LqStage<N, M> randomStage(phri_core::Random& random, Eigen::Index n, Eigen::Index m, double keep,
                                        double spread, double drift)
{
  phri_control::LqStage<N, M> stage = phri_control::LqStage<N, M>::zero(n, m);
  stage.A = keep * Eigen::MatrixXd::Identity(n, n) + spread * randomMatrix(random, n, n);
  stage.B = randomMatrix(random, n, m);
  stage.d = drift * randomMatrix(random, n, 1);
  stage.Q = randomDefinite(random, n);
  stage.q = randomMatrix(random, n, 1);
  stage.q0 = random.normal();
  stage.R = randomDefinite(random, m);
  stage.r = randomMatrix(random, m, 1);
  return stage;
}

/// J -> factor J.
template <int N, int M>
void scaleCost(phri_control::LinearQuadraticProblem<N, M>& problem, double factor)
{
  for (phri_control::LqStage<N, M>& stage : problem.stages)
  {
    stage.Q *= factor;
    stage.q *= factor;
    stage.q0 *= factor;
    stage.R *= factor;
    stage.r *= factor;
  }
  problem.terminal.Q *= factor;
  problem.terminal.q *= factor;
  problem.terminal.q0 *= factor;
}

template <int N>
phri_control::LqTerminal<N> randomTerminal(phri_core::Random& random, Eigen::Index n)
{
  phri_control::LqTerminal<N> terminal = phri_control::LqTerminal<N>::zero(n);
  terminal.Q = randomDefinite(random, n);
  terminal.q = randomMatrix(random, n, 1);
  terminal.q0 = random.normal();
  return terminal;
}
}  // namespace lq_fixtures
