#include "../ros/recorder.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>

#include "../ros/trial_messages.hpp"

namespace
{
namespace fs = std::filesystem;
using phri_sim::Recorder;

constexpr double kTick = 1e-3;  // [s]

class RecorderTest : public testing::Test
{
protected:
  void SetUp() override
  {
    std::string name = (fs::temp_directory_path() / "phri_recorder_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::vector<std::string> files() const
  {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_))
      names.push_back(entry.path().filename());
    std::sort(names.begin(), names.end());
    return names;
  }
  static ros::Time at(int tick) { return ros::Time().fromSec(1.0 + kTick * tick); }
  static std_msgs::String text(const std::string& data)
  {
    std_msgs::String message;
    message.data = data;
    return message;
  }

  fs::path folder_;
};
}  // namespace

// What a CRC over nothing, over the standard's check string and over two halves must be.
TEST(BagDigest, IsTheCrcThatEverybodyHas)
{
  // identity of a topic with empty names: four zero bytes; CRC-32 of them is 2144df1c
  phri_sim::BagDigest digest;
  EXPECT_NE(digest.take(7, false).find(R"({"final":false,"messages":0,"number":0,"time_ns":7,"topics":{},"version":1)"),
            std::string::npos);
  const phri_sim::BagDigest::Kind none{ "", "", "" };
  digest.add("", none, 0, 0, nullptr, 0);
  // 4 + 12 zero bytes: CRC-32 of sixteen zero bytes is ecbb4b55
  EXPECT_NE(digest.take(8, true).find(R"("topics":{"":[1,"ecbb4b55"]})"), std::string::npos);
}

TEST(BagDigest, ConcernsOnlyWhatCameSinceTheLastOne)
{
  const phri_sim::BagDigest::Kind kind{ "t", "m", "d" };
  const std::uint8_t payload[] = { 1, 2, 3 };
  phri_sim::BagDigest once, twice;
  once.add("a", kind, 1, 2, payload, 3);
  twice.add("a", kind, 9, 9, payload, 3);
  twice.add("b", kind, 9, 9, payload, 3);
  const std::string first = twice.take(0, false);
  EXPECT_NE(first.find("\"b\""), std::string::npos);
  twice.add("a", kind, 1, 2, payload, 3);
  const auto topics = [](const std::string& text) {
    return text.substr(text.find("\"topics\""), text.find("\"version\"") - text.find("\"topics\""));
  };
  const std::string second = twice.take(0, false);
  EXPECT_EQ(topics(second), topics(once.take(0, false)));
  EXPECT_NE(second.find("\"messages\":3,\"number\":1"), std::string::npos);
}

// Every one of the things that a reader relies on enters the sum.
TEST(BagDigest, AnyChangeChangesIt)
{
  const auto digest = [](const std::string& topic, phri_sim::BagDigest::Kind kind, std::uint32_t sec,
                         std::uint32_t nsec, std::vector<std::uint8_t> payload) {
    phri_sim::BagDigest made;
    made.add(topic, kind, sec, nsec, payload.data(), std::uint32_t(payload.size()));
    return made.take(0, true);
  };
  const std::vector<std::string> all = {
    digest("a", { "t", "m", "d" }, 1, 2, { 1, 2 }), digest("b", { "t", "m", "d" }, 1, 2, { 1, 2 }),
    digest("a", { "u", "m", "d" }, 1, 2, { 1, 2 }), digest("a", { "t", "n", "d" }, 1, 2, { 1, 2 }),
    digest("a", { "t", "m", "e" }, 1, 2, { 1, 2 }), digest("a", { "t", "m", "d" }, 2, 2, { 1, 2 }),
    digest("a", { "t", "m", "d" }, 1, 3, { 1, 2 }), digest("a", { "t", "m", "d" }, 1, 2, { 2, 1 }),
    digest("a", { "t", "m", "d" }, 1, 2, { 1 }),    digest("a", { "t", "m", "d" }, 1, 2, { 1, 2, 0 }),
  };
  EXPECT_EQ(std::set<std::string>(all.begin(), all.end()).size(), all.size());
}

TEST_F(RecorderTest, NeverOverwrites)
{
  std::vector<std::string> paths;
  for (int i = 0; i < 3; ++i)
  {
    Recorder recorder(folder_, "trial");
    recorder.write("/x", at(0), text("a"));
    paths.push_back(recorder.finish());
  }
  EXPECT_EQ(std::set<std::string>(paths.begin(), paths.end()).size(), 3u);
  EXPECT_EQ(files().size(), 3u);
  Recorder first(folder_, "other"), second(folder_, "other");
  EXPECT_NE(first.path(), second.path());
}

TEST_F(RecorderTest, OnlyACompleteBagIsCalledOne)
{
  const auto suffix = [this] { return fs::path(files().at(0)).extension().string(); };
  {
    Recorder recorder(folder_, "trial");
    recorder.write("/x", at(0), text("a"));
    EXPECT_EQ(suffix(), ".active");
  }
  EXPECT_EQ(suffix(), ".aborted");
  Recorder recorder(folder_, "whole");
  EXPECT_EQ(fs::path(recorder.finish()).extension(), ".bag");
  EXPECT_THROW(recorder.write("/x", at(0), text("a")), phri_sim::RecordingError);
}

// What a killed process loses is a chunk at most: none is larger than the limit and the message that reached it.
TEST_F(RecorderTest, ChunksAreSmallAndCompressed)
{
  constexpr int kTicks = 1600;
  constexpr std::uint32_t kLargestMessage = 1024;  // [byte] with its header; digests and definitions included
  Recorder recorder(folder_, "trial");
  phri_sim::TickMessages messages;
  for (int tick = 0; tick < kTicks; ++tick)
    recorder.write("/tick", at(tick), messages.tick);
  std::ifstream file(recorder.finish(), std::ios::binary);
  const std::string content((std::istreambuf_iterator<char>(file)), {});
  const std::string mark{ "compression=lz4\x04\0\0\0op=\x05\x09\0\0\0size=", 32 };
  std::size_t chunks = 0;
  for (std::size_t at = content.find(mark); at != std::string::npos; at = content.find(mark, at + 1), ++chunks)
  {
    std::uint32_t size = 0;
    std::memcpy(&size, content.data() + at + mark.size(), sizeof(size));
    EXPECT_GT(size, 0u);
    EXPECT_LE(size, Recorder::kChunk + kLargestMessage);
  }
  EXPECT_GT(chunks, kTicks * messages.tick.header.frame_id.size() * 4 / Recorder::kChunk);
}

TEST_F(RecorderTest, AFolderThatCannotBeMadeIsNamed)
{
  std::ofstream(folder_ / "file") << "x";
  try
  {
    Recorder recorder(folder_ / "file" / "sub", "trial");
    FAIL() << "expected a RecordingError";
  }
  catch (const phri_sim::RecordingError& error)
  {
    EXPECT_NE(std::string(error.what()).find("file/sub"), std::string::npos) << error.what();
  }
}
