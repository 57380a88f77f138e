#include "instance_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <filesystem>
#include <system_error>

namespace phri_sim
{
InstanceLock::InstanceLock(const std::string& master_uri, const std::string& node_name)
{
  // a folder of one's own: nobody else can put a file in the way
  const std::string folder =
      (std::filesystem::temp_directory_path() / ("phri_locks_" + std::to_string(getuid()))).string();
  if (mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
    throw std::system_error(errno, std::generic_category(), folder);
  std::string name = master_uri + node_name;
  for (char& letter : name)
    if (!std::isalnum(static_cast<unsigned char>(letter)))
      letter = '_';
  path_ = folder + '/' + name + ".lock";
  file_ = open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (file_ < 0)
    throw std::system_error(errno, std::generic_category(), path_);
  if (flock(file_, LOCK_EX | LOCK_NB) != 0)
  {
    char text[32] = {};
    const ssize_t length = pread(file_, text, sizeof(text) - 1, 0);
    holder_ = length > 0 ? std::string(text, length) : "unknown";
    return;
  }
  const std::string pid = std::to_string(getpid());
  if (ftruncate(file_, 0) != 0 || pwrite(file_, pid.data(), pid.size(), 0) != ssize_t(pid.size()))
    throw std::system_error(errno, std::generic_category(), path_);
}

InstanceLock::~InstanceLock()
{
  if (file_ >= 0)
    close(file_);
}
}  // namespace phri_sim
