#include "phri_sim/contact_stage.hpp"

#include <cmath>
#include <map>
#include <stdexcept>

namespace phri_sim
{
namespace
{
using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kSettle = 0.1;   // [s] before the tare: what placing the robot shook comes to rest
constexpr double kAtRest = 0.01;  // [m/s] of the tip
constexpr int kSensor = 0;        // the world's only one
const Material kFelt{ 5e3, 0.5, 0.2 };
const Material kBoard{ 1e5, 0.2, 0.2 };
const std::string kEraser = "object";

/// Robot, tool, and surroundings displaced as the trial wants.
World buildWorld(const ContactTask& task, const RobotDescription& robot, double displacement)
{
  const ContactScene& scene = task.scene;
  const Vector3d shift = scene.shift(displacement);
  std::vector<TreePart> parts{ { robot, "", Isometry3d::Identity() } };
  WhiteboardParameters board = scene.board;
  WorldOptions options;
  options.sensors = { task.robot.arm + "_ft_joint" };
  std::vector<StaticShape> statics;
  if (scene.wipes)
  {
    parts.push_back({ loadRobot("eraser"), task.robot.arm + "_gripper_tcp", Isometry3d::Identity() });
    board.pose.translation() += shift;
    options.materials[kEraser] = kFelt;
  }
  else
  {
    const Vector3d place = scene.button + shift;
    parts.push_back({ loadRobot("button"), "", Isometry3d(Eigen::Translation3d(place)) });
    StaticShape pillar;
    pillar.name = "pillar";
    pillar.shape.size << 0.08, 0.08, place.z();
    pillar.shape.origin.translation() << place.x(), place.y(), 0.5 * place.z();
    statics.push_back(pillar);
  }
  statics.push_back(Whiteboard::shape(board, "whiteboard", kBoard));
  return World(parts, statics, options);
}

Isometry3d pose(const Vector3d& position, const Eigen::Matrix3d& orientation)
{
  Isometry3d result = Isometry3d::Identity();
  result.translation() = position;
  result.linear() = orientation;
  return result;
}
}  // namespace

/// What has to be known before the members can be built.
struct ContactStage::Setup
{
  phri_control::ArmKinematics arm;
  phri_control::WholeBodySettings body;
  World world;
  std::optional<Teacher> teacher;

  static Setup of(const ContactTask& task, const ContactTrial& trial)
  {
    const ContactScene& scene = task.scene;
    const RobotDescription robot = loadRobot(task.robot.model);
    Setup setup{
      { robot.urdf, "base_link", task.robot.arm + "_gripper_tcp" }, {}, buildWorld(task, robot, trial.displacement), {}
    };
    Vector3d start = scene.start;
    if (trial.demonstration >= 0)
    {
      phri_core::Random random = phri_core::Random::stream(trial.seed, "start", std::uint64_t(trial.demonstration));
      for (int i = 0; i < 3; ++i)
        start(i) += random.normal(0.0, task.teacher.start);
      setup.teacher.emplace(scene.motion, task.teacher, task.loop.damping(0), start, trial.seed, trial.demonstration);
    }
    setup.place(task, start);
    return setup;
  }

  /// The tip goes to `start`, in the posture nearest to the natural one.
  void place(const ContactTask& task, const Vector3d& start)
  {
    const std::map<std::string, double> natural = naturalPosture();
    phri_control::VectorJoints posture(arm.joints());
    for (int i = 0; i < arm.joints(); ++i)
      posture(i) = natural.at(arm.jointNames()[std::size_t(i)]);
    body.base_moves = false;
    body.inverse.dt = body.coordination.dt = task.loop.dt;
    body.inverse.posture = posture;
    const Eigen::Matrix3d orientation = task.scene.orientation();
    const Vector3d tcp = start - task.scene.tip * orientation.col(2);
    phri_core::Random random = phri_core::Random::stream(0, "posture");  // of the task, the same in every trial
    const phri_control::PostureResult found =
        findPosture(phri_control::DifferentialInverse(arm, body.inverse), pose(tcp, orientation), posture, random);
    if (!found.converged)
      throw std::invalid_argument(task.scene.name + ": start: " + task.robot.model +
                                  " cannot hold its tool there: " + std::to_string(found.error) + " m off");
    body.inverse.posture = found.posture;
    Eigen::VectorXd q = Eigen::VectorXd::Zero(world.model().dofs());
    for (int i = 0; i < arm.joints(); ++i)
      q(world.model().joint(arm.jointNames()[std::size_t(i)])) = found.posture(i);
    if (task.scene.wipes)  // the jaws hold the eraser, along its shorter edge
    {
      const double half = 0.5 * world.model().links()[std::size_t(world.model().link(kEraser))].collision[0].size.y();
      for (const char* finger : { "left", "right" })
        q(world.model().joint(task.robot.arm + "_gripper_" + finger + "_finger_joint")) = half;
    }
    world.setState(q, Eigen::VectorXd::Zero(q.size()));
  }
};

ContactStage::ContactStage(std::shared_ptr<const ContactTask> task, const ContactTrial& trial)
  : ContactStage(task, trial, Setup::of(*task, trial))
{
}

ContactStage::ContactStage(std::shared_ptr<const ContactTask> task, const ContactTrial& trial, Setup setup)
  : task_(std::move(task)),
    body_(setup.arm, setup.body),
    world_(std::move(setup.world)),
    robot_(&world_, task_->robot, kSensor, task_->loop.dt,
           phri_core::Random::stream(trial.seed, "trial", std::uint64_t(trial.demonstration + 1)).bits()),
    force_sensor_([this] {
      phri_control::ForceSensorSettings settings = task_->force_sensor;
      settings.payload = payloadBeyond(world_, world_.model().fixedJoint(task_->robot.arm + "_ft_joint"));
      return phri_control::ForceSensor(settings);
    }()),
    teacher_(std::move(setup.teacher)),
    orientation_(task_->scene.orientation()),
    offset_(task_->scene.tip * orientation_.col(2)),
    tcp_link_(world_.model().link(task_->robot.arm + "_gripper_tcp")),
    hand_link_(world_.model().link(task_->robot.arm + "_7_link"))
{
  const Isometry3d tcp = world_.linkPose(tcp_link_);
  sensor_ = tcp.inverse() * world_.linkPose(world_.model().link(task_->robot.arm + "_ft_link"));
  if (task_->scene.wipes)
  {
    WhiteboardParameters board = task_->scene.board;
    board.pose.translation() += task_->scene.shift(trial.displacement);
    board_ = std::make_unique<Whiteboard>(world_, board, kEraser);
    tool_links_ = { world_.model().link(kEraser) };
  }
  else
    button_ = std::make_unique<Button>(world_, "button_joint");
  for (const char* finger : { "left", "right" })
    tool_links_.push_back(world_.model().link(task_->robot.arm + "_gripper_" + finger + "_finger_link"));
  settle();
  start_ = believedTip(body_.inverse().arm().forward(robot_.joints()));
}

Vector3d ContactStage::believedTip(const Isometry3d& tcp) const noexcept
{
  return tcp * Vector3d(0.0, 0.0, task_->scene.tip);
}

Vector3d ContactStage::tip() const noexcept
{
  return believedTip(world_.linkPose(tcp_link_));
}

Vector3d ContactStage::contactForce() const noexcept
{
  Vector3d sum = Vector3d::Zero();
  for (const int link : tool_links_)
    sum += world_.contactForce(link);
  return sum;
}

/// Holds still, alone, and tares.
void ContactStage::settle()
{
  const phri_control::VectorJoints still = phri_control::VectorJoints::Zero(body_.inverse().arm().joints());
  const double dt = robot_.period();
  const auto hold = [&] {
    robot_.drive(phri_control::BaseTwist::Zero(), still);
    world_.step(dt, robot_.torques());
    robot_.sense();
    phri_control::SensorMotion motion;
    motion.orientation = (body_.inverse().arm().forward(robot_.joints()) * sensor_).linear();
    force_sensor_.update(robot_.wrenchRaw(), motion);
  };
  for (int i = 0; i < std::lround(kSettle / dt); ++i)
    hold();
  force_sensor_.tare();
  while (force_sensor_.tareReport().state == phri_control::TareState::Running)
    hold();
  if (force_sensor_.tareReport().state != phri_control::TareState::Done)
    throw std::runtime_error("the wrist sensor could not be tared: " + describe(force_sensor_.tareReport()));
}

phri_core::Measurement ContactStage::read(std::int64_t now_ns, const phri_core::VectorDof&) noexcept
{
  const Isometry3d tcp = body_.inverse().arm().forward(robot_.joints());
  Vector3d hand = Vector3d::Zero();
  if (teacher_)
  {
    const Vector3d at = tip();
    hand = teacher_->force(now_ns * 1e-9, robot_.period(), at, world_.dynamics().pointVelocity(tcp_link_, at));
    world_.addForce(hand_link_, world_.linkPose(hand_link_).translation(), hand);
  }
  phri_control::SensorMotion motion;
  motion.orientation = (tcp * sensor_).linear();
  const phri_control::ForceReading reading = force_sensor_.update(robot_.wrenchRaw(), motion);
  phri_core::Measurement m;
  m.receive_ns = m.stamp_ns = now_ns;
  m.sequence = ++sequence_;
  m.position = believedTip(tcp);
  m.human_wrench = hand;
  m.environment_wrench = Vector3d(motion.orientation * reading.wrench.head<3>());
  return m;
}

void ContactStage::write(const phri_core::Command& command) noexcept
{
  phri_control::EndEffectorCommand wanted;
  wanted.pose = pose(Vector3d(command.position) - offset_, orientation_);
  wanted.twist.head<3>() = command.velocity;
  const phri_control::WholeBodyCommand rates = body_.update(robot_.joints(), phri_control::BaseState(), wanted);
  tracking_error_ = rates.error;
  robot_.drive(phri_control::BaseTwist::Zero(), rates.arm.velocity);
  world_.step(robot_.period(), robot_.torques());
  robot_.sense();
  if (button_)
    button_->update();
  if (board_)
    board_->update(world_);
}

bool ContactStage::arrived() const noexcept
{
  if (board_)
    return board_->share() >= task_->wiped_success && !(board_->force() > 0.0);
  return button_->clicks() > 0 && pointingError() < task_->pointing_tolerance &&
         world_.dynamics().pointVelocity(tcp_link_, tip()).norm() < kAtRest;
}
}  // namespace phri_sim
