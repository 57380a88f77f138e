#include <gtest/gtest.h>

#include <cmath>

#include "phri_core/admittance.hpp"
#include "phri_core/random.hpp"

using phri_core::Admittance;
using phri_core::AdmittanceRamp;
using phri_core::VectorDof;

namespace
{
constexpr double kDt = 0.001;

VectorDof both(double value)
{
  return Eigen::Vector2d::Constant(value);
}
}  // namespace

// Passivity with a varying mass needs dM/dt <= 2 D (Kronander and Billard 2016); the ramp keeps half of that.
TEST(AdmittanceRamp, TheMassNeverGrowsFasterThanTheDampingAllows)
{
  AdmittanceRamp ramp(both(5), both(20));
  ramp.toward(both(400), both(30));
  VectorDof before = ramp.mass();
  int ticks = 0;
  for (; ramp.step(kDt); ++ticks)
  {
    EXPECT_LE(ramp.mass()(0) - before(0), 20.0 * kDt * (1 + 1e-9));
    before = ramp.mass();
  }
  EXPECT_EQ(ramp.mass()(0), 400.0);
  EXPECT_EQ(ramp.damping()(0), 30.0);
  EXPECT_NEAR(ticks * kDt, 395.0 / 20.0, 2 * kDt);
}

// Whatever force acts and however often another admittance is asked for, the work of the force is never less than the
// kinetic energy gained. The same steps of the mass without the ramp break this: the test can fail.
TEST(AdmittanceRamp, StaysPassiveUnderRandomChanges)
{
  double least_ramped = 0.0, least_stepped = 0.0;
  for (const bool ramped : { true, false })
  {
    phri_core::Random random = phri_core::Random::stream(3, "ramp");
    Admittance admittance(both(90), both(200), kDt);
    AdmittanceRamp ramp(both(90), both(200));
    double work = 0.0, least = 0.0;
    for (int k = 0; k < 60000; ++k)
    {
      if (k % 700 == 0)
      {
        const VectorDof mass = both(random.uniform(2, 300)), damping = both(random.uniform(10, 500));
        if (ramped)
          ramp.toward(mass, damping);
        else
          admittance.set(mass, damping);
      }
      if (ramp.step(kDt))
        admittance.set(ramp.mass(), ramp.damping());
      const VectorDof u = Eigen::Vector2d(40 * std::sin(0.004 * k), 30 * std::cos(0.011 * k));
      const VectorDof before = admittance.position();
      admittance.step(u);
      work += u.dot(admittance.position() - before);
      const double kinetic = 0.5 * (admittance.mass().array() * admittance.velocity().array().square()).sum();
      least = std::min(least, work - kinetic);
    }
    (ramped ? least_ramped : least_stepped) = least;
  }
  EXPECT_GE(least_ramped, -1e-9);
  EXPECT_LT(least_stepped, -1e-3);
}

// Another target in the middle of a ramp: it goes on from where it is.
TEST(AdmittanceRamp, ChangesItsMindWithoutAStep)
{
  AdmittanceRamp ramp(both(90), both(200));
  ramp.toward(both(10), both(50));
  for (int k = 0; k < 200; ++k)
    ramp.step(kDt);
  const VectorDof mass = ramp.mass();
  ramp.toward(both(120), both(300));
  ramp.step(kDt);
  EXPECT_LT(std::abs(ramp.mass()(0) - mass(0)), 0.3);
  while (ramp.step(kDt))
  {
  }
  EXPECT_EQ(ramp.mass()(1), 120.0);
  EXPECT_EQ(ramp.damping()(1), 300.0);
}
