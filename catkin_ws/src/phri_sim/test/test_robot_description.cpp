// Every error of the loader by itself, all at once, and files cut short or garbled.
#include <gtest/gtest.h>

#include <cmath>

#include "phri_core/random.hpp"
#include "phri_sim/robot_description.hpp"

namespace phri_sim
{
namespace
{
// ---- a small description to spoil
const char* const kSound = R"(<robot name="two">
  <link name="root"/>
  <link name="upper"><inertial><origin xyz="0 0 0.1"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><cylinder radius="0.05" length="0.3"/></geometry></collision></link>
  <link name="lower"><inertial><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.2 0.2 0.3"/></geometry></collision>
    <collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <joint name="one" type="revolute"><parent link="root"/><child link="upper"/><origin xyz="0 0 0.5" rpy="0.1 0.2 0.3"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2" effort="10"/><dynamics damping="0.1" friction="0.2" armature="0.3"/></joint>
  <joint name="two" type="prismatic"><parent link="upper"/><child link="lower"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.4" velocity="0.2" effort="50"/></joint>
</robot>)";

std::string replaced(std::string text, const std::string& from, const std::string& to)
{
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

std::vector<std::string> errorsOf(const std::string& urdf)
{
  try
  {
    parseRobot(urdf, "test");
  }
  catch (const DescriptionError& error)
  {
    return error.errors();
  }
  return {};
}

struct Defect
{
  std::string from, to;
  std::vector<std::string> said;  // all in one line
  bool alone = true;              // the only error
};

/// Each hides none of the others: together they give one error each.
const std::vector<Defect> kCompatible{
  { R"(mass value="2")", R"(mass value="-2")", { "upper", "mass -2 kg", "above 0" } },
  { R"(<mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.005")",
    R"(<mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.021")",
    { "lower", "0.021", "belongs to no body" },
    false },
  { R"(xyz="0 0 1")", R"(xyz="0 0 2")", { "joint one", "axis of length 2", "expected 1" } },
  { R"(lower="-1" upper="1")", R"(lower="1" upper="-1")", { "joint one", "from 1 to -1", "lower below upper" } },
  { R"(damping="0.1")", R"(damping="-0.1")", { "joint one", "damping -0.1", "0 or more" } },
  { R"(velocity="0.2")", R"(velocity="0")", { "joint two", "velocity 0", "above 0" } },
  { R"(upper="0.4")", R"(upper="nan")", { "joint two", "upper \"nan\"", "finite" } },
  { R"(radius="0.05" length="0.3")", R"(radius="0.05" length="-0.3")", { "upper", "cylinder", "-0.3", "above 0" } },
  { R"(sphere radius="0.1")", "sphere", { "lower", "sphere has no radius" } },
};

/// Defects that hide others, or that cannot stand beside those above.
const std::vector<Defect> kFurther{
  { R"(<mass value="2"/>)", "", { "upper", "no mass" } },
  { R"(<mass value="2"/>)", R"(<mass value="2 kg"/>)", { "upper", "\"2 kg\"", "1 finite number" } },
  { R"(<mass value="2"/>)", R"(<mass value="nan"/>)", { "upper", "\"nan\"", "finite" } },
  { R"(<mass value="2"/>)", R"(<mass value="0"/>)", { "upper", "mass 0 kg with an inertia" } },
  { R"( izz="0.005")", "", { "upper", "inertia has no izz" } },
  { R"(ixx="0.01" iyy="0.01" izz="0.005")", R"(ixx="-0.01" iyy="0.01" izz="0.005")", { "upper", "positive definite" } },
  { R"(ixy="0")", R"(ixy="0.02")", { "upper", "positive definite" }, false },
  { R"(ixx="0.01" iyy="0.01" izz="0.005")", R"(ixx="0.5" iyy="0.5" izz="0.5")", { "upper", "radius of gyration" } },
  { R"(xyz="0 0 1")", R"(xyz="0 0 0")", { "joint one", "axis of length 0" } },
  { R"(xyz="0 0 1")", R"(xyz="0 1")", { "joint one", "\"0 1\"", "3 numbers" } },
  { R"(<limit lower="-1" upper="1" velocity="2" effort="10"/>)", "", { "joint one", "no limit" } },
  { R"(lower="-1" )", "", { "joint one", "no lower" } },
  { R"(upper="1")", R"(upper="-1")", { "joint one", "from -1 to -1" } },
  { R"(effort="10")", R"(effort="10Nm")", { "joint one", "\"10Nm\"", "finite number" } },
  { R"(upper="1")", R"(upper="inf")", { "joint one", "\"inf\"", "finite" } },
  { R"( effort="10")", "", { "joint one", "no effort" } },
  { R"(type="revolute")", R"(type="ball")", { "joint one", "\"ball\"", "revolute" } },
  { R"(type="revolute")", R"(type="floating")", { "joint one", "\"floating\"", "revolute" } },
  { R"(rpy="0.1 0.2 0.3")", R"(rpy="0.1 0.2 x")", { "joint one", "rpy", "3 finite numbers" } },
  { R"(<axis xyz="0 1 0"/>)", R"(<axis xyz="0 1 0"/><mimic joint="one"/>)", { "joint two", "mimic" } },
  { R"(<axis xyz="0 1 0"/>)", R"(<axis xyz="0 1 0"/><axis xyz="1 0 0"/>)", { "joint two", "second axis" } },
  { R"(<axis xyz="0 1 0"/>)", R"(<axes xyz="0 1 0"/>)", { "joint two", "axes", "did you mean axis" } },
  { R"(<link name="root"/>)", R"(<link name="root"><colision/></link>)", { "root", "did you mean collision" } },
  { R"(<box size="0.2 0.2 0.3"/>)", R"(<box size="0.2 0 0.3"/>)", { "lower", "box of size", "above 0" } },
  { R"(<box size="0.2 0.2 0.3"/>)", "<box/>", { "lower", "box has no size" } },
  { R"(<box size="0.2 0.2 0.3"/>)",
    R"(<mesh filename="a.stl"/>)",
    { "lower", "mesh", "a box, a cylinder or a sphere" } },
  { R"(<box size="0.2 0.2 0.3"/>)", "", { "lower", "nothing", "a box, a cylinder or a sphere" } },
  { R"(child link="upper")", R"(child link="uper")", { "joint one", "no link uper", "did you mean upper" }, false },
  { R"(<parent link="root"/>)", "", { "joint one", "no parent link" } },
  { R"(<link name="root"/>)", R"(<link name="root"/><link name="alone"/>)", { "2 roots", "root, alone" } },
  { R"(<link name="root"/>)", R"(<link name="root"/><link name="root"/>)", { "link root", "used twice" }, false },
  { R"(name="two" type)", R"(name="one" type)", { "joint one", "used twice" } },
  { R"(<parent link="root"/>)", R"(<parent link="lower"/>)", { "loop", "upper", "lower" }, false },
  { R"(</robot>)",
    R"(<joint name="three" type="fixed"><parent link="root"/><child link="lower"/></joint></robot>)",
    { "link lower", "joints two and three", "expected one" } },
  { R"(</robot>)",
    R"(<link name="a"/><link name="b"/>
     <joint name="three" type="fixed"><parent link="a"/><child link="b"/></joint>
     <joint name="four" type="fixed"><parent link="b"/><child link="a"/></joint></robot>)",
    { "loop", "a, b", "root" } },
  { R"(</robot>)",
    R"(<joint name="three" type="fixed"><parent link="lower"/><child link="root"/></joint></robot>)",
    { "no root", "loop" } },
  { R"(</robot>)",
    R"(<link name="tip"/><joint name="three" type="continuous"><parent link="lower"/><child link="tip"/></joint></robot>)",
    { "joint three", "tip", "mass 0 kg" } },
  { R"(<robot name="two">)", "<robot>", { "robot without a name" } },
  { R"(<link name="root"/>)", "<link/>", { "link without a name" }, false },
  { R"(<robot name="two">)", R"(<machine name="two">)", { "not XML" } },
};

void expectSaid(const std::vector<std::string>& errors, const Defect& defect)
{
  bool found = false;
  for (const std::string& error : errors)
  {
    bool all = true;
    for (const std::string& part : defect.said)
      all = all && error.find(part) != std::string::npos;
    found = found || all;
  }
  std::string list;
  for (const std::string& error : errors)
    list += "\n  " + error;
  EXPECT_TRUE(found) << "looking for \"" << defect.said.back() << "\" in" << list;
}
}  // namespace

TEST(RobotDescription, SoundOneIsRead)
{
  const RobotDescription robot = parseRobot(kSound, "test");
  ASSERT_EQ(robot.links.size(), 3u);
  const JointDescription& one = robot.joints[0];
  EXPECT_EQ(one.name, "one");
  EXPECT_EQ(one.damping, 0.1);
  EXPECT_EQ(one.friction, 0.2);
  EXPECT_EQ(one.armature, 0.3);
  EXPECT_EQ(one.upper, 1.0);
  EXPECT_EQ(one.effort, 10.0);
  // roll about x first, then pitch about y, then yaw about z: first column of Rz(0.3) Ry(0.2) Rx(0.1)
  const Eigen::Vector3d forward(std::cos(0.3) * std::cos(0.2), std::sin(0.3) * std::cos(0.2), -std::sin(0.2));
  EXPECT_LT((one.origin.linear().col(0) - forward).norm(), 1e-15);
  // inertia stated in axes turned by a right angle about x: y and z change places
  const auto turned = parseRobot(
      replaced(kSound, R"(<origin xyz="0 0 0.1"/>)", R"(<origin xyz="0 0 0.1" rpy="1.5707963267948966 0 0"/>)"),
      "test");
  EXPECT_NEAR(turned.links[1].inertia(1, 1), 0.005, 1e-15);
  EXPECT_EQ(robot.links[1].centre.z(), 0.1);
  EXPECT_EQ(robot.links[1].collision[0].size, Eigen::Vector3d(0.05, 0.3, 0.0));
  EXPECT_EQ(robot.links[2].collision.size(), 2u);
  EXPECT_THROW(robot.link("hand"), std::out_of_range);
}

TEST(RobotDescription, EveryErrorIsNamed)
{
  for (const auto* list : { &kCompatible, &kFurther })
    for (const Defect& defect : *list)
    {
      const auto errors = errorsOf(replaced(kSound, defect.from, defect.to));
      expectSaid(errors, defect);
      EXPECT_TRUE(errors.size() == 1 || !defect.alone) << errors.size() << " errors: " << defect.said.back();
    }
}

TEST(RobotDescription, AllErrorsAtOnce)
{
  std::string spoilt = kSound;
  for (const Defect& defect : kCompatible)
    spoilt = replaced(spoilt, defect.from, defect.to);
  const auto errors = errorsOf(spoilt);
  for (const Defect& defect : kCompatible)
    expectSaid(errors, defect);
  EXPECT_GE(errors.size(), kCompatible.size());
}

// Two sliders in line with nothing between them: the force on one says nothing about how each of them moves.
TEST(RobotDescription, RefusesJointsThatShareOneMotion)
{
  const std::string slider = R"(<joint name="a" type="prismatic"><parent link="x"/><child link="y"/>
    <axis xyz="AXIS"/><limit lower="0" upper="1" velocity="1" effort="1"/></joint>)";
  const std::string head = R"(<robot name="r"><link name="x"/><link name="y"/><link name="z"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>)";
  const std::string last = replaced(replaced(replaced(slider, "\"a\"", "\"b\""), "\"y\"", "\"z\""), "\"x\"", "\"y\"");
  const auto urdf = [&](const std::string& one, const std::string& two) {
    return head + replaced(slider, "AXIS", one) + replaced(last, "AXIS", two) + "</robot>";
  };
  EXPECT_TRUE(errorsOf(urdf("1 0 0", "0 1 0")).empty());
  const auto errors = errorsOf(urdf("1 0 0", "1 0 0"));
  ASSERT_EQ(errors.size(), 1u);
  EXPECT_NE(errors[0].find("joints a, b"), std::string::npos) << errors[0];
  // rotor inertia between them decides
  EXPECT_TRUE(errorsOf(replaced(urdf("1 0 0", "1 0 0"), R"(effort="1"/>)", R"(effort="1"/><dynamics armature="0.1"/>)"))
                  .empty());
}

// The inertias that a public model of the LWR 4+ states for base, links 1, 6 and 7: the loader finds all four.
TEST(RobotDescription, FindsTheWrongInertiasOfAPublicModel)
{
  std::string urdf = loadRobot("lwr").urdf;
  urdf = replaced(urdf, R"(ixx="0.00263" iyy="0.00281" izz="0.00307")", R"(ixx="0.0263" iyy="0.0281" izz="0.0307")");
  urdf = replaced(urdf, R"(ixx="0.0156" iyy="0.0153" izz="0.0044")", R"(ixx="0.156" iyy="0.153" izz="0.0441")");
  urdf = replaced(urdf, R"(ixx="0.00299" iyy="0.003" izz="0.00324")", R"(ixx="0.0299" iyy="0.03" izz="0.0324")");
  urdf = replaced(urdf, R"(ixx="4.4e-05" iyy="4.4e-05" izz="8.7e-05")", R"(ixx="0.0418" iyy="0.0418" izz="0.0701")");
  const auto errors = errorsOf(urdf);
  ASSERT_EQ(errors.size(), 4u);
  int k = 0;
  for (const char* link : { "lwr_base_link", "lwr_1_link", "lwr_6_link", "lwr_7_link" })
    EXPECT_NE(errors[std::size_t(k++)].find(link), std::string::npos);
}

// Every cut of the file, and thousands of spoilt bytes: an error or a description, never a crash, and never a number
// that is not finite.
TEST(RobotDescription, TruncatedAndGarbledFiles)
{
  const std::string sound = kSound;
  for (std::size_t length = 0; length < sound.size(); ++length)
    EXPECT_FALSE(errorsOf(sound.substr(0, length)).empty()) << length;
  phri_core::Random random(20260101);
  int accepted = 0;
  for (int trial = 0; trial < 5000; ++trial)
  {
    std::string garbled = sound;
    for (int k = 0; k < 1 + trial % 4; ++k)
      garbled[std::size_t(random.uniform(0.0, double(garbled.size())))] = char(random.bits());
    try
    {
      const RobotDescription robot = parseRobot(garbled, "test");
      ++accepted;
      ASSERT_EQ(robot.joints.size() + 1, robot.links.size());
      for (const LinkDescription& link : robot.links)
        ASSERT_TRUE(std::isfinite(link.mass) && link.inertia.allFinite() && link.centre.allFinite()) << garbled;
      for (const JointDescription& joint : robot.joints)
        ASSERT_TRUE(joint.origin.matrix().allFinite() && joint.lower <= joint.upper && joint.velocity > 0.0) << garbled;
    }
    catch (const DescriptionError& error)
    {
      ASSERT_FALSE(error.errors().empty());
    }
  }
  EXPECT_GT(accepted, 0);  // else the loop above looked at nothing
  EXPECT_FALSE(errorsOf("").empty());
  EXPECT_FALSE(errorsOf(std::string("<robot name='a'>\0</robot>", 25)).empty());
  EXPECT_FALSE(errorsOf(sound + sound).empty());
  std::string deep = "<robot name='a'>";
  for (int k = 0; k < 100000; ++k)
    deep += "<link>";
  EXPECT_FALSE(errorsOf(deep).empty());
}

TEST(RobotDescription, UnknownNameSaysWhatThereIs)
{
  try
  {
    loadRobot("dual_lvr");
    FAIL();
  }
  catch (const DescriptionError& error)
  {
    const std::string text = error.what();
    EXPECT_NE(text.find("did you mean dual_lwr"), std::string::npos) << text;
    EXPECT_NE(text.find("mobile_manipulator"), std::string::npos) << text;
  }
}
}  // namespace phri_sim
