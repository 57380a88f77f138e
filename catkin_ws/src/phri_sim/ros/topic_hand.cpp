#include "topic_hand.hpp"

#include <Eigen/Geometry>
#include <cstdio>

#include "trial_messages.hpp"

namespace phri_sim
{
namespace
{
constexpr double kSilence = 0.1;   // [s] without a reading before a trial
constexpr double kStampAge = 0.1;  // [s] before a trial: more is another clock rather than a delay

template <typename... Values>
std::string text(const char* format, Values... values)
{
  char out[400];
  std::snprintf(out, sizeof(out), format, values...);
  return out;
}
}  // namespace

TopicHand::TopicHand(const HandSettings& settings, const phri_core::SafetySettings& safety, ros::NodeHandle& node)
  : wall_stamps_(settings.stamps == "wall"),
    rest_force_(safety.bias_force),
    rest_time_(safety.bias_time),
    listener_(transforms_)
{
  using Event = ros::MessageEvent<const geometry_msgs::WrenchStamped>;
  const boost::function<void(const Event&)> receive = [this](const Event& event) { this->receive(event); };
  newest_.sequence = 0;
  ros::SubscribeOptions options;
  options.initByFullCallbackType<const Event&>("ft_sensor/wrench", 1, receive);
  options.transport_hints = ros::TransportHints().tcpNoDelay();
  ros::NodeHandle own = thread_.handle(node);
  subscriber_ = own.subscribe(options);
  thread_.start();
}

TopicHand::~TopicHand()
{
  thread_.stop();
}

std::int64_t TopicHand::stampAge(const ros::Time& stamp) const
{
  const std::int64_t now =
      wall_stamps_ ? std::int64_t(ros::WallTime::now().toNSec()) : std::int64_t(ros::Time::now().toNSec());
  return now - std::int64_t(stamp.toNSec());
}

void TopicHand::receive(const ros::MessageEvent<const geometry_msgs::WrenchStamped>& event)
{
  const std::int64_t now = monotonicNs();
  const geometry_msgs::WrenchStamped& message = *event.getConstMessage();
  const std::int64_t stamp_age = stampAge(message.header.stamp);
  const Eigen::Vector3d force(message.wrench.force.x, message.wrench.force.y, message.wrench.force.z);

  const std::lock_guard<std::mutex> lock(mutex_);
  if (subscriber_.getNumPublishers() > 1)
  {
    ROS_ERROR_THROTTLE(5.0, "E_PUBLISHERS topic=%s publishers=%u expected=1 action=DROP",
                       subscriber_.getTopic().c_str(), subscriber_.getNumPublishers());
    return;
  }
  // a source counts from 0 and wraps; one that connects anew goes on where the last one was
  const bool same = connection_ && connection_ == event.getConnectionHeaderPtr();
  const std::int32_t step = same ? std::int32_t(message.header.seq - last_seq_) : 1;
  connection_ = event.getConnectionHeaderPtr();
  SensedForce reading;
  reading.sequence = std::uint64_t(std::max<std::int64_t>(1, std::int64_t(newest_.sequence) + step));
  reading.received_ns = now;
  reading.stamp_age_ns = stamp_age;

  const Frame& frame = readings_ ? trial_ : known_;
  reading.frame = message.header.frame_id == frame.id ? 0 : 1;
  reading.force = (frame.rotation * force).head<2>();
  if (readings_)
    readings_->post(reading);
  if (step <= 0)
    return;  // an older one: the guard has seen and counted it
  const bool gap = (now - newest_.received_ns) * 1e-9 > kSilence;
  newest_ = reading;
  last_seq_ = message.header.seq;
  newest_frame_ = message.header.frame_id;
  newest_force_ = force.norm();
  if (!(newest_force_ <= rest_force_) || gap)
    calm_since_ns_ = now;
}

std::string TopicHand::lookUp(const std::string& frame)
{
  if (frame == known_.id)
    return "";
  Frame found;
  found.id = frame;
  if (frame != kFrame)
  {
    if (frame.empty())
      return text("the wrench on %s names no frame_id; expected \"%s\" or a frame that tf knows",
                  subscriber_.getTopic().c_str(), kFrame);
    std::string cause;
    if (!transforms_.canTransform(kFrame, frame, ros::Time(0), &cause))
      return text("the wrench on %s is in frame \"%s\", and tf knows no way from there to \"%s\"",
                  subscriber_.getTopic().c_str(), frame.c_str(), kFrame);
    const geometry_msgs::Quaternion q = transforms_.lookupTransform(kFrame, frame, ros::Time(0)).transform.rotation;
    found.rotation = Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized().toRotationMatrix();
  }
  known_ = found;
  return "";
}

std::string TopicHand::waitingFor()
{
  const std::lock_guard<std::mutex> lock(mutex_);
  const std::string topic = subscriber_.getTopic();
  const unsigned publishers = subscriber_.getNumPublishers();
  if (publishers != 1)
    return publishers == 0 ? "no wrench on " + topic + ": nobody publishes it"
                           : text("%u nodes publish %s; expected one", publishers, topic.c_str());
  const std::int64_t now = monotonicNs();
  if (newest_.sequence == 0 || (now - newest_.received_ns) * 1e-9 > kSilence)
    return "no wrench on " + topic + ": its publisher is connected but silent";
  const std::string wrong_frame = lookUp(newest_frame_);
  if (!wrong_frame.empty())
    return wrong_frame;
  const double stamp_age = newest_.stamp_age_ns * 1e-9;
  if (!(std::abs(stamp_age) <= kStampAge))
    return text("the stamps on %s are %.3g s old by the %s clock: does their source use another one (hand/stamps)?",
                topic.c_str(), stamp_age, wall_stamps_ ? "wall" : "ros");
  if (!(newest_force_ <= rest_force_))
    return text("let go of the handle, or tare the sensor: %.1f N on %s, at most %.0f N at rest", newest_force_,
                topic.c_str(), rest_force_);
  if ((now - calm_since_ns_) * 1e-9 < rest_time_)
    return text("let go of the handle: the sensor must be at rest for %.1f s", rest_time_);
  return "";
}

std::unique_ptr<Hand> TopicHand::hand(const TrialSpec& /*spec*/)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  if (known_.id.empty())
    throw std::invalid_argument("no wrench in a known frame has come on " + subscriber_.getTopic());
  trial_ = known_;
  readings_ = std::make_shared<SensedHand::Readings>();
  return std::make_unique<SensedHand>(readings_);
}
}  // namespace phri_sim
