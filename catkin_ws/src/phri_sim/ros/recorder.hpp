#pragma once
#include <rosbag/bag.h>

#include <cerrno>
#include <memory>
#include <stdexcept>
#include <string>

namespace phri_sim
{
/// The bag cannot be written: disk full, no such folder, no permission.
class RecordingError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// One bag, written as `<path>.active` and renamed to `<path>` when it is complete; an aborted one ends as
/// `<path>.aborted`, which no reader takes for a trial. lz4, small chunks (a killed process loses little). Never
/// overwrites a file. Not for the tick: writes block.
class Recorder
{
public:
  /// `<folder>/<name>_<UTC>.bag`. Throws RecordingError.
  Recorder(const std::string& folder, const std::string& name);
  /// Ends as aborted unless `finish` was called.
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Throws RecordingError; the recorder is of no use then.
  template <typename Message>
  void write(const std::string& topic, const ros::Time& time, const Message& message)
  {
    guarded([&] { bag_->write(topic, time, message); });
  }
  /// The same for a topic that is latched when the bag is played.
  template <typename Message>
  void writeLatched(const std::string& topic, const ros::Time& time, const Message& message)
  {
    // a connection header of one's own must be complete: rosbag adds nothing to it
    const auto header = boost::make_shared<ros::M_string>();
    (*header)["type"] = ros::message_traits::datatype(message);
    (*header)["md5sum"] = ros::message_traits::md5sum(message);
    (*header)["message_definition"] = ros::message_traits::definition(message);
    (*header)["topic"] = topic;
    (*header)["latching"] = "1";
    guarded([&] { bag_->write(topic, time, message, header); });
  }
  /// Completes the bag and returns its path. Throws RecordingError.
  std::string finish();
  /// Where the bag will be.
  const std::string& path() const { return path_; }

private:
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
};
}  // namespace phri_sim
