#include <gtest/gtest.h>

#include "phri_core/check.hpp"
#include "phri_core/gaussian.hpp"

using namespace phri_core;

// S^-1/2 S S^-1/2 = I for a positive definite S and no floor; the floor bounds the weight of a singular direction.
TEST(Gaussian, InverseSquareRoot)
{
  Eigen::Matrix2d s;
  s << 4e-5, 1e-5, 1e-5, 9e-5;
  const Eigen::MatrixXd root = inverseSquareRoot(s, 0.0);
  EXPECT_LT((root * s * root - Eigen::Matrix2d::Identity()).norm(), 1e-12);
  const Eigen::MatrixXd floored = inverseSquareRoot(Eigen::Vector2d(1.0, 0.0).asDiagonal(), 1e-8);
  EXPECT_NEAR(floored(1, 1), 1e4, 1e-6);
}

TEST(Check, MessagesNameCauseValueAndRange)
{
  try
  {
    requireRange("mass", -5.0, 0.1, 500.0, "kg");
    FAIL();
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ(error.what(), "mass = -5 kg: expected a number from 0.1 to 500");
  }
  Eigen::Matrix2d indefinite;
  indefinite << 1, 2, 2, 1;
  EXPECT_THROW(requireCovariance("S", indefinite), std::invalid_argument);
  EXPECT_THROW(requireCovariance("S", Eigen::MatrixXd(2, 3)), std::invalid_argument);
  EXPECT_NO_THROW(requireCovariance("S", Eigen::Matrix2d::Zero()));
  EXPECT_EQ(closest("mas", { "mass", "damping" }), "mass");
  EXPECT_EQ(closest("zzzzzz", { "mass", "damping" }), "");
}
