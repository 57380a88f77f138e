// Joint transport over topics: the same numbers as in process, wrenches by the rule, one tree of frames.
#include <geometry_msgs/WrenchStamped.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <phri_msgs/RunTrial.h>
#include <phri_msgs/Tick.h>
#include <ros/ros.h>
#include <rosbag/view.h>
#include <sensor_msgs/JointState.h>
#include <std_msgs/String.h>
#include <std_srvs/Trigger.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>

#include <cmath>
#include <filesystem>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>

#include "../ros/node_settings.hpp"

using namespace phri_sim;

namespace
{
constexpr int kTrials = 4, kSeed = 7, kDof = 3;
constexpr double kRounding = 1e-12;  // [m/s, rad/s] of a velocity that a few products lead to
constexpr double kPlace = 1e-4;      // [m] joints move by less in the tick between two sources of transforms
constexpr std::uint32_t kMotion =
    0x1c0;  // limits workspace, velocity, acceleration: motion is not the admittance's alone
const char* const kWrenches[] = { "human", "environment", "assistance", "requested" };

/// One bag's numbers at 1 kHz, and what it has less often.
struct Bag
{
  std::vector<phri_msgs::Tick> ticks;
  std::vector<sensor_msgs::JointState> object, joints;
  std::map<std::string, std::vector<geometry_msgs::WrenchStamped>> wrenches;
  std::vector<nav_msgs::Odometry> odom;
  std::vector<nlohmann::json> metadata;
  std::map<std::string, int> counts;
};

Bag read(const std::string& path)
{
  const rosbag::Bag file(path, rosbag::bagmode::Read);
  Bag bag;
  for (const rosbag::MessageInstance& m : rosbag::View(file))
  {
    const std::string name = m.getTopic().substr(m.getTopic().find('/', 1) + 1);
    ++bag.counts[name];
    if (const auto tick = m.instantiate<phri_msgs::Tick>())
      bag.ticks.push_back(*tick);
    else if (const auto joints = m.instantiate<sensor_msgs::JointState>())
      (name == "joint_states" ? bag.joints : bag.object).push_back(*joints);
    else if (const auto wrench = m.instantiate<geometry_msgs::WrenchStamped>())
      bag.wrenches[name].push_back(*wrench);
    else if (const auto odom = m.instantiate<nav_msgs::Odometry>())
      bag.odom.push_back(*odom);
    else if (name == "metadata")
      bag.metadata.push_back(nlohmann::json::parse(m.instantiate<std_msgs::String>()->data));
  }
  return bag;
}

Eigen::Vector3d planar(const geometry_msgs::WrenchStamped& message)
{
  return { message.wrench.force.x, message.wrench.force.y, message.wrench.torque.z };
}

Eigen::Vector3d vector(const std::vector<double>& values)
{
  return Eigen::Map<const Eigen::VectorXd>(values.data(), kDof);
}

Experiment experimentOfParameters()
{
  XmlRpc::XmlRpcValue tree;
  ros::param::get("~overrides", tree);
  std::vector<std::string> errors;
  return loadExperiment("transport", flatten(tree, errors));
}

class Transport : public ::testing::Test
{
protected:
  /// Runs all trials once; the transforms seen meanwhile, and who sent them.
  static void SetUpTestSuite()
  {
    ros::NodeHandle node;
    using Event = ros::MessageEvent<tf2_msgs::TFMessage const>;
    const auto take = [](bool fixed) {
      return boost::function<void(const Event&)>([fixed](const Event& event) {
        const std::lock_guard<std::mutex> lock(mutex);
        for (const auto& transform : event.getConstMessage()->transforms)
        {
          publishers[transform.child_frame_id].insert(event.getPublisherName());
          frames.setTransform(transform, event.getPublisherName(), fixed);
        }
      });
    };
    const ros::Subscriber tf = node.subscribe<tf2_msgs::TFMessage>("/tf", 1000, take(false));
    const ros::Subscriber tf_static = node.subscribe<tf2_msgs::TFMessage>("/tf_static", 1000, take(true));
    folder = ros::param::param<std::string>("~folder", "/tmp/phri_transport");
    std::filesystem::remove_all(folder);
    experiment = std::make_shared<const Experiment>(experimentOfParameters());
    for (const char* name : { "learner/forget", "learner/learn", "experiment_node/run_trial" })
      ASSERT_TRUE(ros::service::waitForService(name, 60000)) << name;
    std_srvs::Trigger trigger;
    ASSERT_TRUE(ros::service::call("learner/forget", trigger));
    block = { 0, "pd", kSeed, {} };
    for (int trial = 1; trial <= kTrials; ++trial)
    {
      block.trials.push_back(trialSpec(0, "pd", trial, kTrials, trial - 1, kSeed));
      const phri_msgs::RunTrialResponse response = run("experiment_node", trial, true);
      ASSERT_TRUE(response.success) << response.message;
      bags.push_back(read(response.bag));
      ASSERT_TRUE(ros::service::call("learner/learn", trigger));
    }
    logs = runBlock(experiment, block);
  }

  static phri_msgs::RunTrialResponse run(const std::string& node, int trial, bool use_model)
  {
    phri_msgs::RunTrial call;
    call.request.controller = "pd";
    call.request.trial = trial;
    call.request.trials = kTrials;
    call.request.practice = trial - 1;
    call.request.study_seed = kSeed;
    call.request.use_model = use_model;
    call.request.bag_dir = folder;
    ros::service::call(node + "/run_trial", call);
    return call.response;
  }

  static inline std::string folder;
  static inline std::shared_ptr<const Experiment> experiment;
  static inline Block block;
  static inline std::vector<Bag> bags;
  static inline std::vector<TrialLog> logs;
  static inline std::mutex mutex;
  static inline std::map<std::string, std::set<std::string>> publishers;
  static inline tf2_ros::Buffer frames{ ros::Duration(1000.0) };
};
}  // namespace

// Lockstep is exact: the same tick, the same calls of the model, and messages that change no bit.
TEST_F(Transport, NumbersEqualThoseWithoutRos)
{
  ASSERT_EQ(bags.size(), std::size_t(kTrials));
  for (std::size_t k = 0; k < bags.size(); ++k)
  {
    Bag& bag = bags[k];
    ASSERT_EQ(bag.ticks.size(), logs[k].ticks.size());
    for (std::size_t i = 0; i < bag.ticks.size(); ++i)
    {
      const phri_control::TickRecord& tick = logs[k].ticks[i];
      ASSERT_EQ(vector(bag.object[i].position), Eigen::Vector3d(tick.position)) << "trial " << k + 1 << " tick " << i;
      ASSERT_EQ(vector(bag.object[i].velocity), Eigen::Vector3d(tick.velocity)) << "trial " << k + 1 << " tick " << i;
      ASSERT_EQ(planar(bag.wrenches["human_wrench"][i]), Eigen::Vector3d(tick.human_wrench));
      ASSERT_EQ(planar(bag.wrenches["assistance_wrench"][i]), Eigen::Vector3d(tick.assistance_wrench));
      ASSERT_EQ(bag.ticks[i].passivity, tick.passivity);
    }
  }
  double largest = 0.0;  // of the last trial: the learner did speak
  for (const auto& wrench : bags.back().wrenches["assistance_wrench"])
    largest = std::max(largest, planar(wrench).norm());
  EXPECT_GT(largest, 0.0);
}

// With these signs, in these axes, the recorded wrenches are what moves the object: each coordinate obeys
// v+ = a v + (1 - a) u / D, a = exp(-D dt / M). A turned sign or a torque in a force's place cannot pass.
TEST_F(Transport, WrenchesMoveTheObject)
{
  for (Bag& bag : bags)
  {
    std::size_t free = 0;
    for (std::size_t i = 0; i + 1 < bag.ticks.size(); ++i)
    {
      if (bag.ticks[i].limits & kMotion)
        continue;
      ++free;
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const char* agent : { "human", "environment", "assistance" })
        sum += planar(bag.wrenches[std::string(agent) + "_wrench"][i]);
      for (int axis = 0; axis < kDof; ++axis)
      {
        const double d = experiment->loop.damping(axis), a = std::exp(-d * 0.001 / experiment->loop.mass(axis));
        ASSERT_NEAR(bag.object[i + 1].velocity[std::size_t(axis)],
                    a * bag.object[i].velocity[std::size_t(axis)] + (1.0 - a) * sum(axis) / d, kRounding)
            << "tick " << i << " axis " << axis;
      }
    }
    EXPECT_GT(double(free), 0.5 * double(bag.ticks.size()));
  }
}

// The loop's human wrench is the sensor's, three of six coordinates; the gripper's own weight is not in it.
TEST_F(Transport, SensorTopicsHoldWhatTheLoopFelt)
{
  Bag& bag = bags.front();
  const auto& wrench = bag.wrenches["arm_right/ft_sensor/wrench"];
  const auto& raw = bag.wrenches["arm_right/ft_sensor/wrench_raw"];
  const auto& human = bag.wrenches["human_wrench"];
  ASSERT_EQ(wrench.size(), bag.ticks.size());
  ASSERT_EQ(raw.size(), bag.ticks.size());
  for (std::size_t i = 0; i < wrench.size(); ++i)
    ASSERT_EQ(planar(wrench[i]), planar(human[i])) << "tick " << i;
  EXPECT_EQ(wrench.front().header.frame_id, "grasp");
  EXPECT_EQ(human.front().header.frame_id, "grasp");
  EXPECT_EQ(raw.front().header.frame_id, "arm_right_ft_link");
  const auto size = [](const geometry_msgs::Vector3& v) { return Eigen::Vector3d(v.x, v.y, v.z).norm(); };
  EXPECT_GT(size(raw.front().wrench.force), 5.0) << "gripper and bumper weigh more";
  EXPECT_LT(size(wrench.front().wrench.force), 5.0);
}

TEST_F(Transport, JointsAreTheRobotsAndTheBaseIsWhereOdometrySays)
{
  const Bag& bag = bags.front();
  std::set<std::string> moving;
  for (const JointDescription& joint : loadRobot("mobile_manipulator").joints)
    if (joint.kind != JointKind::Fixed)
      moving.insert(joint.name);
  ASSERT_EQ(bag.joints.size(), bag.odom.size());
  for (std::size_t i = 0; i < bag.joints.size(); ++i)
  {
    const sensor_msgs::JointState& joints = bag.joints[i];
    ASSERT_EQ(std::set<std::string>(joints.name.begin(), joints.name.end()), moving);
    std::map<std::string, double> at;
    for (std::size_t k = 0; k < joints.name.size(); ++k)
      at[joints.name[k]] = joints.position[k];
    const geometry_msgs::Pose& pose = bag.odom[i].pose.pose;
    ASSERT_EQ(at["base_x_joint"], pose.position.x);
    ASSERT_EQ(at["base_y_joint"], pose.position.y);
    ASSERT_NEAR(
        std::remainder(at["base_yaw_joint"] - 2.0 * std::atan2(pose.orientation.z, pose.orientation.w), 2.0 * M_PI),
        0.0, kRounding);
  }
}

// robot_state_publisher knows the robot from its URDF alone, the simulator from its own tree: the gripper is where
// `grasp` is. Nobody publishes a frame that another one does.
TEST_F(Transport, FramesAgreeAndHaveOnePublisherEach)
{
  const std::lock_guard<std::mutex> lock(mutex);
  ASSERT_TRUE(publishers.count("odom") && publishers.count("grasp") && publishers.count("arm_right_7_link"));
  for (const auto& [frame, names] : publishers)
    EXPECT_EQ(names.size(), 1u) << frame;
  std::string error;
  ros::Time both;
  const auto chain = frames._lookupFrameNumber("arm_right_7_link");
  frames._getLatestCommonTime(chain, frames._lookupFrameNumber("grasp"), both, &error);
  ASSERT_TRUE(error.empty()) << error;
  const RobotDescription robot = loadRobot("mobile_manipulator");
  Eigen::Isometry3d tip = Eigen::Isometry3d::Identity();  // of the last link: fixed joints only
  for (std::string link = "arm_right_gripper_tcp"; link != "arm_right_7_link";)
    for (const JointDescription& joint : robot.joints)
      if (joint.child == link)
      {
        tip = joint.origin * tip;
        link = joint.parent;
        break;
      }
  const geometry_msgs::Transform at = frames.lookupTransform("grasp", "arm_right_7_link", both).transform;
  const Eigen::Quaterniond turn(at.rotation.w, at.rotation.x, at.rotation.y, at.rotation.z);
  const Eigen::Vector3d off =
      Eigen::Vector3d(at.translation.x, at.translation.y, at.translation.z) + turn * tip.translation();
  EXPECT_LT(off.norm(), kPlace) << off.transpose();
}

TEST_F(Transport, MetadataTellsLabAndRoute)
{
  for (const Bag& bag : bags)
  {
    ASSERT_EQ(bag.metadata.size(), 2u);
    const nlohmann::json& told = bag.metadata.back();
    EXPECT_EQ(told["task"], "transport");
    EXPECT_EQ(told["scene"], experiment->lab->name);
    EXPECT_EQ(told["route"]["name"], "left_of_car");
    EXPECT_EQ(told["route"]["waypoints"].size(), experiment->lab->route("left_of_car").waypoints.size());
    EXPECT_EQ(told["obstacles"].size(), experiment->lab->boxes.size());
    EXPECT_EQ(bag.counts.at("lab"), 1);
  }
}

TEST_F(Transport, RunsInRealTime)
{
  const phri_msgs::RunTrialResponse response = run("/realtime/experiment_node", 1, false);
  ASSERT_TRUE(response.success) << response.message;
  EXPECT_FALSE(response.completed);
  const Bag bag = read(response.bag);
  ASSERT_FALSE(bag.ticks.empty());
  EXPECT_EQ(bag.ticks.back().fault, 0);
  EXPECT_GT(bag.ticks.back().t, 1.9);
}

int main(int argc, char** argv)
{
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "rostest_transport");
  ros::NodeHandle keep;
  ros::AsyncSpinner spinner(2);
  spinner.start();
  const int result = RUN_ALL_TESTS();
  ros::shutdown();
  return result;
}
