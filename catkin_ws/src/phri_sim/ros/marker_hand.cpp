#include "marker_hand.hpp"

#include <visualization_msgs/MarkerArray.h>

#include <cmath>

#include "markers.hpp"
#include "trial_messages.hpp"

namespace phri_sim
{
namespace
{
using visualization_msgs::InteractiveMarkerFeedback;
using visualization_msgs::Marker;
using visualization_msgs::MenuEntry;

constexpr const char* kName = "hand";
constexpr double kRadius = 0.010;  // [m] of the disc: wide enough to be hit by a mouse
constexpr double kLine = 0.0012;   // [m]
constexpr double kHeight = 0.022;  // [m] above all that is drawn, or rviz would pick what lies above
constexpr double kTextHeight = 0.0075, kTextAway = 0.019, kTextInwards = 0.7;  // [m]
constexpr int kRingPoints = 48;
constexpr auto kReplyTime = std::chrono::seconds(3);
constexpr unsigned kStart = 1, kStop = 2, kClear = 3, kReset = 4, kController = 5, kFirstController = 10;

void paint(Marker& marker, float alpha)
{
  marker.color.r = 0.12f;
  marker.color.g = 0.42f;
  marker.color.b = 0.80f;
  marker.color.a = alpha;
}

Marker shape(int type, int id)
{
  Marker marker;
  marker.header.frame_id = kFrame;
  marker.ns = kName;
  marker.type = type;
  marker.id = id;
  marker.pose.orientation.w = 1.0;
  return marker;
}

MenuEntry entry(unsigned id, unsigned parent, const std::string& title)
{
  MenuEntry out;
  out.id = id;
  out.parent_id = parent;
  out.title = title;
  out.command_type = MenuEntry::FEEDBACK;
  return out;
}

/// Where a text at the handle lies well within the scene, whose middle is the origin.
Eigen::Vector2d besides(const Eigen::Vector2d& position)
{
  return { kTextInwards * position.x(), position.y() - std::copysign(kTextAway, position.y()) };
}

geometry_msgs::Pose poseAt(const Eigen::Vector2d& position)
{
  geometry_msgs::Pose pose;
  pose.position = point(position, 0.0);
  pose.orientation.w = 1.0;
  return pose;
}
}  // namespace

MarkerHand::MarkerHand(const HandSettings& settings, double dt, ros::NodeHandle& node, ros::NodeHandle& private_node,
                       const OperatorActions& actions)
  : SpringSource(settings, dt),
    actions_(actions),
    server_(node.resolveName(kName)),
    spring_(private_node.advertise<visualization_msgs::MarkerArray>("markers", 10)),
    checked_(actions.controllers.empty() ? "" : actions.controllers.front())
{
  const boost::function<void(const InteractiveMarkerFeedback::ConstPtr&)> receive =
      [this](const InteractiveMarkerFeedback::ConstPtr& feedback) { this->receive(*feedback); };
  feedback_ = thread_.handle(node).subscribe(node.resolveName(kName) + "/feedback", 100, receive);
  thread_.start();
}

MarkerHand::~MarkerHand()
{
  thread_.stop();
}

std::string MarkerHand::waitingFor()
{
  if (heldSinceLastTrial())
    return "let go of the handle, then drag it to start";
  return held() ? "" : "drag the handle to start";
}

void MarkerHand::receive(const InteractiveMarkerFeedback& feedback)
{
  if (feedback.marker_name != kName)
    return;
  if (feedback.event_type == InteractiveMarkerFeedback::MENU_SELECT)
  {
    choose(feedback.menu_entry_id);
    return;
  }
  const bool taken = held();
  const std::lock_guard<std::mutex> lock(mutex_);
  if (taken && feedback.client_id != owner_)
    return;
  if (feedback.event_type == InteractiveMarkerFeedback::MOUSE_UP)
    releaseTarget();
  else if (feedback.event_type != InteractiveMarkerFeedback::BUTTON_CLICK)
    drag(feedback);
}

void MarkerHand::drag(const InteractiveMarkerFeedback& feedback)
{
  if (!feedback.header.frame_id.empty() && feedback.header.frame_id != kFrame)
  {
    ROS_ERROR_STREAM_THROTTLE(5.0, "E_FRAME topic=" << feedback_.getTopic() << " frame=" << feedback.header.frame_id
                                                    << " expected=" << kFrame << " action=RELEASE");
    releaseTarget();
    return;
  }
  const Eigen::Vector2d position(feedback.pose.position.x, feedback.pose.position.y);
  if (!position.allFinite())
    return;
  owner_ = feedback.client_id;
  target_ = position;
  setTarget(position);
}

void MarkerHand::choose(unsigned id)
{
  std::string reply, chosen;
  // without the lock: an action may call back
  if (id == kStart && actions_.start)
    reply = actions_.start();
  else if (id == kStop && actions_.stop)
    reply = actions_.stop();
  else if (id == kClear && actions_.clear_fault)
    reply = actions_.clear_fault();
  else if (id == kReset && actions_.reset)
    reply = actions_.reset();
  else if (id >= kFirstController && id - kFirstController < actions_.controllers.size() && actions_.controller)
    reply = actions_.controller(actions_.controllers[id - kFirstController]);
  else
    return;
  ROS_INFO("menu of the hand: %s", reply.c_str());
  const std::lock_guard<std::mutex> lock(mutex_);
  reply_ = reply;
  reply_until_ = std::chrono::steady_clock::now() + kReplyTime;
}

void MarkerHand::controllerIs(const std::string& name)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  menu_changed_ = menu_changed_ || name != checked_;
  checked_ = name;
}

visualization_msgs::InteractiveMarker MarkerHand::handle(const Eigen::Vector2d& position) const
{
  visualization_msgs::InteractiveMarker marker;
  marker.header.frame_id = kFrame;  // and no stamp: rviz then answers in this frame, not in its fixed one
  marker.name = kName;
  marker.scale = float(2.0 * kRadius);
  marker.pose = poseAt(position);

  visualization_msgs::InteractiveMarkerControl control;
  control.name = "push";
  control.interaction_mode = visualization_msgs::InteractiveMarkerControl::MOVE_PLANE;
  // the plane is normal to the control's x axis: a quarter turn about y brings that onto z
  control.orientation.w = control.orientation.y = std::sqrt(0.5);
  control.always_visible = true;
  Marker disc = shape(Marker::CYLINDER, 0);
  disc.header.frame_id.clear();  // relative to the interactive marker
  disc.pose.position.z = kHeight;
  disc.scale.x = disc.scale.y = 2.0 * kRadius;
  disc.scale.z = 0.0005;
  paint(disc, 0.3f);
  Marker ring = shape(Marker::LINE_STRIP, 1);
  ring.header.frame_id.clear();
  ring.scale.x = kLine;
  paint(ring, 0.9f);
  for (int k = 0; k <= kRingPoints; ++k)
  {
    const double angle = 2.0 * M_PI * k / kRingPoints;
    ring.points.push_back(point(kRadius * Eigen::Vector2d(std::cos(angle), std::sin(angle)), kHeight));
  }
  control.markers = { disc, ring };
  marker.controls.push_back(control);

  marker.menu_entries = { entry(kStart, 0, "start"), entry(kStop, 0, "stop"), entry(kClear, 0, "clear fault"),
                          entry(kReset, 0, "reset") };
  if (!actions_.controllers.empty())
    marker.menu_entries.push_back(entry(kController, 0, "controller"));
  for (std::size_t k = 0; k < actions_.controllers.size(); ++k)
  {
    const std::string& name = actions_.controllers[k];
    // rviz draws these brackets as a check box
    marker.menu_entries.push_back(
        entry(kFirstController + unsigned(k), kController, (name == checked_ ? "[x] " : "[ ] ") + name));
  }
  return marker;
}

void MarkerHand::show(const Eigen::Vector2d& position, const ros::Time& stamp, const std::string& state)
{
  const bool dragged = held();
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!inserted_ || (menu_changed_ && !dragged))  // an insertion takes the marker out of the person's hand
  {
    server_.insert(handle(position));
    inserted_ = true;
    menu_changed_ = false;
  }
  if (!dragged)
    server_.setPose(kName, poseAt(position));
  server_.applyChanges();

  visualization_msgs::MarkerArray picture;
  Marker line = shape(Marker::LINE_LIST, 2);
  line.header.stamp = stamp;
  line.action = dragged ? Marker::ADD : Marker::DELETE;
  line.scale.x = kLine;
  paint(line, 0.9f);
  line.points = { point(position, kHeight), point(target_, kHeight) };
  picture.markers.push_back(line);
  const std::string& words = std::chrono::steady_clock::now() < reply_until_ ? reply_ : state;
  Marker text = shape(Marker::TEXT_VIEW_FACING, 3);
  text.header.stamp = stamp;
  text.action = words.empty() ? Marker::DELETE : Marker::ADD;
  text.pose.position = point(besides(position), 0.03);
  text.scale.z = kTextHeight;
  text.text = words;
  paint(text, 1.0f);
  picture.markers.push_back(text);
  spring_.publish(picture);
}
}  // namespace phri_sim
