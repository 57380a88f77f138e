#include "recorder.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <filesystem>

namespace phri_sim
{
namespace
{
namespace fs = std::filesystem;
const ros::Duration kDigestPeriod(0.5);

std::string utc()
{
  const std::time_t now = std::time(nullptr);
  std::tm parts;
  gmtime_r(&now, &parts);
  char text[32];
  std::strftime(text, sizeof(text), "%Y%m%dT%H%M%SZ", &parts);
  return text;
}

/// The first of `<stem>.bag`, `<stem>_2.bag`, ... that is free; its `.active` file is ours from here on.
std::string reserve(const std::string& stem)
{
  for (int copy = 1; copy < 1000; ++copy)
  {
    const std::string path = stem + (copy > 1 ? "_" + std::to_string(copy) : "") + ".bag";
    if (fs::exists(path) || fs::exists(path + ".aborted"))
      continue;
    const int file = open((path + ".active").c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
    if (file >= 0)
    {
      close(file);
      return path;
    }
    if (errno != EEXIST)
      throw RecordingError(path + ".active: " + std::strerror(errno));
  }
  throw RecordingError(stem + ".bag: no free name left");
}
}  // namespace

Recorder::Recorder(const std::string& folder, const std::string& name, std::uint32_t chunk)
{
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    throw RecordingError(folder + ": " + error.message());
  path_ = reserve(folder + '/' + name + '_' + utc());
  bag_ = std::make_unique<rosbag::Bag>();
  guarded([&] {
    bag_->open(path_ + ".active", rosbag::bagmode::Write);
    bag_->setCompression(rosbag::compression::LZ4);
    bag_->setChunkThreshold(chunk);
  });
}

Recorder::~Recorder()
{
  if (!bag_)
    return;
  try
  {
    storeDigest(last_, true);
    guarded([&] { bag_->close(); });
    bag_.reset();
    fs::rename(path_ + ".active", path_ + ".aborted");
  }
  catch (const std::exception&)
  {
    // what was written stays as .active
  }
}

void Recorder::put(const std::string& topic, const ros::Time& time, const SerializedMessage& message, bool latched)
{
  if (digested_.isZero())
    digested_ = time;
  digest_.add(topic, message.kind, time.sec, time.nsec, message.data, message.size);
  store(topic, time, message, latched);
  last_ = std::max(last_, time);
  if (time - digested_ >= kDigestPeriod)
    storeDigest(time, false);
}

void Recorder::store(const std::string& topic, const ros::Time& time, const SerializedMessage& message, bool latched)
{
  boost::shared_ptr<ros::M_string> header;
  if (latched)
  {
    // a connection header of one's own must be complete: rosbag adds nothing to it
    header = boost::make_shared<ros::M_string>();
    (*header)["type"] = message.kind.type;
    (*header)["md5sum"] = message.kind.md5sum;
    (*header)["message_definition"] = message.kind.definition;
    (*header)["topic"] = topic;
    (*header)["latching"] = "1";
  }
  guarded([&] { bag_->write(topic, time, message, header); });
}

void Recorder::storeDigest(const ros::Time& time, bool final)
{
  std_msgs::String text;
  text.data = digest_.take(time.toNSec(), final);
  digested_ = time;
  store(kDigestTopic, time.isZero() ? ros::TIME_MIN : time, serialized(text), false);
}

std::string Recorder::finish()
{
  storeDigest(last_, true);
  guarded([&] { bag_->close(); });
  bag_.reset();
  std::error_code error;
  fs::rename(path_ + ".active", path_, error);
  if (error)
    throw RecordingError(path_ + ": " + error.message());
  return path_;
}

void Recorder::giveUp(const std::string& why)
{
  const std::string reason = errno != 0 ? std::string(" (") + std::strerror(errno) + ")" : "";
  bag_.release();  // leaked on purpose: its destructor writes again, and throws
  throw RecordingError(path_ + ": " + why + reason);
}
}  // namespace phri_sim
