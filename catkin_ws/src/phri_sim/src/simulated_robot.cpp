#include "phri_sim/simulated_robot.hpp"

#include <algorithm>
#include <cmath>

#include "phri_sim/configuration.hpp"

namespace phri_sim
{
namespace
{
constexpr double kLead = 0.05;            // [rad] a servo's reference may be ahead of its joint
constexpr double kFingerStiffness = 2e4;  // [N/m]
constexpr double kHoldBandwidth = 15.0;   // [Hz] of all that only holds its posture
constexpr double kTypicalSpeed = 0.2;     // [m/s] at which `heading_drift` holds

/// Critically damped servo of a joint that moves `inertia`.
JointDrive servo(double inertia, double bandwidth, double position)
{
  const double rate = 2.0 * M_PI * bandwidth;
  return { inertia * rate * rate, 2.0 * inertia * rate, position, 0.0 };
}
}  // namespace

std::map<std::string, double> naturalPosture()
{
  std::map<std::string, double> result;
  for (const auto& [name, value] : underPrefix(loadYaml(shareFolder() + "/urdf/postures.yaml"), "zeros"))
    result[name] = std::get<double>(value);
  return result;
}

void addParameters(phri_core::ParameterTable& table, RobotSettings& s)
{
  table.text("robot/model", &s.model, {}, "description, file in urdf/")
      .text("robot/arm", &s.arm, {}, "that acts; the rest of the robot holds its posture")
      .number("robot/arm_bandwidth", &s.arm_bandwidth, "Hz", 1.0, 50.0, "of the joints' position servos")
      .number("robot/base_bandwidth", &s.base_bandwidth, "Hz", 0.5, 20.0, "of the base's velocity loop")
      .number("robot/slip", &s.slip, "-", 0.0, 0.2, "standard deviation of the odometry's scale errors, per trial")
      .number("robot/heading_drift", &s.heading_drift, "rad/s", 0.0, 0.1,
              "standard deviation of the odometry's turning at 0.2 m/s, per trial");
  addParameters(table, s.sensor);
}

phri_control::Payload payloadBeyond(const World& world, int fixed_joint)
{
  const TreeFixedJoint& joint = world.model().fixedJoints()[std::size_t(fixed_joint)];
  const TreeLink& link = world.model().links()[std::size_t(joint.link)];
  LumpInertia all = joint.beyond;
  const Eigen::Isometry3d own = world.dynamics().bodyPose(link.body);
  for (const int index : joint.bodies_beyond)
  {
    const LumpInertia& part = world.model().bodies()[std::size_t(index)].inertia;
    const Eigen::Isometry3d pose = own.inverse() * world.dynamics().bodyPose(index);
    all.mass += part.mass;
    all.moment += part.mass * pose.translation() + pose.linear() * part.moment;
  }
  phri_control::Payload payload;
  payload.mass = all.mass;
  payload.centre = link.pose.inverse() * (all.moment / all.mass);
  return payload;
}

SimulatedRobot::SimulatedRobot(World* world, const RobotSettings& settings, int sensor, double dt,
                               std::uint64_t trial_seed)
  : world_(world),
    sensor_(sensor),
    dt_(dt),
    ft_(settings.sensor, dt, trial_seed, settings.arm),
    raw_(phri_control::Vector6d::Zero()),
    torque_(Eigen::VectorXd::Zero(world->model().dofs())),
    zero_(torque_)
{
  const TreeModel& model = world->model();
  for (int i = 0; i < 7; ++i)
    arm_.push_back(model.joint(settings.arm + "_" + std::to_string(i) + "_joint"));
  for (int i = 0; i < model.dofs(); ++i)
  {
    const std::string& name = model.joints()[std::size_t(i)].description.name;
    if (name == "base_x_joint" || name == "base_y_joint" || name == "base_yaw_joint")
      base_[name == "base_x_joint" ? 0 : name == "base_y_joint" ? 1 : 2] = i;
    if (name.rfind(settings.arm + "_gripper_", 0) == 0)
      fingers_.push_back(i);
  }
  TreeDynamics& dynamics = world->dynamics();
  dynamics.prepare(0.0);
  Eigen::MatrixXd mass(model.dofs(), model.dofs());
  dynamics.massMatrix(mass);
  for (int i = 0; i < model.dofs(); ++i)
  {
    const bool acts = std::find(arm_.begin(), arm_.end(), i) != arm_.end();
    const bool rolls = std::find(base_.begin(), base_.end(), i) != base_.end();
    const std::string& name = model.joints()[std::size_t(i)].description.name;
    JointDrive& drive = dynamics.drives()[std::size_t(i)];
    if (rolls)
      drive = { 0.0, mass(i, i) * 2.0 * M_PI * settings.base_bandwidth, 0.0, 0.0 };
    else if (acts)
      drive = servo(mass(i, i), settings.arm_bandwidth, world->q()(i));
    else if (name.find("_gripper_") != std::string::npos)
      drive = { kFingerStiffness, 2.0 * std::sqrt(kFingerStiffness * mass(i, i)), world->q()(i), 0.0 };
    else if (name.find("_joint") != std::string::npos && name.rfind("button", 0) != 0)
      drive = servo(mass(i, i), kHoldBandwidth, world->q()(i));
  }
  phri_core::Random random = phri_core::Random::stream(trial_seed, "odometry");
  for (int i = 0; i < 3; ++i)
    scale_(i) = 1.0 + settings.slip * random.normal();
  turning_ = settings.heading_drift / kTypicalSpeed * random.normal();
  q_ = reference_ = phri_control::VectorJoints::Zero(7);
  odometry_.pose = base();
  for (int i = 0; i < 7; ++i)
    q_(i) = reference_(i) = world->q()(arm_[std::size_t(i)]);
}

Eigen::Vector3d SimulatedRobot::base() const noexcept
{
  if (!mobile())
    return Eigen::Vector3d::Zero();
  return { world_->q()(base_[0]), world_->q()(base_[1]), world_->q()(base_[2]) };
}

phri_control::BaseTwist SimulatedRobot::baseTwist() const noexcept
{
  if (!mobile())
    return phri_control::BaseTwist::Zero();
  const Eigen::VectorXd& v = world_->qd();
  const double c = std::cos(base().z()), s = std::sin(base().z()), x = v(base_[0]), y = v(base_[1]);
  return { c * x + s * y, c * y - s * x, v(base_[2]) };
}

void SimulatedRobot::drive(const phri_control::BaseTwist& base_command,
                           const phri_control::VectorJoints& rates) noexcept
{
  std::vector<JointDrive>& drives = world_->dynamics().drives();
  const bool turns = rates.size() == 7 && rates.allFinite();
  for (int i = 0; i < 7; ++i)
  {
    const double rate = turns ? rates(i) : 0.0;
    reference_(i) = std::clamp(reference_(i) + dt_ * rate, q_(i) - kLead, q_(i) + kLead);
    JointDrive& drive = drives[std::size_t(arm_[std::size_t(i)])];
    drive.position = reference_(i);
    drive.velocity = rate;
  }
  if (!mobile())
    return;
  const phri_control::BaseTwist twist =
      base_command.allFinite() ? base_command : phri_control::BaseTwist(phri_control::BaseTwist::Zero());
  const double c = std::cos(base().z()), s = std::sin(base().z());
  drives[std::size_t(base_[0])].velocity = c * twist.x() - s * twist.y();
  drives[std::size_t(base_[1])].velocity = s * twist.x() + c * twist.y();
  drives[std::size_t(base_[2])].velocity = twist.z();
}

void SimulatedRobot::grip(double opening) noexcept
{
  if (!std::isfinite(opening))
    return;
  for (const int finger : fingers_)
  {
    const JointDescription& joint = world_->model().joints()[std::size_t(finger)].description;
    world_->dynamics().drives()[std::size_t(finger)].position = std::clamp(opening, joint.lower, joint.upper);
  }
}

const Eigen::VectorXd& SimulatedRobot::torques() noexcept
{
  world_->dynamics().inverseDynamics(zero_, torque_);
  return torque_;
}

void SimulatedRobot::sense() noexcept
{
  for (int i = 0; i < 7; ++i)
    q_(i) = world_->q()(arm_[std::size_t(i)]);
  raw_ = ft_.read(world_->sensorWrench(sensor_));
  if (!mobile())
    return;
  const phri_control::BaseTwist twist = baseTwist();
  odometry_.twist = twist.cwiseProduct(scale_);
  odometry_.twist.z() += turning_ * twist.head<2>().norm();
  const double middle = odometry_.pose.z() + 0.5 * dt_ * odometry_.twist.z();
  odometry_.pose.x() += dt_ * (std::cos(middle) * odometry_.twist.x() - std::sin(middle) * odometry_.twist.y());
  odometry_.pose.y() += dt_ * (std::sin(middle) * odometry_.twist.x() + std::cos(middle) * odometry_.twist.y());
  odometry_.pose.z() += dt_ * odometry_.twist.z();
}
}  // namespace phri_sim
