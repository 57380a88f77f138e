#include "interaction_settings.hpp"

#include <algorithm>
#include <map>

#include "parameter_tree.hpp"
#include "phri_core/check.hpp"

namespace phri_control
{
namespace
{
using phri_core::ParameterTable;
using Errors = std::vector<std::string>;

/// Lists as they stand in the file, before their sizes are checked against the arm and the coordinates.
struct Lists
{
  std::vector<double> mass{ 10, 10, 10 }, damping{ 80, 80, 80 }, origin, posture;
  std::vector<double> bias{ 0, 0, 0, 0, 0, 0 }, centre{ 0, 0, 0 };
};

ParameterTable ownTable(InteractionSetup& setup, Lists& lists)
{
  InteractionSettings& s = setup.settings;
  ParameterTable t;
  t.text("arm", &s.arm, {}, "prefix of the sensor's topics, links and joints")
      .text("base_link", &s.base_link, {}, "link where the arm's chain begins; z points up")
      .text("tip_link", &s.tip_link, {}, "link that is moved; empty: <arm>_tool0")
      .text("coordinates", &s.coordinates, { "planar", "point" }, "planar: x, y, yaw; point: x, y, z")
      .text("base", &s.base, { "fixed", "omni" }, "omni: odom in, cmd_vel out")
      .text("output", &s.output, { "joint_velocity", "twist" }, "what the arm is driven by")
      .flag("dry_run", &setup.tick.dry_run, "everything but motion: the velocities given out are zero")
      .list("admittance/mass", &lists.mass, 3, "kg, kgm2", 1e-3, 1e3, "rendered, per coordinate")
      .list("admittance/damping", &lists.damping, 3, "Ns/m, Nms/rad", 0.01, 1e4, "rendered, per coordinate")
      .number("loop/replan_blend", &setup.loop.replan_blend, "s", 0.0, 1.0, "in which a newer plan takes over")
      .list("origin", &lists.origin, 0, "m", -100.0, 100.0,
            "x, y, z of the workspace's middle; empty: where the tool is when the interaction starts")
      .number("stop_time", &setup.tick.stop_time, "s", 0.001, 1.0, "in which an ordered stop brings the robot to rest")
      .number("watchdog/joint_age", &setup.tick.joint_age, "s", 0.001, 1.0, "largest age of joint_states")
      .number("watchdog/odometry_age", &setup.tick.odometry_age, "s", 0.001, 1.0, "largest age of odom")
      .number("watchdog/following_error", &setup.tick.following_error, "m", 0.001, 1.0,
              "largest distance of the tool from where it was told to be")
      .text("assistance/controller", &s.controller, assistanceNames(), "what turns predictions into forces")
      .text("assistance/model", &s.model, {}, "predictions come on prediction/<model>; empty: none")
      .number("assistance/gate", &s.gate, "m", 0.0, 10.0, "a prediction that starts farther away is ignored; 0: none")
      .text("ft_sensor/input", &s.ft_input, { "raw", "compensated" },
            "compensated: bias and payload are removed already")
      .text("ft_sensor/frame", &s.ft_frame, {}, "frame_id that the wrench must have, a link; empty: <arm>_ft_link")
      .text("ft_sensor/stamps", &s.ft_stamps, { "header", "arrival" },
            "arrival: where the sensor's clock is another one")
      .number("ft_sensor/rate", &s.ft_rate, "Hz", 50.0, 10000.0, "of the raw readings")
      .list("ft_sensor/bias", &lists.bias, 6, "N, Nm", -1e3, 1e3, "reading without load, as calibrated")
      .list("ft_sensor/payload/centre", &lists.centre, 3, "m", -2.0, 2.0, "of mass, in the sensor's frame");
  addParameters(t, setup.force_sensor);
  InverseSettings& i = setup.body.inverse;
  t.list("inverse/posture", &lists.posture, 0, "rad", -10.0, 10.0, "preferred, base to tip; empty: the limits' middle")
      .number("inverse/pose_gain", &i.pose_gain, "1/s", 0.0, 100.0, "feedback of the pose error")
      .number("inverse/feedback_linear", &i.feedback_linear, "m/s", 0.0, 1.0, "largest speed of this feedback")
      .number("inverse/feedback_angular", &i.feedback_angular, "rad/s", 0.0, 5.0, "likewise")
      .number("inverse/posture_gain", &i.posture_gain, "1/s", 0.0, 20.0, "null-space motion toward the posture")
      .number("inverse/posture_velocity", &i.posture_velocity, "rad/s", 0.0, 5.0, "largest of it")
      .number("inverse/singular_value", &i.singular_value, "m", 1e-4, 1.0, "below it a direction is damped")
      .number("inverse/length", &i.length, "m", 0.01, 5.0, "1 rad counts as so much")
      .number("inverse/joint_acceleration", &i.joint_acceleration, "rad/s2", 0.1, 100.0, "of the braking before limits")
      .number("inverse/limit_margin", &i.limit_margin, "rad", 0.0, 1.0, "kept from the joint limits")
      .number("inverse/velocity_share", &i.velocity_share, "-", 0.01, 1.0, "of the largest joint velocities");
  CoordinationSettings& c = setup.body.coordination;
  t.number("coordination/heading_gain", &c.heading_gain, "1/s", 0.0, 20.0, "of the base")
      .number("coordination/distance_gain", &c.distance_gain, "1/s", 0.0, 20.0, "likewise")
      .number("coordination/tangential_gain", &c.tangential_gain, "1/s", 0.0, 20.0, "likewise")
      .number("coordination/feedforward", &c.feedforward, "-", 0.0, 1.0, "of the tool's own motion")
      .number("coordination/speed", &c.speed, "m/s", 0.01, 2.0, "largest of the base")
      .number("coordination/turn_rate", &c.turn_rate, "rad/s", 0.01, 3.0, "likewise")
      .number("coordination/acceleration", &c.acceleration, "m/s2", 0.01, 5.0, "likewise")
      .number("coordination/turn_acceleration", &c.turn_acceleration, "rad/s2", 0.01, 10.0, "likewise")
      .number("coordination/dead_zone", &c.dead_zone, "m", 0.0, 1.0, "of the base that is not corrected")
      .number("coordination/heading_dead_zone", &c.heading_dead_zone, "rad", 0.0, 1.0, "likewise");
  return t;
}

template <typename Work>
void collect(Errors& errors, Work&& work)
{
  try
  {
    work();
  }
  catch (const phri_core::ParameterError& error)
  {
    errors.insert(errors.end(), error.errors().begin(), error.errors().end());
  }
  catch (const std::exception& error)
  {
    errors.push_back(error.what());
  }
}

/// The keys of group `name`, under their full names in what is thrown.
void assignGroup(ParameterTable table, const std::string& name, const ParameterMap& group, Errors& errors)
{
  Errors own;
  collect(own, [&] { table.assign(name, group); });
  for (const std::string& error : own)
    errors.push_back(name + '/' + error);
}

/// Pose of the sensor's frame in the tip's; throws where they move against each other.
Eigen::Isometry3d sensorInTip(const ArmKinematics& tip, const ArmKinematics& sensor)
{
  if (tip.jointNames() != sensor.jointNames())
    throw std::invalid_argument("ft_sensor/frame: there are joints between it and tip_link; expected fixed ones only");
  const VectorJoints q = VectorJoints::Zero(tip.joints());
  return tip.forward(q).inverse() * sensor.forward(q);
}

void readRobot(InteractionSetup& setup, const Lists& lists, const std::string& urdf, Errors& errors)
{
  const InteractionSettings& s = setup.settings;
  if (urdf.empty())
  {
    errors.push_back("robot_description: not on the parameter server; expected the robot's URDF as text");
    return;
  }
  collect(errors, [&] { setup.arm.emplace_back(urdf, s.base_link, s.tip_link); });
  collect(errors, [&] { setup.sensor_chain.emplace_back(urdf, s.base_link, s.ft_frame); });
  if (setup.arm.empty())
    return;
  const ArmKinematics& arm = setup.arm.front();
  if (!setup.sensor_chain.empty())
    collect(errors, [&] { setup.sensor = sensorInTip(arm, setup.sensor_chain.front()); });
  if (!lists.posture.empty() && int(lists.posture.size()) != arm.joints())
    errors.push_back("inverse/posture: " + std::to_string(lists.posture.size()) + " angles, expected " +
                     std::to_string(arm.joints()));
  else if (!lists.posture.empty())
  {
    setup.body.inverse.posture = Eigen::Map<const Eigen::VectorXd>(lists.posture.data(), arm.joints());
    setup.body.coordination.preferred = arm.forward(setup.body.inverse.posture);
  }
}
}  // namespace

InteractionSetup loadInteraction(const XmlRpc::XmlRpcValue& parameters, const std::string& urdf,
                                 const std::string& where)
{
  InteractionSetup setup;
  Lists lists;
  Errors errors;
  ParameterTable own = ownTable(setup, lists);
  ParameterMap mine, safety, assistance;
  for (const auto& [key, value] : flatten(parameters, errors))
  {
    const auto& entries = own.entries();
    const bool known = std::any_of(entries.begin(), entries.end(), [&k = key](const auto& e) { return e.key == k; });
    if (!known && key.rfind("safety/", 0) == 0)
      safety[key.substr(7)] = value;
    else if (!known && key.rfind("assistance/", 0) == 0)
      assistance[key.substr(11)] = value;
    else
      mine[key] = value;
  }
  InteractionSettings& s = setup.settings;
  collect(errors, [&] { own.assign(where, mine); });
  if (!errors.empty())
  {  // what is right counts, so that what depends on it is checked too
    Errors listed;
    for (const auto& entry : mine)
      collect(listed, [&] { own.assign(where, { entry }); });
  }
  assignGroup(parameterTable(setup.loop.safety), "safety", safety, errors);
  assignGroup(parameterTable(setup.assistance), "assistance", assistance, errors);

  s.tip_link = s.tip_link.empty() ? s.arm + "_tool0" : s.tip_link;
  s.ft_frame = s.ft_frame.empty() ? s.arm + "_ft_link" : s.ft_frame;
  setup.tick.planar = s.planar();
  setup.tick.mobile = setup.body.base_moves = s.mobile();
  setup.body.coordination.dt = setup.body.inverse.dt = setup.loop.dt;
  setup.loop.mass = setup.assistance.mass = Eigen::Map<const Eigen::VectorXd>(lists.mass.data(), 3);
  setup.loop.damping = setup.assistance.damping = Eigen::Map<const Eigen::VectorXd>(lists.damping.data(), 3);
  setup.loop.safety.rotations = setup.assistance.rotations = s.planar() ? 1 : 0;
  setup.force_sensor.dt = 1.0 / s.ft_rate;
  setup.force_sensor.bias = Eigen::Map<const Vector6d>(lists.bias.data());
  setup.force_sensor.payload.centre = Eigen::Map<const Eigen::Vector3d>(lists.centre.data());
  if (setup.force_sensor.inertial)
    errors.push_back("ft_sensor/inertial = true: expected false; accelerations are not measured here");
  if (!lists.origin.empty() && lists.origin.size() != 3)
    errors.push_back("origin: " + std::to_string(lists.origin.size()) + " numbers, expected 3 or none");
  else if (!lists.origin.empty())
  {
    setup.tick.origin_fixed = true;
    setup.tick.origin = Eigen::Map<const Eigen::Vector3d>(lists.origin.data());
  }
  if (s.mobile() && lists.posture.empty())
    errors.push_back("inverse/posture: missing; with base = \"omni\" it tells where the base keeps the tool");
  if (s.controller != "none" && s.model.empty())
    errors.push_back("assistance/model: missing with assistance/controller = \"" + s.controller +
                     "\"; expected the name of the model that publishes prediction/<model>");
  readRobot(setup, lists, urdf, errors);
  if (errors.empty())
  {  // what only the parts themselves can tell
    collect(errors, [&] { RobotTick(setup.tick, setup.loop, setup.arm.front(), setup.body, setup.sensor); });
    collect(errors, [&] { ForceSensor{ setup.force_sensor }; });
    collect(errors, [&] { makeAssistance(s.controller, setup.assistance); });
  }
  if (!errors.empty())
    throw phri_core::ParameterError(where, errors);
  return setup;
}

std::string interactionParameters()
{
  InteractionSetup setup;
  Lists lists;
  return ownTable(setup, lists).markdown() + "\nUnder `safety/`:\n\n" + parameterTable(setup.loop.safety).markdown() +
         "\nUnder `assistance/`:\n\n" + parameterTable(setup.assistance).markdown();
}
}  // namespace phri_control
