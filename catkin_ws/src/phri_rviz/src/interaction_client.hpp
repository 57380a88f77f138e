#pragma once
#include <phri_msgs/ControllerState.h>
#include <phri_msgs/Trial.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>

#include <QObject>
#include <QStringList>
#include <QThreadPool>
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "tunable.hpp"

namespace phri_rviz
{
/// The ROS side of the panel: topics on a thread of its own, every service call on a thread of a pool, so that nothing
/// here blocks and no call (least of all stop) waits behind another one. All signals are emitted in the thread that
/// this object lives in; its functions are to be called there too.
class InteractionClient : public QObject
{
  Q_OBJECT

public:
  explicit InteractionClient(QObject* parent = nullptr);
  /// Outstanding calls are given up: takes a fraction of a second.
  ~InteractionClient() override;

  /// Leaves what it was connected to and takes <space>/experiment_node and <space>/session_runner. False: `space` is no
  /// ROS name, `why` says what is wrong with it, and everything stays as it was.
  bool connectTo(const QString& space, QString* why);
  const QString& space() const { return space_; }

  /// Since the last state arrived, or since connectTo when none has [s of the steady clock]
  double silence() const;
  /// The states that arrived since the last call, oldest first; the newest 2000 when nobody asked for long.
  std::vector<phri_msgs::ControllerState> takeStates();

  void trigger(const QString& service);  ///< start, stop, clear_fault or reset -> answered
  void listControllers();                ///< -> controllersListed, or answered when that failed
  void switchController(const QString& controller);
  void rate(int rating);                         ///< -> rated
  void setParameters(const Values& parameters);  ///< -> parametersAnswered, exactly once

Q_SIGNALS:
  void trialChanged(const phri_msgs::Trial& trial);
  void tunablesDescribed(const QVector<phri_rviz::Tunable>& tunables);
  void valuesInForce(const phri_rviz::Values& values);
  void controllersListed(const QStringList& experiment, const QStringList& available);
  /// `service` without the namespace; `text`: what the service said, or what went wrong
  void answered(const QString& service, bool success, const QString& text);
  void rated(int rating, bool success, const QString& text);
  void parametersAnswered(const phri_rviz::Values& asked, bool success, const phri_rviz::Values& in_force,
                          const QString& text);

private:
  /// Runs `act` in this object's thread, unless it has been connected to another namespace by then.
  void post(std::function<void()> act);
  void heard();
  /// Calls the service in the pool, then `done(success, text, response)` in this object's thread.
  template <class Service, class Done>
  void call(const std::string& name, Service request, Done done);

  QString space_;
  std::atomic<int> connection_{ 0 };  // counts connectTo
  std::atomic<bool> give_up_{ false };
  std::atomic<double> last_heard_;

  ros::CallbackQueue queue_;
  std::unique_ptr<ros::NodeHandle> node_;
  std::vector<ros::Subscriber> subscribers_;
  std::unique_ptr<ros::AsyncSpinner> spinner_;
  QThreadPool pool_;

  std::mutex states_mutex_;
  std::vector<phri_msgs::ControllerState> states_;
};
}  // namespace phri_rviz
