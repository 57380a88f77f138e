// The shipped descriptions against KDL, the published dimensions, and themselves.
#include <gtest/gtest.h>

#include <cstdlib>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl_parser/kdl_parser.hpp>
#include <map>

#include "phri_core/random.hpp"
#include "phri_sim/configuration.hpp"
#include "phri_sim/robot_description.hpp"

namespace phri_sim
{
namespace
{
constexpr double kRounding = 1e-12;     // [m] of a dozen multiplied transforms
constexpr double kMassRounding = 1e-9;  // [kg] sums of the same decimals in another order
constexpr double kPrinted = 1e-8;       // [m] files have nine digits

const std::vector<std::string> kRobots{ "mobile_manipulator", "dual_lwr", "lwr" };
const std::vector<std::string> kThings{ "bumper", "eraser", "button", "whiteboard" };

std::vector<std::string> everything()
{
  std::vector<std::string> all = kRobots;
  all.insert(all.end(), kThings.begin(), kThings.end());
  return all;
}

using Posture = std::map<std::string, double>;

/// Pose of each link in the root's frame.
std::vector<Eigen::Isometry3d> poses(const RobotDescription& robot, const Posture& posture)
{
  std::vector<Eigen::Isometry3d> all{ Eigen::Isometry3d::Identity() };
  for (const JointDescription& joint : robot.joints)
  {
    const auto found = posture.find(joint.name);
    const double q = found == posture.end() ? 0.0 : found->second;
    Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
    if (joint.kind == JointKind::Revolute)
      motion = Eigen::AngleAxisd(q, joint.axis);
    else if (joint.kind == JointKind::Prismatic)
      motion = Eigen::Translation3d(q * joint.axis);
    all.push_back(all[std::size_t(robot.link(joint.parent))] * joint.origin * motion);
  }
  return all;
}

Eigen::Isometry3d between(const RobotDescription& robot, const Posture& posture, const std::string& a,
                          const std::string& b)
{
  const auto all = poses(robot, posture);
  return all[std::size_t(robot.link(a))].inverse() * all[std::size_t(robot.link(b))];
}

std::vector<std::string> arms(const std::string& robot)
{
  if (robot == "lwr")
    return { "lwr" };
  const std::string kind = robot == "dual_lwr" ? "lwr" : "arm";
  return { kind + "_left", kind + "_right" };
}

Posture natural()
{
  Posture posture;
  for (const auto& [key, value] : underPrefix(loadYaml(shareFolder() + "/urdf/postures.yaml"), "zeros"))
    posture[key] = std::get<double>(value);
  return posture;
}
}  // namespace

TEST(ShippedRobots, AreWhatTheGeneratorWrites)
{
  const std::string call =
      "PYTHONDONTWRITEBYTECODE=1 /usr/bin/python3 '" + shareFolder() + "/urdf/draw_robots.py' --check";
  EXPECT_EQ(std::system(call.c_str()), 0);
}

TEST(ShippedRobots, ParentsComeFirstAndJointsCarryTheirLinks)
{
  for (const std::string& name : everything())
  {
    const RobotDescription robot = loadRobot(name);
    ASSERT_EQ(robot.joints.size() + 1, robot.links.size());
    for (std::size_t i = 0; i < robot.joints.size(); ++i)
    {
      EXPECT_EQ(robot.link(robot.joints[i].child), int(i) + 1);
      EXPECT_LE(robot.link(robot.joints[i].parent), int(i));
    }
  }
}

// KDL reads the same text through urdfdom: the same masses, and the same pose of every link in random postures.
TEST(ShippedRobots, AgreeWithKdl)
{
  phri_core::Random random(7);
  for (const std::string& name : everything())
  {
    const RobotDescription robot = loadRobot(name);
    KDL::Tree tree;
    ASSERT_TRUE(kdl_parser::treeFromString(robot.urdf, tree)) << name;
    double mass = 0.0, kdl_mass = 0.0;
    for (const LinkDescription& link : robot.links)
      mass += link.mass;
    for (const auto& [segment_name, element] : tree.getSegments())
      kdl_mass += element.segment.getInertia().getMass();
    // kdl_parser drops the inertia of a root link: only held objects and things of the scene have one
    EXPECT_NEAR(mass - robot.links[0].mass, kdl_mass, kMassRounding) << name;

    Posture posture;
    for (const JointDescription& joint : robot.joints)
      if (joint.kind != JointKind::Fixed)
        posture[joint.name] = random.uniform(std::max(joint.lower, -3.0), std::min(joint.upper, 3.0));
    const auto ours = poses(robot, posture);
    for (std::size_t l = 1; l < robot.links.size(); ++l)
    {
      KDL::Chain chain;
      ASSERT_TRUE(tree.getChain(robot.links[0].name, robot.links[l].name, chain));
      KDL::JntArray q(chain.getNrOfJoints());
      unsigned k = 0;
      for (const KDL::Segment& segment : chain.segments)
        if (segment.getJoint().getType() != KDL::Joint::None)
          q(k++) = posture.at(segment.getJoint().getName());
      KDL::Frame frame;
      ASSERT_GE(KDL::ChainFkSolverPos_recursive(chain).JntToCart(q, frame), 0);
      for (int row = 0; row < 3; ++row)
      {
        EXPECT_NEAR(frame.p(row), ours[l].translation()[row], kRounding) << robot.links[l].name;
        for (int column = 0; column < 3; ++column)
          EXPECT_NEAR(frame.M(row, column), ours[l].linear()(row, column), kRounding) << robot.links[l].name;
      }
    }
  }
}

TEST(ShippedRobots, HaveTheAgreedNames)
{
  for (const std::string& name : kRobots)
  {
    const RobotDescription robot = loadRobot(name);
    EXPECT_EQ(robot.name, name);
    EXPECT_EQ(robot.links[0].name, "odom");
    std::vector<std::string> moving;
    for (const JointDescription& joint : robot.joints)
      if (joint.kind != JointKind::Fixed)
        moving.push_back(joint.name);
    std::vector<std::string> expected;
    if (name != "lwr")
      expected = { "base_x_joint", "base_y_joint", "base_yaw_joint" };
    for (const std::string& arm : arms(name))
    {
      for (int k = 0; k < 7; ++k)
        expected.push_back(arm + '_' + std::to_string(k) + "_joint");
      expected.insert(expected.end(), { arm + "_gripper_left_finger_joint", arm + "_gripper_right_finger_joint" });
      EXPECT_EQ(robot.joints[std::size_t(robot.link(arm + "_tool0")) - 1].parent, arm + "_ft_link");
      EXPECT_EQ(robot.joints[std::size_t(robot.link(arm + "_ft_link")) - 1].parent, arm + "_7_link");
      EXPECT_GE(robot.link(arm + "_gripper_tcp"), 0);
    }
    EXPECT_EQ(moving, expected);
  }
}

// Published: d1 = 310.5, d3 = 400, d5 = 390, d7 = 78 mm; ranges 170 and 120 degrees; 16 kg with everything, of which
// the model's moving links are 12.4 kg.
TEST(ShippedRobots, LwrHasItsPublishedDimensions)
{
  const RobotDescription robot = loadRobot("lwr");
  const Eigen::Isometry3d flange = between(robot, {}, "lwr_base_link", "lwr_7_link");
  EXPECT_NEAR(flange.translation().z(), 0.3105 + 0.4 + 0.39 + 0.078, kPrinted);
  EXPECT_NEAR(flange.translation().head<2>().norm(), 0.0, kPrinted);
  EXPECT_TRUE(flange.linear().isIdentity(kPrinted));
  // bent by a right angle at joint 2 the flange is as far from the base's axis as the arm beyond the shoulder is long
  const Eigen::Isometry3d level = between(robot, { { "lwr_1_joint", -M_PI / 2 } }, "lwr_base_link", "lwr_7_link");
  EXPECT_NEAR(level.translation().x(), 0.4 + 0.39 + 0.078, kPrinted);
  EXPECT_NEAR(level.translation().z(), 0.3105, kPrinted);
  // bent at the elbow, the wrist comes back by Pythagoras
  const Eigen::Isometry3d bent = between(robot, { { "lwr_3_joint", M_PI / 2 } }, "lwr_base_link", "lwr_7_link");
  EXPECT_NEAR(bent.translation().x(), 0.39 + 0.078, kPrinted);
  EXPECT_NEAR(bent.translation().z(), 0.3105 + 0.4, kPrinted);
  double moving = 0.0;
  for (int k = 1; k <= 7; ++k)
    moving += robot.links[std::size_t(robot.link("lwr_" + std::to_string(k) + "_link"))].mass;
  EXPECT_NEAR(moving, 12.415, kMassRounding);
  EXPECT_NEAR(robot.joints[std::size_t(robot.joint("lwr_3_joint"))].upper, 120.0 * M_PI / 180.0, kPrinted);
  EXPECT_NEAR(robot.joints[std::size_t(robot.joint("lwr_4_joint"))].velocity, 204.0 * M_PI / 180.0, kPrinted);
}

// Thesis 5.1.2: 1.2 m, 1.9 kg, grasps 1.1 m apart; a thin rod has m L^2 / 12 about its cross axes.
TEST(ShippedRobots, BumperIsTheThesisOne)
{
  const RobotDescription bumper = loadRobot("bumper");
  EXPECT_EQ(bumper.links[0].mass, 1.9);
  EXPECT_NEAR(between(bumper, {}, "object", "object_human").translation().x(), 1.1, kPrinted);
  EXPECT_NEAR(bumper.links[0].centre.x(), 0.55, kPrinted);
  EXPECT_NEAR(bumper.links[0].inertia(1, 1), 1.9 * 1.2 * 1.2 / 12.0, kPrinted);
  double low = 0.0, high = 0.0;
  for (const ShapeDescription& shape : bumper.links[0].collision)
  {
    const double half = (shape.origin.linear().row(0).cwiseAbs() * shape.size)[0] / 2;
    low = std::min(low, shape.origin.translation().x() - half);
    high = std::max(high, shape.origin.translation().x() + half);
  }
  EXPECT_NEAR(high - low, 1.2, 1e-6);
}

// The two arms mirror each other: a mirrored posture (joints about z change sign, about y not) puts the right hand
// where the left one's reflection is.
TEST(ShippedRobots, ArmsMirrorEachOther)
{
  for (const char* name : { "mobile_manipulator", "dual_lwr" })
  {
    const RobotDescription robot = loadRobot(name);
    const auto hands = arms(name);
    const Eigen::Vector3d left = between(robot, natural(), "base_link", hands[0] + "_gripper_tcp").translation();
    const Eigen::Vector3d right = between(robot, natural(), "base_link", hands[1] + "_gripper_tcp").translation();
    EXPECT_LT((left - Eigen::Vector3d(right.x(), -right.y(), right.z())).norm(), kPrinted);
    EXPECT_GT(left.x(), 0.5);  // hands in front of the robot, at the height at which the bumper is carried
    EXPECT_NEAR(left.z(), 0.95, 0.02);
  }
}

// No point of a link's shapes lies in a shape of a link that is more than one moving joint away: in the natural posture
// and in 99 postures around it (0.25 rad to either side), so that a simulation of an ordinary posture starts without
// contact.
TEST(ShippedRobots, DoNotTouchThemselvesInOrdinaryPostures)
{
  const auto inside = [](const ShapeDescription& shape, const Eigen::Vector3d& point) {
    if (shape.kind == ShapeKind::Box)
      return ((shape.size / 2 - point.cwiseAbs()).array() > 0.0).all();
    if (shape.kind == ShapeKind::Cylinder)
      return point.head<2>().norm() < shape.size.x() && std::abs(point.z()) < shape.size.y() / 2;
    return point.norm() < shape.size.x();
  };
  phri_core::Random random(3);
  for (const std::string& name : kRobots)
  {
    const RobotDescription robot = loadRobot(name);
    const std::size_t count = robot.links.size();
    std::vector<int> body(count, 0), parent_body(count, -1);  // links merged over fixed joints
    std::vector<std::vector<Eigen::Vector3d>> points(count);  // of each link, in its frame
    std::vector<double> reach(count, 0.0);                    // of them, about its origin
    for (std::size_t l = 0; l < count; ++l)
    {
      if (l > 0)
      {
        const int parent = body[std::size_t(robot.link(robot.joints[l - 1].parent))];
        const bool fixed = robot.joints[l - 1].kind == JointKind::Fixed;
        body[l] = fixed ? parent : int(l);
        parent_body[l] = fixed ? parent_body[std::size_t(parent)] : parent;
      }
      for (const ShapeDescription& shape : robot.links[l].collision)
      {
        const double r = shape.size.x();
        const Eigen::Vector3d half = shape.kind == ShapeKind::Box      ? Eigen::Vector3d(shape.size / 2)
                                     : shape.kind == ShapeKind::Sphere ? Eigen::Vector3d(r, r, r)
                                                                       : Eigen::Vector3d(r, r, shape.size.y() / 2);
        for (int k = 0; k < 400; ++k)
        {
          const Eigen::Vector3d point(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
          if (inside(shape, point.cwiseProduct(half)))
            points[l].push_back(shape.origin * Eigen::Vector3d(point.cwiseProduct(half)));
        }
        reach[l] = std::max(reach[l], shape.origin.translation().norm() + half.norm());
      }
    }
    for (int trial = 0; trial < 100; ++trial)
    {
      Posture posture = natural();
      for (auto& [joint, q] : posture)
        q += trial && joint.find("finger") == std::string::npos ? random.uniform(-0.25, 0.25) : 0.0;
      const auto frames = poses(robot, posture);
      for (std::size_t a = 0; a < count; ++a)
        for (std::size_t b = 0; b < count; ++b)
        {
          if (body[a] == body[b] || parent_body[a] == body[b] || parent_body[b] == body[a])
            continue;
          const Eigen::Isometry3d relative = frames[b].inverse() * frames[a];
          if (relative.translation().norm() > reach[a] + reach[b])
            continue;
          for (const ShapeDescription& shape : robot.links[b].collision)
            for (const Eigen::Vector3d& point : points[a])
              ASSERT_FALSE(inside(shape, shape.origin.inverse() * (relative * point)))
                  << name << ": " << robot.links[a].name << " in " << robot.links[b].name << ", trial " << trial;
        }
    }
  }
}
}  // namespace phri_sim
