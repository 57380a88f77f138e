#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "carried_bar.hpp"
#include "phri_core/testing.hpp"
#include "phri_sim/lab.hpp"

using namespace phri_sim;
using carried_bar::Bar;
using carried_bar::kDt;
using Eigen::Vector2d;

TEST(CarryingPartner, RepeatsBitByBitAndPeopleDiffer)
{
  const Lab lab = loadLab("lab");
  const auto path = std::make_shared<const WalkingPath>(lab.path(lab.routes.front()));
  const auto run = [&](int index, std::uint64_t seed) {
    Bar bar;
    bar.placeFarEnd(lab.start, lab.start_yaw);
    CarryingPartner partner({ path, lab.start_yaw, 0.5 }, bar.object, CarryingPopulation().person(6, index), seed);
    std::vector<double> forces;
    for (int k = 0; k < 3000; ++k)
    {
      const Vector6 wrench = partner.step(k * kDt, bar.farEnd());
      bar.step(wrench);
      forces.insert(forces.end(), wrench.data(), wrench.data() + 6);
    }
    return forces;
  };
  const auto first = run(0, 9);
  EXPECT_EQ(first, run(0, 9));
  EXPECT_NE(first, run(0, 10));
  EXPECT_NE(first, run(1, 9));
}

TEST(CarryingPartner, DoesNotAllocate)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP();
  const Lab lab = loadLab("lab");
  Bar bar;
  bar.placeFarEnd(lab.start, lab.start_yaw);
  CarryingPartner partner({ std::make_shared<const WalkingPath>(lab.path(lab.routes.front())), lab.start_yaw, 0.1 },
                          bar.object, CarryingPopulation().person(6, 0), 1);
  EXPECT_EQ(phri_core::testing::countAllocations([&] {
              for (int k = 0; k < 1000; ++k)
                bar.step(partner.step(k * kDt, bar.farEnd()));
            }),
            0);
  static_assert(noexcept(partner.step(0.0, std::declval<const FarEnd&>())), "runs in the tick");
}

// The shipped file says what the library says; draws stay within limits and people keep their place in the population.
TEST(CarryingPopulation, FileHoldsTheDefaults)
{
  const CarryingPopulation shipped = loadCarryingPopulation("carrying_adults"), library;
  ASSERT_EQ(shipped.traits.size(), library.traits.size());
  const CarryingPerson median;
  for (std::size_t k = 0; k < library.traits.size(); ++k)
  {
    const CarryingTrait& trait = library.traits[k];
    EXPECT_EQ(shipped.traits[k].median, trait.median) << trait.key;
    EXPECT_EQ(shipped.traits[k].spread, trait.spread) << trait.key;
    EXPECT_EQ(median.*trait.field, trait.median) << trait.key;
    double low = trait.high, high = trait.low;
    for (int i = 0; i < 300; ++i)
    {
      const double value = library.person(6, i).*trait.field;
      low = std::min(low, value);
      high = std::max(high, value);
    }
    EXPECT_GE(low, trait.low) << trait.key;
    EXPECT_LE(high, trait.high) << trait.key;
    EXPECT_LT(low, high) << trait.key << ": everybody is the same";
  }
}

// Twenty people, three routes, a robot that only follows: everybody arrives at walking speed with plausible forces.
// Bands: speed of the experiment (thesis, 5.1.2); force along the walk 5 to 20 N and across it 2 to 10 N rms.
TEST(CarryingPartner, EverybodyArrivesOnEveryRoute)
{
  const Lab lab = loadLab("lab");
  ASSERT_EQ(lab.routes.size(), 3u);
  const CarryingPopulation population = loadCarryingPopulation("carrying_adults");
  for (const LabRoute& route : lab.routes)
  {
    const auto path = std::make_shared<const WalkingPath>(lab.path(route));
    for (int i = 0; i < 20; ++i)
    {
      Bar bar;
      bar.placeFarEnd(lab.start, lab.start_yaw);
      CarryingPartner partner({ path, lab.start_yaw, 0.5 }, bar.object, population.person(6, i), 1000 + i);
      double along = 0.0, across = 0.0, first = 0.0, last = 0.0, astray = 0.0;
      int ticks = 0, k = 0;
      for (; k < 200000 && !partner.intention().arrived; ++k)
      {
        const Vector6 wrench = partner.step(k * kDt, bar.farEnd());
        bar.step(wrench);
        const double s = partner.intention().s;
        if (s < 0.3 || s > path->length() - 0.3)  // setting off and coming to rest
          continue;
        const double heading = path->at(s).heading;
        const Vector2d tangent(std::cos(heading), std::sin(heading));
        along += std::pow(tangent.dot(wrench.head<2>()), 2);
        across += std::pow(tangent(0) * wrench(1) - tangent(1) * wrench(0), 2);
        astray = std::max(astray, (bar.farEnd().position.head<2>() - partner.intention().walked).norm());
        first = ticks++ == 0 ? k * kDt : first;
        last = k * kDt;
      }
      const std::string who = route.name + ", person " + std::to_string(i);
      EXPECT_TRUE(partner.intention().arrived) << who;
      EXPECT_FALSE(partner.intention().slipping) << who;
      const double speed = (path->length() - 0.6) / (last - first);
      EXPECT_GT(speed, 0.12) << who;
      EXPECT_LT(speed, 0.2) << who;
      EXPECT_GT(std::sqrt(along / ticks), 5.0) << who;
      EXPECT_LT(std::sqrt(along / ticks), 20.0) << who;
      EXPECT_GT(std::sqrt(across / ticks), 2.0) << who;
      EXPECT_LT(std::sqrt(across / ticks), 10.0) << who;
      EXPECT_LT(astray, 0.08) << who << ": the load is where the person walks";
      const Vector2d middle = bar.farEnd().position.head<2>() - 0.5 * lab.grasp_distance * bar.axis();
      EXPECT_LT((middle - lab.goal).norm(), 0.1) << who;
      EXPECT_LT(std::abs(std::sin(bar.q(2) - lab.goal_axis)), 0.15) << who << ": parallel to the car's front";
    }
  }
}

TEST(CarryingPartner, RefusesImpossibleObjects)
{
  CarriedObject object;
  object.grasp_distance = 0.0;
  object.mass = -1.0;
  try
  {
    CarryingPartner partner({}, object, {}, 1);
    FAIL();
  }
  catch (const std::invalid_argument& error)
  {
    const std::string what = error.what();
    EXPECT_NE(what.find("no path"), std::string::npos) << what;
    EXPECT_NE(what.find("grasps 0 m"), std::string::npos) << what;
    EXPECT_NE(what.find("mass -1 kg"), std::string::npos) << what;
  }
}
