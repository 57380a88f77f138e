#pragma once
#include <cstdint>
#include <map>
#include <string>

namespace phri_sim
{
/// Where the digests of a bag are: std_msgs/String, one every 0.5 s of session time and one at the end.
constexpr const char* kDigestTopic = "/phri/digest";

/// What a bag holds, so that a reader can tell whether it is still that (rosbag has no checksum of payloads). A digest
/// is about the messages since the one before it:
///   {"final":false,"messages":3019,"number":4,"time_ns":2500000000,
///    "topics":{"/phri/joint_states":[500,"8c0b2f11"]},"version":1,"crc32":"5d1e00a2"}
/// `messages`: all so far, digests not counted. Per topic: how many, and the CRC-32 (zlib's) over the text
/// "<topic>\0<type>\0<md5sum>\0<definition>\0" and then for each message seconds, nanoseconds and size (uint32, little
/// endian) and the serialised payload. The last field is the CRC-32 of the text before `,"crc32"`.
/// A CRC tells accidents, not forgers: every change of up to 3 bits, others but for one in 4e9.
class BagDigest
{
public:
  struct Kind
  {
    const char *type, *md5sum, *definition;
  };
  /// Adds a message.
  void add(const std::string& topic, const Kind& kind, std::uint32_t sec, std::uint32_t nsec, const std::uint8_t* data,
           std::uint32_t size);
  /// The digest of what was added since the last call. `final`: nothing follows.
  std::string take(std::int64_t time_ns, bool final);

private:
  struct Topic
  {
    std::uint32_t identity = 0, crc = 0;
    std::uint64_t count = 0;  ///< since the last digest
  };
  std::map<std::string, Topic> topics_;
  std::uint64_t messages_ = 0, number_ = 0;
};
}  // namespace phri_sim
