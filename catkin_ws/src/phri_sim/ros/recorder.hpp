#pragma once
#include <ros/serialization.h>
#include <rosbag/bag.h>
#include <std_msgs/String.h>

#include <cerrno>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "bag_digest.hpp"

namespace phri_sim
{
/// The bag cannot be written: disk full, no such folder, no permission.
class RecordingError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// A message as its bytes, with what a bag wants to know about its type. Refers to memory of others.
struct SerializedMessage
{
  BagDigest::Kind kind;
  const std::uint8_t* data;
  std::uint32_t size;
};

/// One bag, written as `<path>.active` and renamed to `<path>` when it is complete; an aborted one ends as
/// `<path>.aborted`, which no reader takes for a trial. lz4; chunks of 16 KB, so that a killed process or a full disk
/// costs the last 25 ms of a trial and not the last seconds (`phri-analysis recover` reads the rest); a digest of the
/// payloads every 0.5 s, see BagDigest. Never overwrites a file. Not for the tick: writes block. One thread at a time.
/// What was written survives the process, not a loss of power: nothing is forced to the disk.
class Recorder
{
public:
  static constexpr std::uint32_t kChunk = 16 * 1024;  ///< [byte], uncompressed

  /// `<folder>/<name>_<UTC>.bag`. Throws RecordingError.
  Recorder(const std::string& folder, const std::string& name, std::uint32_t chunk = kChunk);
  /// Ends as aborted unless `finish` was called.
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Throws RecordingError; the recorder is of no use then.
  template <typename Message>
  void write(const std::string& topic, const ros::Time& time, const Message& message)
  {
    put(topic, time, serialized(message), false);
  }
  /// The same for a topic that is latched when the bag is played.
  template <typename Message>
  void writeLatched(const std::string& topic, const ros::Time& time, const Message& message)
  {
    put(topic, time, serialized(message), true);
  }
  /// Completes the bag and returns its path. Throws RecordingError.
  std::string finish();
  /// Where the bag will be.
  const std::string& path() const { return path_; }

private:
  template <typename Message>
  SerializedMessage serialized(const Message& message)
  {
    namespace traits = ros::message_traits;
    const std::uint32_t size = ros::serialization::serializationLength(message);
    if (buffer_.size() < size)
      buffer_.resize(size);
    ros::serialization::OStream stream(buffer_.data(), size);
    ros::serialization::serialize(stream, message);
    return { { traits::datatype(message), traits::md5sum(message), traits::definition(message) },
             buffer_.data(),
             size };
  }
  void put(const std::string& topic, const ros::Time& time, const SerializedMessage& message, bool latched);
  void store(const std::string& topic, const ros::Time& time, const SerializedMessage& message, bool latched);
  void storeDigest(const ros::Time& time, bool final);
  template <typename Write>
  void guarded(Write&& write)
  {
    try
    {
      if (!bag_)
        throw std::runtime_error("the bag is closed");
      errno = 0;
      write();
    }
    catch (const std::exception& error)
    {
      giveUp(error.what());
    }
  }
  [[noreturn]] void giveUp(const std::string& why);

  std::string path_;
  std::unique_ptr<rosbag::Bag> bag_;
  std::vector<std::uint8_t> buffer_;
  BagDigest digest_;
  ros::Time last_, digested_;  ///< times of the newest message and of the newest digest
};
}  // namespace phri_sim

namespace ros
{
namespace message_traits
{
template <>
struct MD5Sum<phri_sim::SerializedMessage>
{
  static const char* value(const phri_sim::SerializedMessage& message) { return message.kind.md5sum; }
};
template <>
struct DataType<phri_sim::SerializedMessage>
{
  static const char* value(const phri_sim::SerializedMessage& message) { return message.kind.type; }
};
template <>
struct Definition<phri_sim::SerializedMessage>
{
  static const char* value(const phri_sim::SerializedMessage& message) { return message.kind.definition; }
};
}  // namespace message_traits
namespace serialization
{
template <>
struct Serializer<phri_sim::SerializedMessage>
{
  template <typename Stream>
  static void write(Stream& stream, const phri_sim::SerializedMessage& message)
  {
    std::copy(message.data, message.data + message.size, stream.advance(message.size));
  }
  static std::uint32_t serializedLength(const phri_sim::SerializedMessage& message) { return message.size; }
};
}  // namespace serialization
}  // namespace ros
