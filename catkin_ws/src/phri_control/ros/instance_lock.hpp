#pragma once
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>

namespace phri_control
{
/// Keeps a second node of the same name on the same ROS master from starting: ROS would shut down the first one. The
/// lock is a file in a folder of the user's own, and goes with the process, however it ends.
class InstanceLock
{
public:
  /// Take it before the node registers with the master. Throws std::system_error if the lock file cannot be made.
  InstanceLock(const std::string& master_uri, const std::string& node_name)
  {
    namespace fs = std::filesystem;
    const std::string folder = (fs::temp_directory_path() / ("phri_locks_" + std::to_string(getuid()))).string();
    if (mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
      fail(folder);
    std::string path = master_uri + node_name;
    for (char& letter : path)
      if (!std::isalnum(static_cast<unsigned char>(letter)))
        letter = '_';
    path = folder + '/' + path + ".lock";
    file_ = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (file_ < 0)
      fail(path);
    const std::string own = std::to_string(getpid());
    char text[32] = {};
    if (flock(file_, LOCK_EX | LOCK_NB) != 0)
      holder_ = pread(file_, text, sizeof(text) - 1, 0) > 0 ? text : "unknown";
    else if (ftruncate(file_, 0) != 0 || pwrite(file_, own.data(), own.size(), 0) != ssize_t(own.size()))
      fail(path);
  }
  ~InstanceLock()
  {
    if (file_ >= 0)
      close(file_);
  }
  InstanceLock(const InstanceLock&) = delete;
  InstanceLock& operator=(const InstanceLock&) = delete;

  bool held() const { return holder_.empty(); }
  /// Process id of the node that has it, as text, if this one has not.
  const std::string& holder() const { return holder_; }

private:
  [[noreturn]] static void fail(const std::string& what)
  {
    throw std::system_error(errno, std::generic_category(), what);
  }
  std::string holder_;
  int file_ = -1;
};
}  // namespace phri_control
