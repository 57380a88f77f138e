#pragma once
#include <ros/serialization.h>
#include <ros/service_traits.h>

#include <QString>
#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

namespace phri_rviz
{
/// One call of a ROS service with a deadline, over TCPROS (wiki.ros.org/ROS/TCPROS).
///
/// roscpp's own client waits for the answer without limit, cannot be told to give up, and writes the error text of a
/// service to the log instead of giving it to the caller.
struct ServiceReply
{
  bool success = false;              ///< the service answered and was content; its own `success` field is another thing
  QString error;                     ///< names the service
  std::vector<std::uint8_t> answer;  ///< serialised
};

/// Blocks, for `timeout` [s] at most once the master has been asked; not for the GUI thread. `request` is serialised
/// with its length in front. Ends early when `give_up` becomes true.
ServiceReply callRaw(const std::string& service, const std::string& type, const std::string& md5sum,
                     const ros::SerializedMessage& request, double timeout, const std::atomic<bool>& give_up);

/// The same with messages: fills call.response.
template <class Service>
ServiceReply callService(const std::string& service, Service& call, double timeout, const std::atomic<bool>& give_up)
{
  ServiceReply reply =
      callRaw(service, ros::service_traits::datatype<Service>(), ros::service_traits::md5sum<Service>(),
              ros::serialization::serializeMessage(call.request), timeout, give_up);
  if (!reply.success)
    return reply;
  try
  {
    ros::serialization::IStream stream(reply.answer.data(), std::uint32_t(reply.answer.size()));
    ros::serialization::deserialize(stream, call.response);
  }
  catch (const ros::serialization::StreamOverrunException&)
  {
    reply.success = false;
    reply.error = QString::fromStdString(service) + ": its answer is cut short";
  }
  return reply;
}
}  // namespace phri_rviz
