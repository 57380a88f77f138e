#pragma once
#include <interactive_markers/interactive_marker_server.h>

#include <chrono>

#include "spring_source.hpp"

namespace phri_sim
{
/// A person who drags a disc in rviz: interactive marker `hand` of the server `hand`, movable in the plane of frame
/// `maze`. Holding it pulls the handle by a spring; its right-click menu is the operator's.
///
/// What rviz sends: while the button is held, POSE_UPDATE per picture in which the mouse moved and else KEEP_ALIVE
/// every 0.25 s, then MOUSE_UP. A client that vanishes sends nothing: the timeout lets go for it. A marker without a
/// stamp is answered in its own frame.
///
/// The feedback is read from its topic and not through the server's callbacks: the server turns a second client away
/// for 1 s of ros::Time, which stands still between trials. Here another client may take the handle as soon as the one
/// before has let go.
class MarkerHand : public SpringSource
{
public:
  MarkerHand(const HandSettings& settings, double dt, ros::NodeHandle& node, ros::NodeHandle& private_node,
             const OperatorActions& actions);
  ~MarkerHand() override;
  std::string waitingFor() override;
  void show(const Eigen::Vector2d& position, const ros::Time& stamp, const std::string& state) override;
  void controllerIs(const std::string& name) override;

private:
  void receive(const visualization_msgs::InteractiveMarkerFeedback& feedback);
  void drag(const visualization_msgs::InteractiveMarkerFeedback& feedback);
  void choose(unsigned entry);
  visualization_msgs::InteractiveMarker handle(const Eigen::Vector2d& position) const;
  void insert(const Eigen::Vector2d& position);

  const OperatorActions actions_;
  interactive_markers::InteractiveMarkerServer server_;
  ros::Publisher spring_;

  std::mutex mutex_;  // guards what follows
  bool inserted_ = false, menu_changed_ = false;
  std::string owner_, checked_, reply_;
  std::chrono::steady_clock::time_point reply_until_{};
  Eigen::Vector2d target_{ 0, 0 };

  CallbackThread thread_;
  ros::Subscriber feedback_;
};
}  // namespace phri_sim
