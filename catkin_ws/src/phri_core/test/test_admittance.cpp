#include <gtest/gtest.h>

#include <cmath>

#include "phri_core/admittance.hpp"

using phri_core::Admittance;
using phri_core::VectorDof;

namespace
{
constexpr double kRounding = 1e-12;  // relative: the step is exact, only rounding remains

VectorDof planar(double x, double y)
{
  VectorDof v(2);
  v << x, y;
  return v;
}
}  // namespace

// The step is the exact solution for a constant wrench, so the step size cannot matter: 1000 small ones equal one big
// one.
TEST(Admittance, IsIndependentOfTheStep)
{
  Admittance fine(planar(90, 40), planar(200, 90), 0.001), coarse(planar(90, 40), planar(200, 90), 1.0);
  fine.reset(planar(0.1, -0.1), planar(0.3, 0.2));
  coarse.reset(planar(0.1, -0.1), planar(0.3, 0.2));
  for (int k = 0; k < 1000; ++k)
    fine.step(planar(13, -7));
  coarse.step(planar(13, -7));
  EXPECT_NEAR((fine.position() - coarse.position()).norm(), 0.0, kRounding * 100);
  EXPECT_NEAR((fine.velocity() - coarse.velocity()).norm(), 0.0, kRounding * 100);
}

TEST(Admittance, ClosedForm)
{
  const double m = 90, d = 200, u = 13, t = 0.7, a = std::exp(-d * t / m);
  Admittance admittance(planar(m, m), planar(d, d), t);
  admittance.step(planar(u, 0));
  EXPECT_NEAR(admittance.velocity()(0), u / d * (1 - a), kRounding);
  EXPECT_NEAR(admittance.position()(0), u / d * (t - m / d * (1 - a)), kRounding);
}

// Without damping it is a free mass; the series branch must meet it.
TEST(Admittance, FreeMassLimit)
{
  for (const double d : { 0.0, 1e-9 })
  {
    Admittance admittance(planar(2, 2), planar(d, d), 0.001);
    for (int k = 0; k < 1000; ++k)
      admittance.step(planar(4, 0));
    EXPECT_NEAR(admittance.velocity()(0), 2.0, 1e-8);
    EXPECT_NEAR(admittance.position()(0), 1.0, 1e-8);
  }
}

// The work of the wrench less the kinetic energy is what the damper took: it can only grow.
TEST(Admittance, IsPassive)
{
  Admittance admittance(planar(90, 90), planar(200, 200), 0.001);
  double work = 0.0, last = 0.0;
  for (int k = 0; k < 5000; ++k)
  {
    const VectorDof u = planar(60 * std::sin(0.01 * k), 40 * std::cos(0.037 * k)), before = admittance.position();
    admittance.step(u);
    work += u.dot(admittance.position() - before);
    const double dissipated = work - 45.0 * admittance.velocity().squaredNorm();
    EXPECT_GE(dissipated, last - 1e-12);
    last = dissipated;
  }
  EXPECT_GT(last, 0.1);
}

TEST(Admittance, RefusesImpossibleValues)
{
  EXPECT_THROW(Admittance(planar(0, 1), planar(1, 1), 0.001), std::invalid_argument);
  EXPECT_THROW(Admittance(planar(1, 1), planar(-1, 1), 0.001), std::invalid_argument);
  EXPECT_THROW(Admittance(planar(1, NAN), planar(1, 1), 0.001), std::invalid_argument);
  EXPECT_THROW(Admittance(planar(1, 1), VectorDof::Ones(3), 0.001), std::invalid_argument);
}
