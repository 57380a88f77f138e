#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "phri_core/admittance.hpp"
#include "phri_sim/experiment.hpp"
#include "phri_sim/human_partner.hpp"

using namespace phri_sim;
using Eigen::Vector2d;

namespace
{
std::shared_ptr<const Scene> maze()
{
  static const auto scene = std::make_shared<const Scene>(loadScene("maze"));
  return scene;
}

Participant quiet()
{
  Participant person;
  person.force_variation = person.force_noise = person.tremor = person.wander = 0.0;
  return person;
}
}  // namespace

TEST(Route, LeadsThroughTheMazeWithoutTouching)
{
  const Route route = planRoute(*maze(), 0.012);
  EXPECT_LT((route.points.front() - maze()->start).norm(), 1e-9);
  EXPECT_LT((route.points.back() - maze()->goal).norm(), 2.0 * route.step);
  for (std::size_t k = 0; k < route.points.size(); ++k)
  {
    EXPECT_GT(route.clearance[k], 0.002) << k;
    EXPECT_NEAR(route.tangents[k].norm(), 1.0, 1e-9);
    EXPECT_LT(std::abs(route.curvature[k]), 100.0) << "a corner of less than 10 mm radius";
  }
  EXPECT_GT(route.length(), 0.6);
  EXPECT_LT(route.length(), 0.9);
}

// In an empty room the way is the straight line: the marching and the descent have no preferred direction.
TEST(Route, IsStraightInAnEmptyRoom)
{
  const GrayImage free{ 100, 100, std::vector<std::uint8_t>(10000, 255) };
  Scene room = *maze();
  room.walls = DistanceField(free, 0.003, Vector2d(-0.15, -0.15), 0.65);
  room.start = { -0.08, -0.05 };
  room.goal = { 0.09, 0.02 };
  const Route route = planRoute(room, 0.01);
  const Vector2d along = (room.goal - room.start).normalized();
  for (const Vector2d& x : route.points)
  {
    const Vector2d from = x - room.start;
    EXPECT_LT(std::abs(along(0) * from(1) - along(1) * from(0)), 0.0035) << "farther than 3.5 mm from the line";
  }
  EXPECT_NEAR(route.length(), (room.goal - room.start).norm(), 0.004);
}

TEST(Route, SaysWhenThereIsNoWay)
{
  GrayImage image{ 60, 60, std::vector<std::uint8_t>(3600, 255) };
  for (int row = 0; row < 60; ++row)
    image.pixels[row * 60 + 30] = image.pixels[row * 60 + 31] = 0;
  Scene room = *maze();
  room.walls = DistanceField(image, 0.005, Vector2d(-0.15, -0.15), 0.65);
  room.start = { -0.1, 0.0 };
  room.goal = { 0.1, 0.0 };
  EXPECT_THROW(planRoute(room, 0.01), std::invalid_argument);
}

// Held still, then displaced by 10 mm: the intrinsic stiffness answers at once, the reflex not before its delay.
TEST(HumanPartner, ReflexComesAfterItsDelay)
{
  Participant person = quiet();
  person.reflex_delay = 0.08;
  const auto route = std::make_shared<const Route>(planRoute(*maze(), person.clearance));
  HumanPartner human(maze(), route, person, 100, 90, 200, 1);
  HumanPartner reference(maze(), route, person, 100, 90, 200, 1);
  const Vector2d start = maze()->start, still(0, 0), step(0.0, 0.01);
  double at_once = 0.0, before = 0.0, after = 0.0;
  for (int k = 0; k < 290; ++k)  // the intention starts at 0.3 s
  {
    const bool displaced = k >= 100;
    const Vector2d force = human.step(k * 1e-3, displaced ? start + step : start, still, still, {}) -
                           reference.step(k * 1e-3, start, still, still, {});
    if (k == 101)
      at_once = force(1);
    if (k == 100 + 79)
      before = force(1);
    if (k == 100 + 180)
      after = force(1);
  }
  const double expected = -0.5 * person.stiffnessAfter(100) * 0.01;
  EXPECT_NEAR(at_once, expected, 1e-6);
  EXPECT_NEAR(before, at_once, 1e-6) << "answered before the reflex delay";
  EXPECT_LT(after, 1.3 * at_once) << "no reflex";
}

TEST(HumanPartner, ForceNoiseGrowsWithForce)
{
  Participant person;
  person.force_noise = person.tremor = 0.0;
  person.force_variation = 0.1;
  const auto route = std::make_shared<const Route>(planRoute(*maze(), person.clearance));
  double deviation[2];
  for (int level = 0; level < 2; ++level)
  {
    const Vector2d away(0.0, level ? -0.08 : -0.02);
    double sum = 0, square = 0;
    int n = 0;
    for (std::uint64_t seed = 0; seed < 300; ++seed)
    {
      HumanPartner human(maze(), route, person, 100, 90, 200, seed);
      Vector2d force;
      for (int k = 0; k < 290; ++k)
        force = human.step(k * 1e-3, maze()->start + away, { 0, 0 }, { 0, 0 }, {});
      sum += force(1);
      square += force(1) * force(1);
      ++n;
    }
    deviation[level] = std::sqrt(square / n - sum * sum / n / n) / (sum / n);
  }
  // the same coefficient of variation at four times the force; 300 samples give it to 4 %, five of those
  EXPECT_NEAR(deviation[0], deviation[1], 0.2 * deviation[1]);
  EXPECT_GT(deviation[0], 0.05);
}

// A person who holds still brings a displaced object back, whatever it weighs and however stiff the arm: delays of 80
// and 200 ms against 1.5 to 100 kg, 80 to 900 N/m. Coupled to the exact admittance with the thesis' damping.
TEST(HumanPartner, HoldsObjectsOfAnyWeightStill)
{
  const auto route = std::make_shared<const Route>(planRoute(*maze(), 0.012));
  for (const double mass : { 1.5, 15.0, 40.0, 90.0, 100.0 })
    for (const double stiffness : { 80.0, 220.0, 900.0 })
    {
      Participant person = quiet();
      person.stiffness = stiffness;
      HumanPartner human(maze(), route, person, 100, mass, 200, 1);
      phri_core::Admittance object(Vector2d(mass, mass), Vector2d(200, 200), 0.001);
      object.reset(maze()->start + Vector2d(0.02, 0.02), Vector2d(0, 0));
      for (int k = 0; k < 20000; ++k)  // t = 0: the intention has not started yet
        object.step(human.step(0.0, object.position(), object.velocity(), { 0, 0 }, {}));
      EXPECT_LT((object.position() - maze()->start).norm(), 0.002) << mass << " kg, " << stiffness << " N/m";
      EXPECT_LT(object.velocity().norm(), 0.001) << mass << " kg, " << stiffness << " N/m";
    }
}

TEST(HumanPartner, NeverExceedsItsStrength)
{
  const Participant person = quiet();
  const auto route = std::make_shared<const Route>(planRoute(*maze(), person.clearance));
  HumanPartner human(maze(), route, person, 0, 90, 200, 1);
  double largest = 0.0;
  for (int k = 0; k < 3000; ++k)
    largest = std::max(largest, human.step(k * 1e-3, { 0.1, -1.0 }, { 0, 0 }, { 0, 0 }, {}).norm());
  EXPECT_LE(largest, person.force_max + 1e-9);
  EXPECT_GT(largest, 0.99 * person.force_max);
}

TEST(Population, PeopleAreSeededAndIndependentOfThePopulationsSize)
{
  const Population population;
  const Participant a = population.person(7, 3), b = population.person(7, 3), c = population.person(7, 4);
  EXPECT_EQ(a.speed, b.speed);
  EXPECT_NE(a.speed, c.speed);
  double log_sum = 0;
  const int n = 2000;
  for (int k = 0; k < n; ++k)
  {
    const Participant person = population.person(7, k);
    for (const Trait& trait : population.traits)
    {
      EXPECT_GE(person.*trait.field, trait.low) << trait.key;
      EXPECT_LE(person.*trait.field, trait.high) << trait.key;
    }
    log_sum += std::log(person.speed);
  }
  EXPECT_NEAR(std::exp(log_sum / n), 0.075, 0.075 * 0.2 * 4 / std::sqrt(n));
}

TEST(Participant, PracticeConverges)
{
  Participant person;
  EXPECT_EQ(person.internalModelAfter(0), person.internal_model);
  const double settled = person.learning_rate / (person.learning_rate + person.forgetting);
  EXPECT_NEAR(person.internalModelAfter(60), settled, 1e-9);
  EXPECT_NEAR(person.stiffnessAfter(60), person.stiffness, 1e-6 * person.stiffness);
  EXPECT_GT(person.stiffnessAfter(0), person.stiffness);
}

// Every controller comes equally often at every place and, for an even number, follows every other one equally often.
TEST(Schedule, IsABalancedLatinSquare)
{
  Experiment experiment;
  experiment.trials = 3;
  for (const int n : { 3, 4 })
  {
    experiment.controllers.clear();
    for (int c = 0; c < n; ++c)
      experiment.controllers.push_back(std::string(1, char('a' + c)));
    const int people = 2 * n;
    const auto blocks = schedule(experiment, people, 0, 7);
    ASSERT_EQ(int(blocks.size()), people * n);
    Eigen::MatrixXi place = Eigen::MatrixXi::Zero(n, n), follows = Eigen::MatrixXi::Zero(n, n);
    for (int p = 0; p < people; ++p)
      for (int k = 0; k < n; ++k)
      {
        const int controller = blocks[p * n + k].controller[0] - 'a';
        ++place(controller, k);
        if (k)
          ++follows(blocks[p * n + k - 1].controller[0] - 'a', controller);
        EXPECT_EQ(blocks[p * n + k].trials.back().evaluated, true);
        EXPECT_EQ(blocks[p * n + k].trials.front().practice, 3 * k);
      }
    EXPECT_EQ(place.minCoeff(), 2) << n;
    EXPECT_EQ(place.maxCoeff(), 2) << n;
    const Eigen::MatrixXi off = follows + Eigen::MatrixXi(2 * Eigen::MatrixXi::Identity(n, n));
    EXPECT_EQ(follows.diagonal().maxCoeff(), 0);
    EXPECT_EQ(off.minCoeff(), 2) << n << '\n' << follows;
    EXPECT_EQ(off.maxCoeff(), 2) << n << '\n' << follows;
  }
}

TEST(Schedule, TrialSeedsAreTheSameUnderEveryController)
{
  EXPECT_EQ(trialSpec(2, "none", 3, 3, 2, 7).seed, trialSpec(2, "lqr", 3, 3, 11, 7).seed);
  EXPECT_NE(trialSpec(2, "none", 3, 3, 2, 7).seed, trialSpec(2, "none", 2, 3, 2, 7).seed);
  EXPECT_NE(trialSpec(2, "none", 3, 3, 2, 7).seed, trialSpec(2, "none", 3, 3, 2, 8).seed);
}
