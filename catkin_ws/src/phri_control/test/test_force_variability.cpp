// Moments over a sliding window against a direct calculation, and what a maximum of covariances must be.
#include "phri_control/force_variability.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "phri_core/random.hpp"

namespace phri_control
{
namespace
{
using phri_core::Random;

constexpr double kRounding = 1e-9;  // relative, of a few hundred well-conditioned operations

Eigen::MatrixXd randomMatrix(Random& random, Eigen::Index rows, Eigen::Index cols)
{
  Eigen::MatrixXd matrix(rows, cols);
  for (Eigen::Index i = 0; i < matrix.size(); ++i)
    matrix(i) = random.normal();
  return matrix;
}

double smallestEigenvalue(const Eigen::MatrixXd& matrix)
{
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(matrix).eigenvalues()(0);
}

}  // namespace

TEST(CovarianceMax, IsNotBelowEitherAndNoLargerThanNeeded)
{
  Random random(11);
  for (int trial = 0; trial < 300; ++trial)
  {
    const Eigen::Index n = 1 + trial % 6, rank_a = 1 + trial % n, rank_b = 1 + (trial / 7) % n;
    const Eigen::MatrixXd ea = randomMatrix(random, n, rank_a), eb = randomMatrix(random, n, rank_b);
    const Eigen::MatrixXd a = ea * ea.transpose(), b = eb * eb.transpose();
    const Eigen::MatrixXd larger = covarianceMax(a, b);
    const double scale = (a + b).norm();
    EXPECT_GE(smallestEigenvalue(larger - a), -kRounding * scale);
    EXPECT_GE(smallestEigenvalue(larger - b), -kRounding * scale);
    // d and 1 - d are the shares of the two: max(d, 1 - d) <= 1 gives larger <= a + b
    EXPECT_GE(smallestEigenvalue(a + b - larger), -kRounding * scale);
    EXPECT_LT((larger - covarianceMax(b, a)).norm(), kRounding * scale);
    EXPECT_LT((3.0 * larger - covarianceMax(3.0 * a, 3.0 * b)).norm(), kRounding * scale);
    const Eigen::MatrixXd turned = Eigen::HouseholderQR<Eigen::MatrixXd>(randomMatrix(random, n, n)).householderQ();
    EXPECT_LT((turned * larger * turned.transpose() -
               covarianceMax(turned * a * turned.transpose(), turned * b * turned.transpose()))
                  .norm(),
              kRounding * scale);
    EXPECT_LT((covarianceMax(a, a) - a).norm(), kRounding * scale);
    EXPECT_LT((covarianceMax(a + b, b) - a - b).norm(), kRounding * scale) << "a + b is the larger of the two";
  }
}

TEST(CovarianceMax, IsEntrywiseForDiagonalOnesAndZeroForZero)
{
  const Eigen::Vector3d a(4.0, 0.0, 1.0), b(1.0, 0.0, 9.0), expected(4.0, 0.0, 9.0);
  const Eigen::MatrixXd larger = covarianceMax(a.asDiagonal().toDenseMatrix(), b.asDiagonal().toDenseMatrix());
  EXPECT_LT((larger - expected.asDiagonal().toDenseMatrix()).norm(), kRounding);
  EXPECT_EQ(covarianceMax(MatrixDof::Zero(3, 3), MatrixDof::Zero(3, 3)).norm(), 0.0);
}

TEST(ForceWindow, HasTheMomentsOfADirectCalculation)
{
  constexpr double kDuration = 0.3;
  Random random(12);
  ForceWindow window(3, kDuration, 1e-3);
  std::vector<std::pair<double, Eigen::Vector3d>> history;
  for (int k = 0; k < 2000; ++k)
  {
    const double t = k * 1e-3;
    const Eigen::Vector3d force(random.normal(100.0, 1.0), random.normal(), random.normal(-3.0, 0.1));
    if (random.uniform() < 0.2)
      continue;  // samples that never came
    history.push_back({ t, force });
    ASSERT_TRUE(window.add(t, force));
    if (k % 97)
      continue;
    int count = 0;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    Eigen::Matrix3d second = Eigen::Matrix3d::Zero(), covariance = Eigen::Matrix3d::Zero();
    for (const auto& [at, u] : history)
      if (at > t - kDuration + 1e-7)
        ++count, mean += u, second += u * u.transpose();
    mean /= count;
    for (const auto& [at, u] : history)
      if (at > t - kDuration + 1e-7)
        covariance += (u - mean) * (u - mean).transpose() / count;
    const ForceMoments moments = window.moments(t);
    EXPECT_EQ(moments.count, count);
    EXPECT_LT((moments.mean - mean).norm(), kRounding * mean.norm());
    EXPECT_LT((moments.second_moment - second / count).norm(), kRounding * second.norm() / count);
    EXPECT_LE((moments.covariance - covariance).norm(), kRounding * covariance.norm());
  }
}

TEST(ForceWindow, ForgetsRefusesAndIsEmptyAtFirst)
{
  ForceWindow window(1, 0.1, 0.01);
  EXPECT_EQ(window.moments(0.0).count, 0);
  EXPECT_EQ(window.moments(0.0).second_moment.norm(), 0.0);
  EXPECT_TRUE(window.add(1.0, Eigen::VectorXd::Constant(1, 2.0)));
  EXPECT_FALSE(window.add(1.0, Eigen::VectorXd::Constant(1, 2.0))) << "time does not increase";
  EXPECT_FALSE(window.add(1.1, Eigen::VectorXd::Constant(2, 2.0))) << "wrong size";
  EXPECT_FALSE(window.add(1.1, Eigen::VectorXd::Constant(1, std::nan(""))));
  EXPECT_EQ(window.moments(1.09).count, 1);
  EXPECT_EQ(window.moments(1.1).count, 0) << "as old as the window is long";
  window.clear();
  EXPECT_EQ(window.moments(1.0).count, 0);
  EXPECT_TRUE(window.add(0.5, Eigen::VectorXd::Constant(1, 2.0))) << "a cleared window starts anew, at any time";
  EXPECT_THROW(ForceWindow(0, 0.3, 1e-3), std::invalid_argument);
  EXPECT_THROW(ForceWindow(3, 0.3, 0.4), std::invalid_argument);
}

}  // namespace phri_control
