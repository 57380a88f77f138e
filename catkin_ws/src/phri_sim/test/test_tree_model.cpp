// What the tree makes of descriptions: merged bodies, places of links, what lies beyond a fixed joint, refusals.
#include "phri_sim/tree_model.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "tree_cases.hpp"

namespace
{
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using phri_sim::DescriptionError;
using phri_sim::JointKind;
using phri_sim::LumpInertia;
using phri_sim::RobotDescription;
using phri_sim::TreeModel;
using phri_sim::TreeOptions;
using phri_sim::TreePart;

constexpr double kRounding = 1e-12;

/// Errors of a refused tree, one string; empty if it was accepted.
std::string refusal(const std::vector<TreePart>& parts, const TreeOptions& options = {})
{
  try
  {
    const TreeModel model(parts, options);
  }
  catch (const DescriptionError& error)
  {
    std::string all;
    for (const std::string& line : error.errors())
      all += line + "\n";
    return all;
  }
  return "";
}

// Two halves of a box, one fixed to the other the wrong way round, are the box.
TEST(TreeModel, mergesFixedLinksIntoBodies)
{
  RobotDescription halves, whole;
  const phri_sim::LinkDescription world{ "ground", 0.0, Vector3d::Zero(), Matrix3d::Zero(), {} };
  halves.links.push_back(world);
  whole.links.push_back(world);
  const Vector3d half(0.2, 0.3, 0.4), full(0.4, 0.3, 0.4);
  tree_cases::add(halves, tree_cases::box("near", 2.0, { 0.1, 0, 0 }, half), "hinge", "ground", JointKind::Revolute,
                  tree_cases::at(1, 2, 3), Vector3d::UnitX());
  Isometry3d turned = tree_cases::at(0.4, 0, 0);
  turned.rotate(Eigen::AngleAxisd(M_PI, Vector3d::UnitZ()));
  tree_cases::add(halves, tree_cases::box("far", 2.0, { 0.1, 0, 0 }, half), "glue", "near", JointKind::Fixed, turned);
  tree_cases::add(whole, tree_cases::box("near", 4.0, { 0.2, 0, 0 }, full), "hinge", "ground", JointKind::Revolute,
                  tree_cases::at(1, 2, 3), Vector3d::UnitX());
  const TreeModel merged({ { halves, "", Isometry3d::Identity() } });
  const TreeModel plain({ { whole, "", Isometry3d::Identity() } });
  ASSERT_EQ(merged.dofs(), 1);
  const LumpInertia &a = merged.bodies()[0].inertia, &b = plain.bodies()[0].inertia;
  EXPECT_NEAR(a.mass, b.mass, kRounding);
  EXPECT_LT((a.moment - b.moment).norm(), kRounding);
  EXPECT_LT((a.inertia - b.inertia).norm(), kRounding);
  // the axis is the body's z; the link stands where it stood: centre of mass 0.2 along x, the axis
  EXPECT_LT((a.moment - 4.0 * Vector3d(0, 0, 0.2)).norm(), kRounding);
  const phri_sim::TreeLink& far = merged.links()[std::size_t(merged.link("far"))];
  EXPECT_EQ(far.body, 0);
  const Isometry3d relative = merged.links()[std::size_t(merged.link("near"))].pose.inverse() * far.pose;
  EXPECT_TRUE(relative.isApprox(turned, kRounding));
}

// What a sensor carries: its share of its own body and the whole of every body beyond.
TEST(TreeModel, knowsWhatLiesBeyondAFixedJoint)
{
  const auto model = tree_cases::dualArmWithBumper();
  ASSERT_EQ(model->dofs(), 21);
  const auto massBeyond = [&](const std::string& name) {
    const auto& joint = model->fixedJoints()[std::size_t(model->fixedJoint(name))];
    double mass = joint.beyond.mass;
    for (const int body : joint.bodies_beyond)
      mass += model->bodies()[std::size_t(body)].inertia.mass;
    return mass;
  };
  EXPECT_NEAR(massBeyond("lwr_left_gripper_joint"), 1.4, kRounding);
  EXPECT_NEAR(massBeyond("lwr_left_ft_joint"), 1.57, kRounding);
  EXPECT_NEAR(massBeyond("lwr_right_ft_joint"), 1.57 + 1.9, kRounding);
  EXPECT_NEAR(massBeyond("bumper_mount"), 1.9, kRounding);
  EXPECT_NEAR(massBeyond("lwr_left_base_joint"), 1.2 + 3 * 2.3 + 2.3 + 1.6 + 1.5 + 0.11 + 1.57, kRounding);
  const auto& sensor = model->fixedJoints()[std::size_t(model->fixedJoint("lwr_right_ft_joint"))];
  EXPECT_EQ(sensor.bodies_beyond.size(), 2u);  // the fingers
  EXPECT_TRUE(sensor.links_beyond[std::size_t(model->link("bumper"))]);
  EXPECT_TRUE(sensor.links_beyond[std::size_t(model->link("lwr_right_gripper_left"))]);
  EXPECT_FALSE(sensor.links_beyond[std::size_t(model->link("lwr_right_7_link"))]);
  EXPECT_FALSE(sensor.links_beyond[std::size_t(model->link("lwr_left_tool0"))]);
}

TEST(TreeModel, heldPartMovesWithItsHolder)
{
  phri_core::Random random(81);
  const Isometry3d grasp = tree_cases::randomPose(random, 0.2);
  const auto model = std::make_shared<TreeModel>(std::vector<TreePart>{
      { tree_cases::arm(), "", tree_cases::at(1, 0, 0) }, { tree_cases::bumper(), "lwr_tool0", grasp } });
  phri_sim::TreeDynamics dynamics(model);
  dynamics.setState(tree_cases::randomVector(random, 9, 2.0), Eigen::VectorXd::Zero(9));
  const Isometry3d held = dynamics.linkPose(model->link("bumper"));
  EXPECT_TRUE(held.isApprox(dynamics.linkPose(model->link("lwr_tool0")) * grasp, kRounding));
  EXPECT_TRUE(dynamics.linkPose(model->link("stand")).isApprox(tree_cases::at(1, 0, 0), kRounding));
  EXPECT_EQ(model->links()[std::size_t(model->link("stand"))].body, -1);
}

TEST(TreeModel, namesWhatItDoesNotKnow)
{
  const auto model = tree_cases::dualArmWithBumper();
  EXPECT_EQ(model->joints()[std::size_t(model->joint("lwr_left_3_joint"))].armature, 2.0);
  try
  {
    model->fixedJoint("lwr_left_3_joint");
    FAIL() << "a moving joint is not a fixed one";
  }
  catch (const std::out_of_range& error)
  {
    EXPECT_NE(std::string(error.what()).find("lwr_left_3_joint"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("lwr_left_ft_joint"), std::string::npos);
  }
  EXPECT_THROW(model->link("nothing"), std::out_of_range);
  EXPECT_THROW(model->joint("lwr_left_ft_joint"), std::out_of_range);
}

TEST(TreeModel, refusesAllErrorsAtOnce)
{
  RobotDescription arm = tree_cases::arm();
  EXPECT_EQ(refusal({ { arm, "", Isometry3d::Identity() } }), "");

  RobotDescription bad = arm;
  bad.joints[1].axis = Vector3d(0, 0, 2);
  bad.joints[2].damping = -1.0;
  bad.joints[3].origin.translation().x() = std::numeric_limits<double>::quiet_NaN();
  bad.links[4].mass = -2.0;
  TreeOptions options;
  options.armature["lwr_3_jiont"] = 1.0;
  options.armature["lwr_4_joint"] = -0.5;
  options.friction_speed = 0.0;
  const std::string errors = refusal({ { bad, "", Isometry3d::Identity() },
                                       { tree_cases::bumper(), "no_hand", Isometry3d::Identity() },
                                       { arm, "", Isometry3d::Identity() } },
                                     options);
  for (const char* part :
       { "'lwr_0_joint': axis of length 2", "'lwr_1_joint': damping -1", "'lwr_2_joint': origin",
         "'lwr_3_link': mass -2", "'lwr_3_jiont': no moving joint", "'lwr_4_joint': -0.5", "friction_speed 0",
         "no link 'no_hand'", "link 'stand': name used twice", "joint 'lwr_0_joint': name used twice" })
    EXPECT_NE(errors.find(part), std::string::npos) << part << " is missing in:\n" << errors;
}

// A joint that moves nothing makes the mass matrix singular; armature alone is enough to move.
TEST(TreeModel, refusesWhatHasNoInertia)
{
  RobotDescription robot;
  robot.links.push_back({ "ground", 0.0, Vector3d::Zero(), Matrix3d::Zero(), {} });
  tree_cases::add(robot, { "point", 1.0, Vector3d(0, 0, 0.3), Matrix3d::Zero(), {} }, "spin", "ground",
                  JointKind::Revolute, Isometry3d::Identity(), Vector3d::UnitZ());  // a point mass on the axis
  EXPECT_NE(refusal({ { robot, "", Isometry3d::Identity() } }).find("'spin'"), std::string::npos);
  TreeOptions options;
  options.armature["spin"] = 0.1;
  EXPECT_EQ(refusal({ { robot, "", Isometry3d::Identity() } }, options), "");
  robot.joints[0].axis = Vector3d::UnitX();
  EXPECT_EQ(refusal({ { robot, "", Isometry3d::Identity() } }), "");
}
}  // namespace
