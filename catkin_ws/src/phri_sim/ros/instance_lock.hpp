#pragma once
#include <string>

namespace phri_sim
{
/// Keeps a second node of the same name on the same ROS master from starting: ROS would shut down the first one. The
/// lock is a file of this machine and goes with the process, however it ends.
class InstanceLock
{
public:
  /// Take it before the node registers with the master. Throws std::system_error if the lock file cannot be made.
  InstanceLock(const std::string& master_uri, const std::string& node_name);
  ~InstanceLock();
  InstanceLock(const InstanceLock&) = delete;
  InstanceLock& operator=(const InstanceLock&) = delete;

  bool held() const { return holder_.empty(); }
  /// Process id of the node that has it, as text, if this one has not.
  const std::string& holder() const { return holder_; }
  const std::string& path() const { return path_; }

private:
  std::string path_, holder_;
  int file_ = -1;
};
}  // namespace phri_sim
