// The world around its contacts: sensors, end stops, filters, refusals, determinism, memory.
#include "phri_sim/world.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "mechanisms.hpp"
#include "phri_core/testing.hpp"

namespace
{
using namespace phri_sim;
using namespace phri_sim::testing;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kStep = 1e-3;     // [s]
constexpr double kGravity = 9.81;  // [m/s2]

WorldOptions options(const Material& material, double gravity = 0.0)
{
  WorldOptions o;
  o.material = material;
  o.tree.gravity = { 0, 0, -gravity };
  return o;
}

// ---- readings, limits, filters

TEST(World, SensorReadsAPushAlongXAsPlusX)
{
  RobotDescription robot = cart("wrist", 3.0, sphere(0.02));
  robot.links.push_back(solid("tool", 0.5, sphere(0.03)));
  JointDescription mount = joint("ft_joint", "wrist", "tool", JointKind::Fixed, { 0, 0, 1 });
  mount.origin.translation() = Vector3d(0, 0, 0.1);
  robot.joints.push_back(mount);
  WorldOptions o = options({});
  o.sensors = { "ft_joint" };
  World world({ { robot, "", Eigen::Isometry3d::Identity() } }, {}, o);
  for (int i = 0; i < 3; ++i)
    world.dynamics().drives()[std::size_t(i)] = { 1e4, 400.0, 0.0, 0.0 };
  const int tool = world.model().link("tool");
  const VectorXd tau = VectorXd::Zero(3);
  for (int i = 0; i < 3000; ++i)
  {
    world.addForce(tool, world.linkPose(tool) * Vector3d(0, 0, 0.2), { 10, 0, 0 });
    world.step(kStep, tau);
  }
  Vector6 expected;
  expected << 10, 0, 0, 0, 2, 0;  // 10 N, 0.2 m above the sensor
  EXPECT_LT((world.sensorWrench(0) - expected).norm(), 1e-6) << world.sensorWrench(0).transpose();
}

TEST(World, SensorReadsTheContactItself)
{
  RobotDescription robot = cart("wrist", 3.0, box(0.02, 0.02, 0.02));
  robot.links.push_back(solid("tool", 0.5, sphere(0.03)));
  JointDescription mount = joint("ft_joint", "wrist", "tool", JointKind::Fixed, { 0, 0, 1 });
  mount.origin.translation() = Vector3d(0, 0, -0.1);
  robot.joints.push_back(mount);
  WorldOptions o = options(half(1e4, 1.0, 0.5));
  o.sensors = { "ft_joint" };
  World world({ { robot, "", Eigen::Isometry3d::Identity() } }, { table(o.material) }, o);
  VectorXd q(3), tau(3);
  q << 0, 0, 0.13;
  tau << 0, 0, -25;
  world.setState(q, VectorXd::Zero(3));
  for (int i = 0; i < 5000; ++i)
    world.step(kStep, tau);
  Vector6 expected;
  expected << 0, 0, 25, 0, 0, 0;
  EXPECT_LT((world.sensorWrench(0) - expected).norm(), 1e-6) << world.sensorWrench(0).transpose();
}

TEST(World, JointsStopAtTheirLimits)
{
  RobotDescription robot = cart("slider", 2.0, sphere(0.01));
  robot.joints[0].lower = -0.2;
  robot.joints[0].upper = 0.1;
  World world({ { robot, "", Eigen::Isometry3d::Identity() } }, {}, options({}));
  VectorXd tau = VectorXd::Zero(3);
  for (const double side : { 1.0, -1.0 })
  {
    tau(0) = 30.0 * side;
    for (int i = 0; i < 3000; ++i)
      world.step(kStep, tau);
    EXPECT_NEAR(world.q()(0), (side > 0 ? 0.1 : -0.2) + side * 30.0 / WorldOptions().stop_stiffness, 1e-6);
    EXPECT_LT(world.qd().norm(), 1e-6);
  }
}

TEST(World, NeighboursAndListedPairsNeverTouch)
{
  RobotDescription chain;  // three overlapping boxes on two hinges
  chain.name = "chain";
  chain.links = { solid("one", 1, box(1, 1, 1)), solid("two", 1, box(1, 1, 1)), solid("three", 1, box(1, 1, 1)) };
  chain.joints = { joint("a", "one", "two", JointKind::Revolute, { 0, 0, 1 }),
                   joint("b", "two", "three", JointKind::Revolute, { 0, 0, 1 }) };
  const auto pairs = [&](WorldOptions o, std::vector<StaticShape> statics = {}) {
    World world({ { chain, "", Eigen::Isometry3d::Identity() } }, std::move(statics), o);
    world.step(kStep, VectorXd::Zero(2));
    std::vector<std::pair<int, int>> found;
    for (const Contact& c : world.contacts())
    {
      const std::pair<int, int> pair(c.link_a, c.link_b);
      if (std::find(found.begin(), found.end(), pair) == found.end())
        found.push_back(pair);
    }
    return found;
  };
  const std::pair<int, int> first_last(0, 2);
  EXPECT_EQ(pairs({}), (std::vector<std::pair<int, int>>{ first_last }));
  WorldOptions o;
  o.apart = { { "three", "one" } };
  EXPECT_TRUE(pairs(o).empty());
  o.apart.clear();
  o.joints_between = 3;
  EXPECT_TRUE(pairs(o).empty());
  EXPECT_EQ(pairs(o, { table({}) }).size(), 2u) << "both moving links touch the table, the fixed one cannot move";
}

TEST(World, RefusesAllErrorsAtOnce)
{
  WorldOptions o;
  o.material.stiffness = -1.0;
  o.materials["nobody"] = {};
  o.apart = { { "cart", "nothing" } };
  o.max_contacts = 0;
  StaticShape flat = table({});
  flat.shape.size.z() = 0.0;
  try
  {
    World world({ { cart("cart", 1.0, sphere(0.1)), "", Eigen::Isometry3d::Identity() } }, { flat, table({}) }, o);
    FAIL() << "accepted";
  }
  catch (const DescriptionError& error)
  {
    EXPECT_EQ(error.errors().size(), 6u) << error.what();
    for (const char* word : { "table: the name is used twice", "sizes must be positive", "-1.0", "nobody", "nothing" })
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << word << "\n" << error.what();
  }
}

// ---- determinism, memory

VectorXd tumble(World& world, int steps, int begin = 0)
{
  VectorXd tau = VectorXd::Zero(world.model().dofs());
  for (int i = begin; i < begin + steps; ++i)
  {
    tau(0) = 0.5 * std::sin(0.01 * i);
    world.step(kStep, tau);
  }
  VectorXd state(2 * tau.size());
  state << world.q(), world.qd();
  return state;
}

World crowd()
{
  std::vector<TreePart> parts;
  for (int i = 0; i < 3; ++i)
    parts.push_back({ cart("body" + std::to_string(i), 0.5 + i,
                           i == 1   ? sphere(0.08)
                           : i == 0 ? box(0.2, 0.2, 0.1)
                                    : cylinder(0.06, 0.2),
                           0.0, true),
                      "", Eigen::Isometry3d(Eigen::Translation3d(0.05 * i, 0.02 * i, 0.1 + 0.2 * i)) });
  return World(parts, { table(half(2e4, 0.2, 0.5)) }, options(half(2e4, 0.2, 0.5), kGravity));
}

TEST(World, RepeatsToTheLastBitAndFromAnyState)
{
  World a = crowd(), b = crowd();
  tumble(a, 700);
  World c = crowd();
  c.setState(VectorXd(a.q()), VectorXd(a.qd()));  // a state is all there is: nothing else is remembered
  const VectorXd end = tumble(a, 800, 700);
  EXPECT_TRUE(end == tumble(b, 1500));
  EXPECT_TRUE(end == tumble(c, 800, 700));
  EXPECT_GT(a.contacts().size(), 0u);
}

TEST(World, StepsWithoutAllocation)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP() << "nothing is counted under AddressSanitizer";
  World world = crowd();
  const VectorXd tau = VectorXd::Zero(world.model().dofs());
  const int link = world.model().link("body1");
  std::size_t most = 0;
  const long allocations = phri_core::testing::countAllocations([&] {
    for (int i = 0; i < 1500; ++i)
    {
      world.addForce(link, Vector3d::Zero(), Vector3d(0.1, 0, 0));
      world.step(kStep, tau);
      most = std::max(most, world.contacts().size());
    }
  });
  EXPECT_EQ(allocations, 0) << "from the first step on, through falls and several contacts";
  EXPECT_GE(most, 3u);
}
}  // namespace
