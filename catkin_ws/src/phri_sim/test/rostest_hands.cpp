// The hands of real people against a real master: what they subscribe to, when a trial may start, and what reaches the
// tick.
#include <geometry_msgs/WrenchStamped.h>
#include <gtest/gtest.h>
#include <sensor_msgs/Joy.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <visualization_msgs/InteractiveMarkerFeedback.h>
#include <visualization_msgs/InteractiveMarkerInit.h>
#include <visualization_msgs/InteractiveMarkerUpdate.h>

#include <atomic>
#include <thread>

#include "../ros/hand_source.hpp"
#include "../ros/topic_hand.hpp"
#include "../ros/trial_messages.hpp"

using namespace phri_sim;
using Eigen::Vector2d;
using visualization_msgs::InteractiveMarkerFeedback;

namespace
{
constexpr double kDt = 0.001;
constexpr double kPatience = 10.0;  // [s] on the wall, for what takes milliseconds on an idle machine

void pause(double seconds)
{
  ros::WallDuration(seconds).sleep();
}

/// Repeats `act` every 20 ms until `done`; false when that never came.
bool until(
    const std::function<bool()>& done, const std::function<void()>& act = [] {})
{
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(kPatience);
  while (ros::WallTime::now() < end)
  {
    act();
    pause(0.02);
    if (done())
      return true;
  }
  return false;
}

class Hands : public ::testing::Test
{
protected:
  phri_control::LoopSettings loop;  // of the safety profile, 3 N and 0.5 s
  std::unique_ptr<HandSource> make(const std::string& kind)
  {
    OperatorActions actions;
    actions.start = [this] { return ++started, "started"; };
    actions.stop = [this] { return ++stopped, "stopped"; };
    actions.controller = [this](const std::string& name) { return controller = name; };
    actions.controllers = { "none", "lqr" };
    return makeHandSource(kind, settings, loop, node, private_node, actions);
  }
  /// Ticks a held handle at (0, 0) for `seconds` on the wall; the last force.
  HandForce hold(Hand& hand, double seconds)
  {
    HandForce out;
    for (int k = 0; k < int(seconds / kDt); ++k)
    {
      out = hand.act({});
      pause(kDt);
    }
    return out;
  }
  ros::NodeHandle node, private_node{ "~" };
  HandSettings settings;
  std::atomic<int> started{ 0 }, stopped{ 0 };
  std::string controller;
};

InteractiveMarkerFeedback feedback(int event, const Vector2d& position, const std::string& client = "test")
{
  InteractiveMarkerFeedback out;
  out.header.frame_id = kFrame;
  out.client_id = client;
  out.marker_name = "hand";
  out.event_type = std::uint8_t(event);
  out.pose.position.x = position.x();
  out.pose.position.y = position.y();
  return out;
}

class MarkerHandTest : public Hands
{
protected:
  void SetUp() override
  {
    source = make("marker");
    publisher = node.advertise<InteractiveMarkerFeedback>("hand/feedback", 100);
    const boost::function<void(const visualization_msgs::InteractiveMarkerUpdate::ConstPtr&)> moved =
        [this](const visualization_msgs::InteractiveMarkerUpdate::ConstPtr& update) {
          for (const auto& pose : update->poses)
            shown_x = pose.pose.position.x;
        };
    updates = node.subscribe("hand/update", 100, moved);
    ASSERT_TRUE(until([&] { return publisher.getNumSubscribers() > 0 && updates.getNumPublishers() > 0; }));
  }
  void show(double x) { source->show(Vector2d(x, 0), ros::Time(1.0), "PASSIVE"); }
  bool drag(const Vector2d& to, const std::string& client = "test")
  {
    return until([&] { return source->waitingFor().empty(); },
                 [&] { publisher.publish(feedback(InteractiveMarkerFeedback::POSE_UPDATE, to, client)); });
  }
  std::unique_ptr<HandSource> source;
  ros::Publisher publisher;
  ros::Subscriber updates;
  std::atomic<double> shown_x{ -1.0 };
};

class TopicHandTest : public Hands
{
protected:
  void SetUp() override
  {
    source = make("topic");
    publisher = node.advertise<geometry_msgs::WrenchStamped>("ft_sensor/wrench", 10);
    ASSERT_TRUE(until([&] { return publisher.getNumSubscribers() > 0; }));
  }
  void push(const Vector2d& force, const std::string& frame = kFrame)
  {
    geometry_msgs::WrenchStamped message;
    message.header.frame_id = frame;
    message.header.stamp.fromNSec(ros::WallTime::now().toNSec());
    message.wrench.force.x = force.x();
    message.wrench.force.y = force.y();
    publisher.publish(message);
  }
  /// What waitingFor says of this push, once it has had the time to say something else.
  std::string verdict(const Vector2d& force, const std::string& frame = kFrame)
  {
    for (int k = 0; k < 100; ++k)
    {
      push(force, frame);
      pause(0.01);
    }
    return source->waitingFor();
  }
  std::unique_ptr<HandSource> source;
  ros::Publisher publisher;
};
}  // namespace

TEST_F(Hands, KindsAreCheckedByName)
{
  EXPECT_EQ(make("simulated"), nullptr);
  try
  {
    make("makrer");
    FAIL();
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_NE(std::string(error.what()).find("did you mean \"marker\""), std::string::npos) << error.what();
  }
}

TEST_F(MarkerHandTest, ADragPullsTheHandleAndMouseUpLetsGo)
{
  EXPECT_EQ(source->waitingFor(), "drag the handle to start");
  ASSERT_TRUE(until([&] { return shown_x == 0.03; }, [&] { show(0.03); })) << "the marker follows the object";
  ASSERT_TRUE(drag({ 0.5, 0 }));
  const std::unique_ptr<Hand> hand = source->hand(TrialSpec());
  double pull = 0.0;
  const auto pull_on = [&] { publisher.publish(feedback(InteractiveMarkerFeedback::POSE_UPDATE, { 0.5, 0 })); };
  EXPECT_TRUE(until([&] { return (pull = hold(*hand, 0.02).force.x()) > 10.0; }, pull_on)) << pull;
  publisher.publish(feedback(InteractiveMarkerFeedback::MOUSE_UP, { 0.5, 0 }));
  EXPECT_TRUE(until([&] { return source->waitingFor() == "drag the handle to start"; }));
  EXPECT_TRUE(until([&] { return hold(*hand, 0.02).force.norm() == 0.0; }));
  EXPECT_TRUE(until([&] { return shown_x == 0.04; }, [&] { show(0.04); })) << "and it follows again";
}

// Whoever still drags the marker at the goal when the next trial is due would begin it with a jerk.
TEST_F(MarkerHandTest, AHoldServesOneTrial)
{
  ASSERT_TRUE(drag({ 0.01, 0 }));
  const auto hand = source->hand({});
  publisher.publish(feedback(InteractiveMarkerFeedback::POSE_UPDATE, { 0.02, 0 }));
  EXPECT_EQ(source->waitingFor(), "let go of the handle, then drag it to start");
  ASSERT_TRUE(until([&] { return source->waitingFor() == "drag the handle to start"; },
                    [&] {
                      publisher.publish(feedback(InteractiveMarkerFeedback::MOUSE_UP, { 0.02, 0 }));
                    }));
  EXPECT_TRUE(drag({ 0.01, 0 }));
}

TEST_F(MarkerHandTest, DoesNotTakeTheMarkerOutOfTheHand)
{
  show(0.0);
  ASSERT_TRUE(drag({ 0.1, 0 }));
  const double before = shown_x;
  for (int k = 0; k < 10; ++k)
  {
    drag({ 0.1, 0 });
    show(0.02);  // the server itself repeats the dragged pose
  }
  EXPECT_NE(shown_x, 0.02) << before;
}

TEST_F(MarkerHandTest, AVanishedClientLetsGo)
{
  ASSERT_TRUE(drag({ 0.1, 0 }));
  pause(settings.spring.timeout);
  EXPECT_TRUE(until([&] { return !source->waitingFor().empty(); }));
}

TEST_F(MarkerHandTest, KeepAliveHoldsOnAndASecondClientHasToWait)
{
  ASSERT_TRUE(drag({ 0.5, 0 }, "first"));
  const std::unique_ptr<Hand> hand = source->hand(TrialSpec());
  for (int k = 0; k < 6; ++k)  // 1.2 s, longer than the timeout
  {
    publisher.publish(feedback(InteractiveMarkerFeedback::KEEP_ALIVE, { 0.5, 0 }, "first"));
    publisher.publish(feedback(InteractiveMarkerFeedback::POSE_UPDATE, { -0.5, 0 }, "second"));
    publisher.publish(feedback(InteractiveMarkerFeedback::MOUSE_UP, { -0.5, 0 }, "second"));
    hold(*hand, 0.2);
  }
  EXPECT_GT(hold(*hand, 0.001).force.x(), 10.0);
  publisher.publish(feedback(InteractiveMarkerFeedback::MOUSE_UP, { 0.5, 0 }, "first"));
  ASSERT_TRUE(until([&] { return !source->waitingFor().empty(); }));
  EXPECT_TRUE(drag({ -0.5, 0 }, "second"));
}

TEST_F(MarkerHandTest, OtherFramesAndNaNAreNoTarget)
{
  InteractiveMarkerFeedback other = feedback(InteractiveMarkerFeedback::POSE_UPDATE, { 0.1, 0 });
  other.header.frame_id = "camera";
  for (int k = 0; k < 10; ++k)
  {
    publisher.publish(other);
    publisher.publish(feedback(InteractiveMarkerFeedback::POSE_UPDATE, { std::nan(""), 0 }));
    pause(0.02);
  }
  EXPECT_FALSE(source->waitingFor().empty());
}

TEST_F(MarkerHandTest, TheMenuActsAndShowsTheController)
{
  std::string titles;
  const boost::function<void(const visualization_msgs::InteractiveMarkerInit::ConstPtr&)> keep =
      [&](const visualization_msgs::InteractiveMarkerInit::ConstPtr& init) {
        titles.clear();
        for (const auto& marker : init->markers)
          for (const auto& entry : marker.menu_entries)
            titles += entry.title + ";";
      };
  const ros::Subscriber init = node.subscribe("hand/update_full", 10, keep);
  ASSERT_TRUE(until([&] { return !titles.empty(); }, [&] { show(0.0); }));
  EXPECT_EQ(titles, "start;stop;clear fault;reset;controller;[x] none;[ ] lqr;");
  const auto select = [&](unsigned id) {
    InteractiveMarkerFeedback menu = feedback(InteractiveMarkerFeedback::MENU_SELECT, { 0, 0 });
    menu.menu_entry_id = id;
    publisher.publish(menu);
  };
  select(1);
  EXPECT_TRUE(until([&] { return started == 1; }));
  select(2);
  EXPECT_TRUE(until([&] { return stopped == 1; }));
  select(11);
  EXPECT_TRUE(until([&] { return controller == "lqr"; }));
  select(99);
  source->controllerIs("lqr");
  EXPECT_TRUE(until([&] { return titles.find("[ ] none;[x] lqr;") != std::string::npos; }, [&] { show(0.0); }));
  EXPECT_EQ(started + stopped, 2);
}

TEST_F(Hands, AStickMovesTheHandleAndSilenceLetsGo)
{
  const std::unique_ptr<HandSource> source = make("joy");
  EXPECT_TRUE(source->autostart());
  EXPECT_EQ(source->waitingFor(), "move the stick to start");
  ros::Publisher publisher = node.advertise<sensor_msgs::Joy>("joy", 10);
  sensor_msgs::Joy stick;
  stick.axes = { 0.0f, 0.0f };
  stick.buttons = { 0, 0 };
  ASSERT_TRUE(until([&] { return publisher.getNumSubscribers() > 0; }));
  for (int k = 0; k < 10; ++k)
  {
    publisher.publish(stick);
    pause(0.02);
  }
  EXPECT_EQ(source->waitingFor(), "move the stick to start") << "the stick is in the middle";
  stick.axes = { -1.0f, 0.0f };  // right
  stick.buttons = { 1, 0 };
  ASSERT_TRUE(until([&] { return source->waitingFor().empty(); }, [&] { publisher.publish(stick); }));
  const std::unique_ptr<Hand> hand = source->hand(TrialSpec());
  Vector2d force(0, 0);
  EXPECT_TRUE(until([&] { return (force = hold(*hand, 0.02).force).x() > 10.0; }, [&] { publisher.publish(stick); }));
  EXPECT_EQ(force.y(), 0.0);
  EXPECT_EQ(started, 1) << "once, however often the message repeats the button";
  EXPECT_EQ(stopped, 0);
  EXPECT_TRUE(until([&] { return hold(*hand, 0.02).force.norm() == 0.0; })) << "no messages any more";
}

TEST_F(TopicHandTest, SaysWhatIsMissing)
{
  EXPECT_FALSE(source->autostart());
  EXPECT_NE(source->waitingFor().find("silent"), std::string::npos) << source->waitingFor();
  EXPECT_THROW(source->hand(TrialSpec()), std::invalid_argument);
  const std::string frame = verdict({ 0.5, 0 }, "sensor_nobody_knows");
  EXPECT_NE(frame.find("\"sensor_nobody_knows\""), std::string::npos) << frame;
  EXPECT_NE(frame.find("\"maze\""), std::string::npos) << frame;
  const std::string bias = verdict({ 3.1, 0 });
  EXPECT_NE(bias.find("let go of the handle, or tare the sensor: 3.1 N"), std::string::npos) << bias;
  EXPECT_EQ(verdict({ 2.9, 0 }), "");
}

TEST_F(TopicHandTest, RestIsHalfASecondLong)
{
  ASSERT_EQ(verdict({ 0, 0 }), "");
  push({ 4, 0 });
  ASSERT_TRUE(until([&] { return !source->waitingFor().empty(); }));
  for (int k = 0; k < 5; ++k)
  {
    push({ 0, 0 });
    pause(0.01);
  }
  EXPECT_NE(source->waitingFor().find("at rest for 0.5 s"), std::string::npos) << source->waitingFor();
  EXPECT_EQ(verdict({ 0, 0 }), "");
}

TEST_F(TopicHandTest, APushPlusXReadsPlusXInWhateverFrame)
{
  // the sensor is mounted turned by +90 degrees about z: its x axis is the maze's y axis
  tf2_ros::StaticTransformBroadcaster broadcaster;
  geometry_msgs::TransformStamped mount;
  mount.header.frame_id = kFrame;
  mount.child_frame_id = "turned_sensor";
  mount.transform.translation.x = 0.5;  // a force does not mind
  mount.transform.rotation.z = mount.transform.rotation.w = std::sqrt(0.5);
  broadcaster.sendTransform(mount);
  ASSERT_TRUE(until([&] { return verdict({ 0, 0 }, "turned_sensor").empty(); }));
  const std::unique_ptr<Hand> turned = source->hand(TrialSpec());
  Vector2d force(0, 0);
  EXPECT_TRUE(until([&] { return (force = turned->act({}).force).norm() > 1.0; },
                    [&] {
                      push({ 6, 2 }, "turned_sensor");
                    }));
  EXPECT_LT((force - Vector2d(-2, 6)).norm(), 1e-12) << force.transpose();

  push({ 6, 2 }, kFrame);  // during the trial: nobody may take this for a reading
  EXPECT_TRUE(until([&] { return turned->act({}).frame == 1; }));

  ASSERT_EQ(verdict({ 0, 0 }, kFrame), "");
  const std::unique_ptr<Hand> straight = source->hand(TrialSpec());
  HandForce out;
  EXPECT_TRUE(until([&] { return (out = straight->act({})).force.norm() > 1.0; }, [&] { push({ 6, 2 }); }));
  EXPECT_EQ(out.force, Vector2d(6, 2));
  EXPECT_EQ(out.frame, 0u);
  EXPECT_TRUE(out.sensed);
}

TEST_F(TopicHandTest, AgesAndCountsReadings)
{
  ASSERT_EQ(verdict({ 0, 0 }), "");
  const std::unique_ptr<Hand> hand = source->hand(TrialSpec());
  push({ 1, 0 });
  ASSERT_TRUE(until([&] { return hand->act({}).sequence > 0; }));
  const HandForce first = hand->act({});
  pause(0.05);
  const HandForce same = hand->act({});
  EXPECT_EQ(same.sequence, first.sequence);
  EXPECT_GE(same.age_ns - first.age_ns, 50000000);
  EXPECT_EQ(same.stamp_age_ns - first.stamp_age_ns, same.age_ns - first.age_ns);
  push({ 1, 0 });
  ASSERT_TRUE(until([&] { return hand->act({}).sequence == first.sequence + 1; }));

  geometry_msgs::WrenchStamped old;
  old.header.frame_id = kFrame;
  old.header.stamp.fromNSec(ros::WallTime::now().toNSec() - 1000000000);
  publisher.publish(old);
  ASSERT_TRUE(until([&] { return hand->act({}).sequence == first.sequence + 2; }));
  EXPECT_GE(hand->act({}).stamp_age_ns, 1000000000) << "it has just arrived, with an old stamp";
}

int main(int argc, char** argv)
{
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "rostest_hands");
  ros::AsyncSpinner spinner(2);
  spinner.start();
  const int result = RUN_ALL_TESTS();
  ros::shutdown();
  return result;
}
