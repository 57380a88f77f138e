// Reading recordings needs no master.
#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <functional>

#include "../ros/replay_hand.hpp"
#include "../ros/trial_messages.hpp"

using namespace phri_sim;
using Eigen::Vector2d;

namespace
{
constexpr double kDt = 0.001;  // [s]

/// Bags of one test, in a folder of their own.
struct Folder
{
  std::filesystem::path path = std::filesystem::temp_directory_path() / ("replay_" + std::to_string(getpid()));
  int count = 0;
  Folder() { std::filesystem::create_directories(path); }
  ~Folder() { std::filesystem::remove_all(path); }
};

std::string bagWith(int ticks, const std::function<void(int, TickMessages&)>& spoil)
{
  static Folder folder;
  const std::string path = folder.path / (std::to_string(folder.count++) + ".bag");
  rosbag::Bag bag(path, rosbag::bagmode::Write);
  phri_control::TickRecord record;
  record.human_wrench = record.environment_wrench = record.assistance_wrench = record.requested_wrench = Vector2d(0, 0);
  record.velocity = Vector2d(0, 0);
  TickMessages messages;
  for (int k = 0; k < ticks; ++k)
  {
    record.time_ns = k * 1000000LL;
    record.position = Vector2d(0.1 / 3.0 * k, -k);
    record.human_wrench = Vector2d(k / 7.0, 1.0 / (k + 1));
    const ros::Time stamp(1.0 + k * kDt);
    messages.fill(record, stamp);
    spoil(k, messages);
    bag.write("/phri/experiment_node/tick", stamp, messages.tick);
    bag.write("/phri/joint_states", stamp, messages.joints);
    if (!messages.human.header.frame_id.empty())
      bag.write("/phri/human_wrench", stamp, messages.human);
  }
  bag.close();
  return path;
}

std::string errorOf(const std::string& path)
{
  try
  {
    readRecording(path, kDt);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}
}  // namespace

TEST(ReplayHand, ARecordingIsReadToTheLastBit)
{
  HandSettings settings;
  settings.bag = bagWith(50, [](int, TickMessages&) {});
  const Recording recording = readRecording(settings.bag, kDt);
  ASSERT_EQ(recording.forces.size(), 50u);
  for (int k = 0; k < 50; ++k)
  {
    EXPECT_EQ(recording.positions[k], Vector2d(0.1 / 3.0 * k, -k));
    EXPECT_EQ(recording.forces[k], Vector2d(k / 7.0, 1.0 / (k + 1)));
  }
  ReplayHand source(settings, kDt);
  EXPECT_EQ(source.waitingFor(), "");
  EXPECT_TRUE(source.autostart());
  for (int trial = 0; trial < 2; ++trial)
  {
    const std::unique_ptr<Hand> hand = source.hand(TrialSpec());
    hand->act({});
    EXPECT_EQ(hand->act({}).force, Vector2d(1.0 / 7.0, 0.5)) << "every trial from the start";
  }
}

TEST(ReplayHand, ABadRecordingIsNamedWithItsCause)
{
  const auto expect = [](const std::string& path, const std::string& cause) {
    const std::string error = errorOf(path);
    EXPECT_NE(error.find(path), std::string::npos) << error;
    EXPECT_NE(error.find(cause), std::string::npos) << error;
  };
  expect("/no/such/file.bag", "no such file");
  expect(bagWith(0, [](int, TickMessages&) {}), "no topic .../tick");
  expect(bagWith(20, [](int k, TickMessages& m) { m.human.header.frame_id = k == 7 ? "" : kFrame; }),
         "20 ticks, but 20 joint states and 19 human wrenches");
  expect(bagWith(20, [](int k, TickMessages& m) { m.tick.t += k > 10 ? 0.001 : 0.0; }), "tick 11");
  expect(bagWith(20, [](int k, TickMessages& m) { m.human.wrench.force.x = k == 3 ? std::nan("") : 0; }), "tick 3");
  expect(bagWith(20, [](int, TickMessages& m) { m.human.header.frame_id = "ft"; }), "frame ft");
  expect(bagWith(20, [](int, TickMessages& m) { m.joints.name[0] = "a"; }), "other joints");
  const std::string cut = bagWith(2000, [](int, TickMessages&) {});
  std::filesystem::resize_file(cut, std::filesystem::file_size(cut) / 2);
  EXPECT_NE(errorOf(cut).find(cut), std::string::npos) << "a truncated bag";
}
