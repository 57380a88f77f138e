#include "bag_digest.hpp"

#include <zlib.h>

#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>

namespace phri_sim
{
namespace
{
std::uint32_t extend(std::uint32_t crc, const void* data, std::size_t size)
{
  return std::uint32_t(crc32_z(crc, static_cast<const Bytef*>(data), size));
}

std::uint32_t extend(std::uint32_t crc, std::uint32_t number)
{
  const std::uint8_t bytes[] = { std::uint8_t(number), std::uint8_t(number >> 8), std::uint8_t(number >> 16),
                                 std::uint8_t(number >> 24) };
  return extend(crc, bytes, sizeof(bytes));
}

std::string hex(std::uint32_t crc)
{
  char text[9];
  std::snprintf(text, sizeof(text), "%08x", crc);
  return text;
}
}  // namespace

void BagDigest::add(const std::string& topic, const Kind& kind, std::uint32_t sec, std::uint32_t nsec,
                    const std::uint8_t* data, std::uint32_t size)
{
  const auto [entry, is_new] = topics_.try_emplace(topic);
  Topic& sum = entry->second;
  if (is_new)
  {
    for (const char* text : { topic.c_str(), kind.type, kind.md5sum, kind.definition })
      sum.identity = extend(sum.identity, text, std::strlen(text) + 1);
    sum.crc = sum.identity;
  }
  sum.crc = extend(extend(extend(sum.crc, sec), nsec), size);
  // zlib takes an empty payload's null pointer for a wish to start anew
  if (size > 0)
    sum.crc = extend(sum.crc, data, size);
  ++sum.count;
  ++messages_;
}

std::string BagDigest::take(std::int64_t time_ns, bool final)
{
  nlohmann::json topics = nlohmann::json::object();
  for (auto& [name, sum] : topics_)
  {
    if (sum.count > 0)
      topics[name] = { sum.count, hex(sum.crc) };
    sum.crc = sum.identity;
    sum.count = 0;
  }
  std::string text = nlohmann::json{
    { "final", final },     { "messages", messages_ }, { "number", number_++ },
    { "time_ns", time_ns }, { "topics", topics },      { "version", 1 }
  }.dump();
  text.pop_back();
  const std::uint32_t crc = extend(0, text.data(), text.size());
  return text + ",\"crc32\":\"" + hex(crc) + "\"}";
}
}  // namespace phri_sim
