// The contact tasks' stage and their teacher: forces come from the world, and are felt where and as they act.
#include "phri_sim/contact_stage.hpp"

#include <gtest/gtest.h>

#include "phri_core/testing.hpp"

namespace
{
using namespace phri_sim;
using Eigen::Vector3d;

constexpr double kTick = 1e-3;
constexpr double kNoise = 0.15;        // [N] sensor noise after a mean of 200 samples, drift and tare: 0.05 N each
constexpr double kServo = 1e-3;        // [m] servos and inverse kinematics, slow motion
constexpr double kIndentation = 2e-3;  // [m] of what is touched

std::shared_ptr<const ContactTask> taskNamed(const std::string& name, const Parameters& overrides = {})
{
  return std::make_shared<const ContactTask>(loadContactTask(name, overrides));
}

/// Leads the tip without a loop: the command is where it is to be.
struct Lead
{
  ContactStage stage;
  Vector3d at;
  Vector3d force{ 0, 0, 0 };    // mean of the sensor over the last `move` [N]
  Vector3d contact{ 0, 0, 0 };  // mean true contact force likewise [N]
  std::int64_t now = 0;

  Lead(std::shared_ptr<const ContactTask> task, const ContactTrial& trial) : stage(task, trial), at(stage.start()) {}

  void tick(const Vector3d& position, const Vector3d& velocity)
  {
    force += Vector3d(stage.read(now, phri_core::VectorDof::Zero(3)).environment_wrench);
    stage.write({ position, velocity });
    contact += stage.contactForce();
    now += 1000000;
  }
  /// On a straight line at constant speed [m/s].
  void move(const Vector3d& to, double speed = 0.05)
  {
    const int ticks = std::max(1, int((to - at).norm() / speed / kTick));
    const Vector3d from = at, velocity = (to - from) / (ticks * kTick);
    for (int k = 1; k <= ticks; ++k)
      tick(from + (to - from) * k / ticks, velocity);
    at = to;
  }
  void hold(int ticks)
  {
    force.setZero();
    contact.setZero();
    for (int k = 0; k < ticks; ++k)
      tick(at, Vector3d::Zero());
    force /= ticks;
    contact /= ticks;
  }
};

Vector3d above(const ContactTask& task, double height)
{
  // lower edge of the tilted tip above the middle of the cap, whose top is 38 mm above the plate's back
  const Eigen::Matrix3d axes = task.scene.orientation();
  const Vector3d edge = 0.01 * axes.col(0);
  return task.scene.button + Vector3d(0, 0, 0.038 + height) - edge;
}

TEST(ContactStage, StartsWhereTheSceneSaysAndFeelsNothingInTheAir)
{
  for (const char* name : { "button", "whiteboard" })
  {
    const auto task = taskNamed(name);
    Lead lead(task, { 3, 0.0, -1 });
    EXPECT_LT((Vector3d(lead.stage.start()) - task->scene.start).norm(), kServo) << name;
    lead.hold(200);
    EXPECT_LT(lead.force.norm(), kNoise) << name << ": tared, weight taken off, noise averaged";
    lead.move(task->scene.start + Vector3d(0.02, -0.03, 0.02));
    lead.hold(200);  // the stop shakes the tool, and its inertia is felt
    lead.hold(200);
    EXPECT_LT((lead.stage.tip() - lead.at).norm(), kServo) << name << ": the tip follows the command";
    EXPECT_LT(lead.force.norm(), kNoise) << name << ": and still feels nothing";
    EXPECT_EQ(lead.contact.norm(), 0.0) << name;
  }
}

TEST(ContactStage, SensorReadsTheContactForceOfTheButton)
{
  const auto task = taskNamed("button");
  Lead lead(task, { 3, 0.0, -1 });
  lead.move(above(*task, 0.03), 0.1);
  lead.move(above(*task, -0.0015), 0.02);
  lead.hold(100);
  lead.hold(200);
  const Button& button = *lead.stage.button();
  EXPECT_EQ(button.clicks(), 0) << "1.5 mm is no click";
  EXPECT_EQ(button.touches(), 1);
  EXPECT_GT(lead.contact.z(), 0.3) << "the cap pushes up";
  EXPECT_LT((lead.force - lead.contact).norm(), kNoise) << "by the environment on the tool";
  lead.move(above(*task, -0.0045), 0.02);
  lead.hold(300);
  EXPECT_EQ(button.clicks(), 1);
  EXPECT_LT((lead.force - lead.contact).norm(), kNoise);
  EXPECT_FALSE(lead.stage.arrived()) << "nothing was pointed at yet";
}

TEST(ContactStage, DisplacementLowersTheButtonByJustThat)
{
  const auto task = taskNamed("button");
  std::vector<double> touched;
  for (const double displacement : { 0.0, 0.05, 0.10 })
  {
    Lead lead(task, { 3, displacement, -1 });
    lead.move(above(*task, 0.03 - displacement), 0.1);
    EXPECT_EQ(lead.stage.button()->touches(), 0);
    for (int k = 0; k < 400 && lead.stage.button()->touches() == 0; ++k)
      lead.move(lead.at - Vector3d(0, 0, 1e-4), 0.02);
    touched.push_back(lead.stage.tip().z());
  }
  EXPECT_NEAR(touched[0], above(*task, 0.0).z(), kIndentation);
  EXPECT_NEAR(touched[1], touched[0] - 0.05, 2e-4);  // two steps of 0.1 mm
  EXPECT_NEAR(touched[2], touched[0] - 0.10, 2e-4);
}

TEST(ContactStage, EraserWipesWhereItIsPressedAndFeelsFriction)
{
  const auto task = taskNamed("whiteboard");
  const double surface = task->scene.board.pose.translation().x();
  for (const double displacement : { -0.05, 0.0, 0.05 })
  {
    Lead lead(task, { 3, displacement, -1 });
    const double x = surface + displacement;
    lead.move({ x - 0.01, 0.1, 0.85 }, 0.1);
    EXPECT_EQ(lead.stage.whiteboard()->force(), 0.0);
    lead.move({ x + 0.002, 0.1, 0.85 }, 0.02);
    lead.hold(200);
    EXPECT_EQ(lead.stage.whiteboard()->share(), 0.0) << "pressing alone wipes nothing";
    EXPECT_LT(lead.force.x(), -5.0) << "the board pushes back";
    EXPECT_NEAR(lead.force.x(), -lead.stage.whiteboard()->force(), 0.5);
    lead.force.setZero();
    const std::int64_t before = lead.now;
    lead.move({ x + 0.002, -0.1, 0.85 }, 0.1);
    lead.force /= double((lead.now - before) / 1000000);
    EXPECT_GT(lead.stage.whiteboard()->share(), 0.3);
    const double friction = 0.2;  // of felt on the board
    EXPECT_NEAR(lead.force.y(), -friction * lead.force.x(), 0.1 * std::abs(friction * lead.force.x()))
        << "against the motion toward -y";
  }
}

TEST(ContactStage, HandOnTheArmIsNotFeltByTheWrist)
{
  const auto task = taskNamed("button");
  ContactStage stage(task, { 3, 0.0, 0 });
  const Vector3d held = stage.start();
  Vector3d sensed = Vector3d::Zero(), hand = Vector3d::Zero();
  constexpr int kTicks = 800;  // the teacher wants to go on, the command stays: the hand pulls ever harder
  for (int k = 0; k < kTicks; ++k)
  {
    const phri_core::Measurement m = stage.read(k * std::int64_t(1000000), phri_core::VectorDof::Zero(3));
    if (k >= kTicks - 200)
    {
      sensed += Vector3d(m.environment_wrench) / 200.0;
      hand += Vector3d(m.human_wrench) / 200.0;
    }
    stage.write({ held, Vector3d(0, 0, 0) });
  }
  EXPECT_GT(hand.norm(), 10.0);
  EXPECT_LT(sensed.norm(), kNoise);
}

TEST(ContactStage, TheTickAllocatesNothing)
{
  for (const char* name : { "button", "whiteboard" })
  {
    const auto task = taskNamed(name);
    ContactStage stage(task, { 3, 0.0, 1 });
    const phri_core::VectorDof zero = phri_core::VectorDof::Zero(3);
    const phri_core::Command command{ stage.start(), zero };
    const long allocated = phri_core::testing::countAllocations([&] {
      for (int k = 0; k < 100; ++k)
      {
        stage.read(k * std::int64_t(1000000), zero);
        stage.write(command);
      }
    });
    EXPECT_EQ(allocated, 0) << name;
  }
}

TEST(Teacher, WantsWhatTheLegsSay)
{
  TaughtMotion motion;
  motion.press = Vector3d(0, 0, -1);
  motion.legs = { { { 0.1, 0, 0 }, 1.0, 0.0, 0.0 },
                  { { 0.1, 0, 0 }, 2.0, 5.0, 0.0 },
                  { { 0.1, 0, 0.1 }, 1.0, 0.0, 0.0 } };
  TeacherHabits exact;
  exact.pace = exact.duration = exact.force = exact.tremor = exact.force_tremor = 0.0;
  Teacher teacher(motion, exact, 80.0, Vector3d::Zero(), 1, 0);
  EXPECT_DOUBLE_EQ(teacher.duration(), 4.0);
  EXPECT_NEAR((teacher.intended(0.5) - Vector3d(0.05, 0, 0)).norm(), 0.0, 1e-12) << "half way at half time";
  EXPECT_EQ(teacher.pressure(0.9), 0.0);
  EXPECT_NEAR(teacher.pressure(2.9), 5.0, 1e-12);
  // pressing by feel: at rest the force along the press direction is the wanted one, wherever the tip is
  for (const double z : { -0.05, 0.0, 0.05 })
    EXPECT_NEAR(teacher.force(2.9, kTick, { 0.1, 0, z }, { 0, 0, 0 }).z(), -5.0, 1e-12);
  // and across it a spring
  EXPECT_NEAR(teacher.force(2.9, kTick, { 0.08, 0, 0 }, { 0, 0, 0 }).x(), 0.02 * exact.stiffness, 1e-9);
  EXPECT_NEAR(teacher.force(2.9, kTick, { -5.0, 0, 0 }, { 0, 0, 0 }).norm(), exact.force_max, 1e-9);
}

TEST(Teacher, DemonstrationsDifferAsTheHabitsSay)
{
  const auto task = taskNamed("button");
  constexpr int kPeople = 400;
  double length = 0.0;
  for (const TaughtLeg& leg : task->scene.motion.legs)
    length += leg.duration;
  double sum = 0.0, squares = 0.0, place = 0.0;
  for (int i = 0; i < kPeople; ++i)
  {
    const Teacher teacher(task->scene.motion, task->teacher, 80.0, task->scene.start, 1, i);
    const double relative = std::log(teacher.duration() / length);
    sum += relative;
    squares += relative * relative;
    place += std::pow(teacher.intended(teacher.duration()).y() - task->scene.motion.legs.back().to.y(), 2);
  }
  // pace 5 %, and five legs of 5 % each: sqrt(1 + sum of squared shares) times 5 %
  double shares = 0.0;
  for (const TaughtLeg& leg : task->scene.motion.legs)
    shares += std::pow(leg.duration / length, 2);
  const double expected = task->teacher.pace * std::sqrt(1.0 + shares);
  const double measured = std::sqrt(squares / kPeople - std::pow(sum / kPeople, 2));
  EXPECT_NEAR(measured, expected, 4.0 * expected / std::sqrt(2.0 * kPeople));  // four standard errors
  EXPECT_NEAR(std::sqrt(place / kPeople), 0.0015, 4.0 * 0.0015 / std::sqrt(2.0 * kPeople));
}

TEST(ContactTask, ListsAllErrors)
{
  const auto message = [](const Parameters& overrides) -> std::string {
    try
    {
      taskNamed("button", overrides);
      return "accepted";
    }
    catch (const phri_core::ParameterError& error)
    {
      return error.what();
    }
  };
  const std::string both = message({ { "seeds", 0.0 }, { "contact/seeking", -1.0 } });
  EXPECT_NE(both.find("seeds = 0"), std::string::npos) << both;
  EXPECT_NE(both.find("seeking = -1"), std::string::npos) << both;
  const std::string files =
      message({ { "safety", std::string("mobile_manipulator") }, { "scene", std::string("maze") } });
  EXPECT_NE(files.find("autonomous_completion"), std::string::npos) << files;
  EXPECT_NE(files.find("maze.yaml"), std::string::npos) << files;
  EXPECT_THROW(taskNamed("maze_assistance"), std::invalid_argument);
}

TEST(ContactTask, RefusesAStartOutOfReach)
{
  ContactTask task = loadContactTask("button");
  task.scene.start = Vector3d(1.6, 0, 1.0);
  EXPECT_THROW(ContactStage(std::make_shared<const ContactTask>(task), { 1, 0.0, -1 }), std::invalid_argument);
}
}  // namespace
