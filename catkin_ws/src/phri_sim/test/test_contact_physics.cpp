// Contacts in the world obey Hooke and Coulomb, lose energy and conserve momentum, whatever the mass and stiffness.
#include "phri_sim/world.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "mechanisms.hpp"
#include "phri_sim/configuration.hpp"
#include "phri_sim/robot_settings.hpp"

namespace
{
using namespace phri_sim;
using namespace phri_sim::testing;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kStep = 1e-3;         // [s]
constexpr double kGravity = 9.81;      // [m/s2]
constexpr double kPenetration = 1e-6;  // [m] asked for; GJK and 10 s of settling leave about 1e-9
constexpr double kRounding = 1e-9;     // sums of a few hundred numbers of size 1 to 100

WorldOptions options(const Material& material, double gravity = 0.0)
{
  WorldOptions o;
  o.material = material;
  o.tree.gravity = { 0, 0, -gravity };
  return o;
}

/// A cart on the table's plane at the given height of its lowest point.
struct Scene
{
  World world;
  int link;
  VectorXd tau;

  Scene(const RobotDescription& robot, const Material& material, double gravity, const Vector3d& start,
        const Vector3d& speed = Vector3d::Zero())
    : world({ { robot, "", Eigen::Isometry3d::Identity() } }, { table(material) }, options(material, gravity)),
      link(world.model().link(robot.name)),
      tau(VectorXd::Zero(world.model().dofs()))
  {
    VectorXd q = tau, qd = tau;
    q.head<3>() = start;
    qd.head<3>() = speed;
    world.setState(q, qd);
  }

  Vector3d position() const { return world.linkPose(link).translation(); }
  void push(const Vector3d& force)
  {
    world.addForce(link, position(), force);
    world.step(kStep, tau);
  }
  void settle(const Vector3d& force, int steps)
  {
    for (int i = 0; i < steps; ++i)
      push(force);
  }
};

// ---- Hooke

TEST(World, PenetrationAtRestIsForceOverStiffness)
{
  const double force = 25.0;
  for (const double stiffness : { 1e3, 1e4, 5e4 })
  {
    for (const double mass : { 0.05, 1.0, 15.0, 100.0 })
    {
      for (const ShapeDescription& shape : { box(0.1, 0.1, 0.1), sphere(0.05) })
      {
        // so much damping that 10 s are enough for the slowest of them: 1 / (ratio x frequency) <= 0.4 s
        Scene s(cart("tool", mass, shape), half(stiffness, 1.0, 0.5), 0.0, { 0, 0, 0.05 });
        s.settle({ 0, 0, -force }, 10000);
        EXPECT_NEAR(0.05 - s.position().z(), force / stiffness, kPenetration) << stiffness << " N/m, " << mass << " kg";
        EXPECT_NEAR(s.world.contactForce(s.link).z(), force, 1e-6);
      }
    }
  }
}

TEST(World, ForceIsQuietWhenPressed)
{
  // 25 N on 1e4 N/m: 2.500 mm; afterwards nothing moves, while pushed about by 1 N along the surface
  Scene s(cart("tool", 2.0, box(0.1, 0.05, 0.03)), half(1e4, 0.1, 0.5), 0.0, { 0, 0, 0.015 });
  s.settle({ 0, 0, -25 }, 5000);
  double sum = 0.0, squares = 0.0;
  const int steps = 2000;
  for (int i = 0; i < steps; ++i)
  {
    s.push({ std::sin(0.05 * i), std::cos(0.03 * i), -25 });
    const double force = s.world.contactForce(s.link).z();
    sum += force;
    squares += force * force;
    ASSERT_LE(s.world.sweeps(), ContactSolver::kMaxSweeps);
  }
  const double mean = sum / steps, variance = std::max(0.0, squares / steps - mean * mean);
  EXPECT_NEAR(mean, 25.0, 1e-4);
  EXPECT_LT(std::sqrt(variance), 1e-3) << "Bullet's own multibody contact: 0.05 N";
}

TEST(World, ExtremesOfMassAndStiffnessStayBounded)
{
  for (const double stiffness : { 1e3, 5e4, 1e6 })
  {
    for (const double mass : { 0.05, 1.0, 100.0 })
    {
      if (mass * kGravity / stiffness > 0.05)
        continue;  // its weight alone pushes the centre of the ball into the table
      for (const double ratio : { 0.0, 0.1, 1.0, 5.0 })
      {
        Scene s(cart("ball", mass, sphere(0.05)), half(std::min(stiffness, 5e5), ratio, 0.5), kGravity, { 0, 0, 0.055 },
                { 0.1, 0, -0.3 });
        const double energy = s.world.energy();
        for (int i = 0; i < 3000; ++i)
        {
          s.push(Vector3d::Zero());
          ASSERT_LE(s.world.energy(), energy * (1.0 + kRounding)) << stiffness << " " << mass << " " << ratio;
        }
        EXPECT_LT(s.world.qd().norm(), 0.44) << "the first impact's speed";
      }
    }
  }
}

// ---- Coulomb

TEST(World, FrictionHoldsBelowItsLimitAndBrakesWithItAbove)
{
  const double mass = 2.0, mu = 0.4, weight = mass * kGravity;
  for (const double angle : { 0.0, 0.4, M_PI / 4, 2.0 })  // a pyramid would hold up to 1.41 of it along a diagonal
  {
    const Vector3d along(std::cos(angle), std::sin(angle), 0.0);
    Scene held(cart("block", mass, box(0.1, 0.1, 0.1)), half(2e4, 1.0, mu), kGravity, { 0, 0, 0.05 });
    held.settle(Vector3d::Zero(), 1000);
    const Vector3d start = held.position();
    held.settle(0.98 * mu * weight * along, 1000);
    // four points share the force; each creeps by kCreep x (1/m + 1/m) x its impulse
    const double creep = ContactSolver::kCreep * 2.0 / mass * 0.98 * mu * weight * kStep / 4.0;
    EXPECT_LT((held.position() - start - creep * 1.0 * along).norm(), 0.02 * creep) << "after 1 s";
    EXPECT_NEAR(held.world.contactForce(held.link).dot(along), -0.98 * mu * weight, 1e-6 * weight);

    Scene slides(cart("block", mass, box(0.1, 0.1, 0.1)), half(2e4, 1.0, mu), kGravity, { 0, 0, 0.05 });
    slides.settle(Vector3d::Zero(), 1000);
    slides.settle(1.5 * mu * weight * along, 300);
    EXPECT_NEAR(slides.world.qd().head<2>().norm(), 0.5 * mu * kGravity * 0.3, 1e-5);
    const Vector3d force = slides.world.contactForce(slides.link);
    EXPECT_NEAR(force.dot(along), -mu * weight, 1e-5 * weight);
  }
}

TEST(World, FrictionStopsWhatSlidesAfterSquareOfSpeedOverTwiceMuG)
{
  const double mu = 0.3, speed = 1.0;
  Scene s(cart("block", 1.5, box(0.1, 0.1, 0.1)), half(2e4, 1.0, mu), kGravity, { 0, 0, 0.05 });
  s.settle(Vector3d::Zero(), 2000);
  VectorXd qd = s.world.qd();
  qd.x() = speed;
  s.world.setState(VectorXd(s.world.q()), qd);
  s.settle(Vector3d::Zero(), 1000);
  // Euler's step runs ahead or behind by at most one step of the first speed
  EXPECT_NEAR(s.position().x(), speed * speed / (2.0 * mu * kGravity), speed * kStep);
  EXPECT_LT(s.world.qd().norm(), 1e-6);
}

// ---- impact, energy, momentum

struct Impact
{
  double peak = 0.0;
  int rebounds = 0;  // contacts after the first one
};

/// The thesis' admittance of contact (15 kg, 80 Ns/m) runs at 0.25 m/s into 20 kN/m.
Impact impact(double ratio, double drive)
{
  Scene s(cart("hand", 15.0, sphere(0.03), 80.0), half(2e4, ratio, 0.5), 0.0, { 0, 0, 0.0302 }, { 0, 0, -0.25 });
  Impact result;
  bool touching = false, touched = false;
  for (int i = 0; i < 3000; ++i)
  {
    s.push({ 0, 0, -drive });
    const double force = s.world.contactForce(s.link).z();
    result.peak = std::max(result.peak, force);
    result.rebounds += force > 0.0 && !touching && touched;
    touching = force > 0.0;
    touched = touched || touching;
  }
  return result;
}

TEST(World, ImpactOfTheThesisAdmittanceStaysBelow140N)
{
  // closed form without material damping: v sqrt(K M) exp(-zeta acos(zeta) / sqrt(1 - zeta^2)), zeta = D / (2 sqrt(K
  // M)) plus what implicit Euler adds, h omega / 2
  const double zeta = 80.0 / (2.0 * std::sqrt(2e4 * 15.0)) + 0.5 * kStep * std::sqrt(2e4 / 15.0);
  const double root = std::sqrt(1.0 - zeta * zeta);
  const double expected = 0.25 * std::sqrt(2e4 * 15.0) * std::exp(-zeta * std::acos(zeta) / root);
  const Impact elastic = impact(0.0, 0.0);
  EXPECT_NEAR(elastic.peak, expected, 0.01 * expected) << "steps of 1 ms on a quarter of a period of 43 ms";
  for (const double ratio : { 0.0, 0.1, 0.3 })
  {
    const Impact coasting = impact(ratio, 0.0);
    EXPECT_LE(coasting.peak, 140.0) << ratio;
    EXPECT_GT(coasting.peak, 80.0) << ratio;
    EXPECT_LE(coasting.rebounds, 1) << ratio;
    const Impact pushed = impact(ratio, 80.0 * 0.25);  // what keeps 0.25 m/s up in the air goes on pushing
    std::cout << "ratio " << ratio << ": coasting " << coasting.peak << " N, " << coasting.rebounds
              << " rebounds; pushed on by 20 N " << pushed.peak << " N, " << pushed.rebounds << " rebounds\n";
    if (ratio > 0.0)
    {
      EXPECT_LE(pushed.peak, 140.0) << ratio;
      EXPECT_LE(pushed.rebounds, 1) << ratio;
    }
  }
}

TEST(World, BouncingNeverGainsEnergy)
{
  for (const double ratio : { 0.0, 0.1 })
  {
    // from 1 cm, 0.44 m/s: nothing enters the surface unseen (CollisionScene::kSkin)
    Scene s(cart("ball", 0.5, sphere(0.05)), half(2e4, ratio, 0.5), kGravity, { 0, 0, 0.06 });
    double energy = s.world.energy(), before = energy, highest = 0.0;
    bool was_down = false;
    int bounces = 0;
    double last_peak = 0.06;
    for (int i = 0; i < 4000; ++i)
    {
      s.push(Vector3d::Zero());
      energy = s.world.energy();
      ASSERT_LE(energy, before + 1e-10) << "step " << i;
      before = energy;
      const bool down = s.position().z() < 0.05;
      if (down && !was_down)
      {
        if (bounces > 0)
        {
          EXPECT_LT(highest, last_peak);
          last_peak = highest;
        }
        ++bounces;
        highest = 0.0;
      }
      was_down = down;
      highest = std::max(highest, s.position().z());
    }
    EXPECT_GE(bounces, 3);
  }
}

/// A box thrown spinning onto the table: its momentum changes by what acts on it, and by nothing else.
TEST(World, MomentumChangesByGravityAndContactsOnly)
{
  const RobotDescription thrown = cart("thrown", 1.2, box(0.2, 0.15, 0.1), 0.0, true);
  World world({ { thrown, "", Eigen::Isometry3d::Identity() } }, { table(half(2e4, 0.1, 0.5)) },
              options(half(2e4, 0.1, 0.5), kGravity));
  const int link = world.model().link("thrown");
  VectorXd q = VectorXd::Zero(6), qd = VectorXd::Zero(6), tau = VectorXd::Zero(6);
  q << 0, 0, 0.25, 0.2, 0.3, 0.1;
  qd << 0.4, -0.2, 0, 1.0, -2.0, 0.5;
  world.setState(q, qd);
  const double at_first = world.energy();
  int touching = 0;
  double worst = 0.0;
  for (int i = 0; i < 1500; ++i)
  {
    const Vector3d before = 1.2 * world.dynamics().linkVelocity(link).head<3>();
    const Vector3d push(std::sin(0.01 * i), 0.3, 0.0);
    world.addForce(link, world.linkPose(link).translation(), push);
    world.step(kStep, tau);
    const Vector3d expected = kStep * (world.contactForce(link) + push + Vector3d(0, 0, -1.2 * kGravity));
    worst = std::max(worst, (1.2 * world.dynamics().linkVelocity(link).head<3>() - before - expected).norm());
    touching += !world.contacts().empty();
  }
  EXPECT_GT(touching, 300);
  EXPECT_LT(worst, 1e-12);
  EXPECT_GT(world.linkPose(link).translation().z(), 0.04) << "it lies on the table";
  EXPECT_LT(world.energy(), at_first);
}

TEST(World, TwoLinksPushEachOtherWithOppositeForces)
{
  World world({ { cart("left", 2.0, sphere(0.1)), "", Eigen::Isometry3d::Identity() },
                { cart("right", 3.0, box(0.2, 0.2, 0.2)), "", Eigen::Isometry3d(Eigen::Translation3d(0.25, 0, 0)) } },
              {}, options(half(1e4, 0.0, 0.3)));
  const int left = world.model().link("left"), right = world.model().link("right");
  VectorXd qd = VectorXd::Zero(6), tau = VectorXd::Zero(6);
  qd(0) = 0.5;
  world.setState(VectorXd::Zero(6), qd);
  double peak = 0.0;
  for (int i = 0; i < 400; ++i)
  {
    world.step(kStep, tau);
    EXPECT_LT((world.contactForce(left) + world.contactForce(right)).norm(), kRounding);
    peak = std::max(peak, world.contactForce(right).x());
    EXPECT_NEAR(2.0 * world.qd()(0) + 3.0 * world.qd()(3), 1.0, kRounding) << "sum of momenta [Ns]";
  }
  // v sqrt(K x reduced mass), less implicit Euler's damping by h omega / 2 of critical over a quarter of a period
  const double omega = std::sqrt(1e4 / 1.2);
  EXPECT_NEAR(peak, 0.5 * 1.2 * omega * std::exp(-0.5 * kStep * omega * M_PI / 2), 0.5);
  EXPECT_GT(world.qd()(3), world.qd()(0)) << "they part again";
}

// ---- a whole robot

/// The dual LWR holds the bumper by servos; a wall meets its middle face, 0.6 m x 0.09 m, flat, four points. Pressing
/// is done at the bumper's middle, so that the face stays flat.
TEST(World, BumperOfAWholeRobotPressedFlatAndSlidingIsSolvedAtEveryStep)
{
  WorldOptions o;
  o.sensors = { "lwr_left_ft_joint" };
  std::vector<TreePart> parts = { { loadRobot("dual_lwr"), "", Eigen::Isometry3d::Identity() },
                                  { loadRobot("bumper"), "lwr_left_gripper_tcp", Eigen::Isometry3d::Identity() } };
  for (const char* side : { "left", "right" })
    o.apart.emplace_back(std::string("lwr_left_gripper_") + side + "_finger_link", "object");
  World free(parts, {}, o);
  const std::map<std::string, double> natural = naturalPosture();
  VectorXd q = VectorXd::Zero(free.model().dofs());
  for (int i = 0; i < q.size(); ++i)
  {
    const auto known = natural.find(free.model().joints()[std::size_t(i)].description.name);
    q(i) = known == natural.end() ? 0.0 : known->second;
  }
  const VectorXd zero = VectorXd::Zero(q.size());
  free.setState(q, zero);
  const Eigen::Isometry3d held = free.linkPose(free.model().link("object"));
  StaticShape wall{ "wall", box(0.5, 0.1, 0.5), half(2e4, 0.3, 0.5) };  // its face where the bumper's is
  wall.shape.origin = held * Eigen::Translation3d(0.55, 0.04 + 0.05, 0.0);
  World world(parts, { wall }, o);
  world.setState(q, zero);
  VectorXd tau(q.size());
  world.dynamics().inverseDynamics(zero, tau);
  for (int i = 0; i < q.size(); ++i)
    world.dynamics().drives()[std::size_t(i)] = { 200.0, 40.0, q(i), 0.0 };
  const int object = world.model().link("object");
  int flat = 0, sliding = 0, worst = 0, edges = 0;
  double pressing = 0.0;
  for (int i = 0; i < 8000; ++i)
  {
    // 50 N at the middle of the face; from 3 s on along the wall, too, up to beyond the friction's limit and back
    const double along = i < 3000 ? 0.0 : 60.0 * std::sin(2e-3 * (i - 3000));
    const Eigen::Isometry3d pose = world.linkPose(object);
    world.addForce(object, pose * Vector3d(0.55, 0.04, 0.0), held.linear() * Vector3d(along, 50.0, 0.3 * along));
    world.step(kStep, tau);
    worst = std::max(worst, world.sweeps());
    ASSERT_LE(world.sweeps(), ContactSolver::kMaxSweeps) << "step " << i;
    flat += world.contacts().size() == 4;
    edges += !world.contacts().empty() && world.contacts().size() < 4;
    const Vector3d force = world.contactForce(object), normal = held.linear().col(1);
    const double press = -force.dot(normal);
    pressing = std::max(pressing, press);
    const double slip = (world.dynamics().pointVelocity(object, pose * Vector3d(0.55, 0.04, 0.0)) -
                         normal * normal.dot(world.dynamics().pointVelocity(object, pose * Vector3d(0.55, 0.04, 0.0))))
                            .norm();
    sliding += press > 1.0 && slip > 1e-3;
    for (const Contact& c : world.contacts())
    {
      ASSERT_LE((c.force - c.normalForce() * c.normal).norm(), 0.5 * c.normalForce() * (1.0 + kRounding)) << i;
    }
  }
  std::cout << "flat " << flat << ", edges " << edges << ", sliding " << sliding << ", at most " << worst << " sweeps, "
            << pressing << " N\n";
  EXPECT_GT(flat, 6000);
  EXPECT_GT(sliding, 500);
  EXPECT_GT(pressing, 40.0);
}
}  // namespace
