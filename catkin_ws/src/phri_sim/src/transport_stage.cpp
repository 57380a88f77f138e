#include "phri_sim/transport_stage.hpp"

#include <cmath>
#include <map>
#include <stdexcept>

#include "phri_sim/configuration.hpp"

namespace phri_sim
{
namespace
{
constexpr double kSettle = 0.1;   // [s] before the tare: what placing the robot shook comes to rest
constexpr double kArrived = 0.1;  // [m] of the far grasp from the end of the route
constexpr double kAtRest = 0.03;  // [m/s] of the far grasp
constexpr int kSensor = 0;        // the world's only one
constexpr double kJaw = 0.01;     // [m] from the middle: the tab is 20 mm thick

double yawOf(const Eigen::Isometry3d& tip, const Eigen::Matrix3d& level)
{
  const Eigen::Matrix3d turned = tip.linear() * level.transpose();
  return std::atan2(turned(1, 0), turned(0, 0));
}

/// The bumper lies along the gripper's approach, z of the tip, and its tab between the jaws, which move along y. Of the
/// two ways to hold it so, the one nearer to `natural`.
Eigen::Matrix3d levelGrasp(const Eigen::Matrix3d& natural)
{
  Eigen::Matrix3d upright, turned;
  upright << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  turned << 0, 0, 1, 0, -1, 0, 1, 0, 0;
  return (natural - upright).norm() < (natural - turned).norm() ? upright : turned;
}

World buildWorld(const Experiment& e, const RobotDescription& robot, const Eigen::Matrix3d& level)
{
  Eigen::Isometry3d grasp = Eigen::Isometry3d::Identity();
  grasp.linear() = level.transpose();
  const std::vector<TreePart> parts{ { robot, "", Eigen::Isometry3d::Identity() },
                                     { loadRobot("bumper"), e.robot.arm + "_gripper_tcp", grasp } };
  std::vector<StaticShape> statics;
  for (const LabBox& box : e.lab->boxes)
  {
    StaticShape shape;
    shape.name = box.name;
    shape.shape.size << box.size, box.height;
    shape.shape.origin.translation() << box.center, 0.5 * box.height;
    shape.shape.origin.linear() = Eigen::AngleAxisd(box.yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    statics.push_back(shape);
  }
  WorldOptions options;
  options.sensors = { e.robot.arm + "_ft_joint" };
  return World(parts, statics, options);
}

/// A path for the far grasp, and the person who follows it.
CarryingPartner personOf(const Experiment& e, const TrialSpec& spec, const LabRoute& route)
{
  CarryingPlan plan;
  plan.path = std::make_shared<const WalkingPath>(e.lab->path(route));
  plan.initial_yaw = e.lab->start_yaw;
  CarriedObject object;
  object.mass = e.lab->object_mass;
  object.grasp_distance = e.lab->grasp_distance;
  object.rendered_mass = e.loop.mass(0);
  object.rendered_damping = e.loop.damping(0);
  object.rendered_inertia = e.loop.mass(2);
  object.rendered_turn_damping = e.loop.damping(2);
  return CarryingPartner(plan, object, e.carriers.person(spec.study_seed, spec.participant), spec.seed);
}
}  // namespace

/// What has to be known before the members can be built.
struct TransportStage::Setup
{
  const LabRoute* route;
  phri_control::ArmKinematics arm;
  phri_control::WholeBodySettings body;
  Eigen::Matrix3d level;
  World world;

  static Setup of(const Experiment& e, const TrialSpec& spec)
  {
    const RobotDescription robot = loadRobot(e.robot.model);
    const phri_control::ArmKinematics arm(robot.urdf, "base_link", e.robot.arm + "_gripper_tcp");
    const std::map<std::string, double> natural = naturalPosture();
    phri_control::VectorJoints posture(arm.joints());
    for (int i = 0; i < arm.joints(); ++i)
      posture(i) = natural.at(arm.jointNames()[std::size_t(i)]);
    phri_control::WholeBodySettings body;
    body.inverse.dt = body.coordination.dt = e.loop.dt;
    body.inverse.posture = posture;
    Eigen::Isometry3d preferred = arm.forward(posture);
    const Eigen::Matrix3d level = levelGrasp(preferred.linear());
    preferred.linear() = level;
    body.coordination.preferred = preferred;
    phri_core::Random random = phri_core::Random::stream(spec.seed, "posture");
    const phri_control::PostureResult found =
        findPosture(phri_control::DifferentialInverse(arm, body.inverse), preferred, posture, random);
    if (!found.converged)
      throw std::invalid_argument(e.robot.model + ": " + e.robot.arm +
                                  " cannot hold the bumper level in front: " + std::to_string(found.error) + " m off");
    body.inverse.posture = found.posture;
    Setup setup{ &e.lab->route(e.routes[std::size_t(spec.trial - 1) % e.routes.size()]), arm, body, level,
                 buildWorld(e, robot, level) };
    setup.placeRobot(e, natural);
    return setup;
  }

  /// The robot's grasp goes one bumper behind the start of the far one, the base to where it likes to see it.
  void placeRobot(const Experiment& e, const std::map<std::string, double>& natural)
  {
    const double yaw = e.lab->start_yaw, c = std::cos(yaw), s = std::sin(yaw);
    const Eigen::Vector2d grasp = e.lab->start - e.lab->grasp_distance * Eigen::Vector2d(c, s);
    const Eigen::Vector3d p = body.coordination.preferred.translation();
    Eigen::VectorXd q = Eigen::VectorXd::Zero(world.model().dofs());
    for (int i = 0; i < q.size(); ++i)
    {
      const auto known = natural.find(world.model().joints()[std::size_t(i)].description.name);
      q(i) = known == natural.end() ? 0.0 : known->second;
    }
    q(world.model().joint("base_x_joint")) = grasp.x() - (c * p.x() - s * p.y());
    q(world.model().joint("base_y_joint")) = grasp.y() - (s * p.x() + c * p.y());
    q(world.model().joint("base_yaw_joint")) = yaw;
    for (int i = 0; i < arm.joints(); ++i)
      q(world.model().joint(arm.jointNames()[std::size_t(i)])) = body.inverse.posture(i);
    for (const char* finger : { "left", "right" })
      q(world.model().joint(e.robot.arm + "_gripper_" + finger + "_finger_joint")) = kJaw;
    world.setState(q, Eigen::VectorXd::Zero(q.size()));
  }
};

TransportStage::TransportStage(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec)
  : TransportStage(experiment, spec, Setup::of(*experiment, spec))
{
}

TransportStage::TransportStage(std::shared_ptr<const Experiment> experiment, const TrialSpec& spec, Setup setup)
  : experiment_(std::move(experiment)),
    route_(setup.route),
    body_(setup.arm, setup.body),
    world_(std::move(setup.world)),
    robot_(&world_, experiment_->robot, kSensor, experiment_->loop.dt, spec.seed),
    force_sensor_([this] {
      phri_control::ForceSensorSettings settings = experiment_->force_sensor;
      settings.dt = experiment_->loop.dt;
      settings.payload = payloadBeyond(world_, world_.model().fixedJoint(experiment_->robot.arm + "_ft_joint"));
      return phri_control::ForceSensor(settings);
    }()),
    partner_(personOf(*experiment_, spec, *route_)),
    level_(setup.level),
    tip_link_(world_.model().link(experiment_->robot.arm + "_gripper_tcp")),
    far_link_(world_.model().link("object_human"))
{
  const Eigen::Isometry3d tip = world_.linkPose(tip_link_);
  sensor_ = tip.inverse() * world_.linkPose(world_.model().link(experiment_->robot.arm + "_ft_link"));
  height_ = tip.translation().z();
  yaw_ = yawOf(tip, level_);
  settle();
  start_.resize(3);
  start_ << believedTip().translation().head<2>(), yaw_;
}

Eigen::Isometry3d TransportStage::believedTip() const noexcept
{
  return robot_.odometry().transform() * body_.inverse().arm().forward(robot_.joints());
}

TransportSample TransportStage::sample() const noexcept
{
  const Eigen::Isometry3d tip = world_.linkPose(tip_link_), far = world_.linkPose(far_link_), believed = believedTip();
  const Eigen::Vector3d along = far.translation() - tip.translation();
  TransportSample sample;
  sample.grasp << tip.translation().head<2>(), yawOf(tip, level_);
  sample.far_grasp << far.translation().head<2>(), std::atan2(along.y(), along.x());
  sample.base = robot_.base();
  const Vector6 velocity = world_.dynamics().linkVelocity(tip_link_);
  sample.observation << believed.translation(), believed.linear() * tip.linear().transpose() * velocity.tail<3>(),
      sensed_;
  return sample;
}

/// Holds still, alone, and tares.
void TransportStage::settle()
{
  const phri_control::VectorJoints still = phri_control::VectorJoints::Zero(body_.inverse().arm().joints());
  const double dt = robot_.period();
  const auto hold = [&] {
    robot_.drive(phri_control::BaseTwist::Zero(), still);
    world_.step(dt, robot_.torques());
    robot_.sense();
    phri_control::SensorMotion motion;
    motion.orientation = (believedTip() * sensor_).linear();
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

phri_core::Measurement TransportStage::read(std::int64_t now_ns, const phri_core::VectorDof& assistance) noexcept
{
  const Eigen::Isometry3d tip = world_.linkPose(tip_link_), believed = believedTip();
  const Eigen::Isometry3d far = world_.linkPose(far_link_);
  FarEnd end;
  end.position = far.translation();
  end.rotation = far.linear();
  end.velocity = world_.dynamics().linkVelocity(far_link_);
  const Eigen::Matrix3d to_world = tip.linear() * believed.linear().transpose();
  const Eigen::Vector3d force = to_world * Eigen::Vector3d(assistance(0), assistance(1), 0.0);
  end.robot_wrench << force,
      Eigen::Vector3d(0.0, 0.0, assistance(2)) + (tip.translation() - far.translation()).cross(force);
  human_wrench_ = partner_.step(now_ns * 1e-9, end);
  world_.addWrench(far_link_, end.position, human_wrench_);

  phri_control::SensorMotion motion;
  motion.orientation = (believed * sensor_).linear();
  const phri_control::ForceReading reading = force_sensor_.update(robot_.wrenchRaw(), motion);
  Eigen::Isometry3d at_tip = Eigen::Isometry3d::Identity();
  at_tip.linear() = motion.orientation;
  at_tip.translation() = believed.linear() * sensor_.translation();
  sensed_ = phri_control::transformWrench(at_tip, reading.wrench);

  const double yaw = yawOf(believed, level_);
  yaw_ += std::remainder(yaw - yaw_, 2.0 * M_PI);
  phri_core::Measurement m;
  m.receive_ns = m.stamp_ns = now_ns;
  m.sequence = ++sequence_;
  m.position.resize(3);
  m.position << believed.translation().head<2>(), yaw_;
  m.human_wrench.resize(3);
  m.human_wrench << sensed_(0), sensed_(1), sensed_(5);
  m.environment_wrench = phri_core::VectorDof::Zero(3);
  return m;
}

void TransportStage::write(const phri_core::Command& command) noexcept
{
  const phri_control::WholeBodyCommand motion =
      body_.update(robot_.joints(), robot_.odometry(),
                   phri_control::planarCommand(command.position, command.velocity, height_, level_));
  tracking_error_ = motion.error;
  robot_.drive(motion.base, motion.arm.velocity);
  world_.step(robot_.period(), robot_.torques());
  robot_.sense();
  const Eigen::Vector2d end = partner_.intention().walked, far = world_.linkPose(far_link_).translation().head<2>();
  arrived_ = partner_.intention().arrived && (far - end).norm() < kArrived &&
             world_.dynamics().linkVelocity(far_link_).head<2>().norm() < kAtRest;
}
}  // namespace phri_sim
