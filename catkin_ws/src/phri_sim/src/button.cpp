#include "phri_sim/button.hpp"

#include <algorithm>
#include <stdexcept>
#include <vector>

namespace phri_sim
{
namespace
{
constexpr double kTouch = 1e-3;  // force that counts as a touch [N]

/// What gravity pushes the cap with along its joint, the rest of the tree in its present pose [N].
double weight(World& world, int joint)
{
  const Eigen::VectorXd q = world.q(), qd = world.qd(), rest = Eigen::VectorXd::Zero(q.size());
  Eigen::VectorXd tau(q.size());
  world.setState(q, rest);
  world.dynamics().inverseDynamics(rest, tau);
  world.setState(q, qd);
  return -tau(joint);
}
}  // namespace

Button::Button(World& world, const std::string& joint, const ButtonParameters& parameters)
  : world_(&world), parameters_(parameters), joint_(world.model().joint(joint))
{
  const JointDescription& slider = world.model().joints()[std::size_t(joint_)].description;
  cap_ = world.model().link(slider.child);
  std::string errors;
  const auto require = [&](bool good, const std::string& what) {
    if (!good)
      errors += "\n  " + what;
  };
  const auto mm = [](double value) { return std::to_string(1e3 * value) + " mm"; };
  require(slider.kind == JointKind::Prismatic, "the joint must be prismatic");
  require(slider.lower == 0.0, "the joint's lower limit is " + mm(slider.lower) + "; expected 0");
  require(
      slider.upper > parameters.click && slider.upper < 1.0,
      "the joint's upper limit is " + mm(slider.upper) + "; expected more than the click at " + mm(parameters.click));
  require(parameters.release > 0.0 && parameters.release < parameters.click,
          "release at " + mm(parameters.release) + "; expected between 0 and the click at " + mm(parameters.click));
  require(parameters.stiffness > 0.0 && parameters.stiffness <= 1e5,
          "stiffness " + std::to_string(parameters.stiffness) + " N/m; expected 0 to 1e5");
  require(parameters.damping >= 0.0, "damping " + std::to_string(parameters.damping) + " Ns/m; expected at least 0");
  if (!errors.empty())
    throw std::invalid_argument("button '" + joint + "':" + errors);

  JointDrive& spring = world.dynamics().drives()[std::size_t(joint_)];
  spring.stiffness = parameters.stiffness;
  spring.damping = parameters.damping;
  spring.position = -weight(world, joint_) / parameters.stiffness;
}

double Button::travel() const noexcept
{
  return world_->q()(joint_);
}

void Button::update() noexcept
{
  const Eigen::Vector3d axis =
      world_->linkPose(cap_).linear() * world_->model().joints()[std::size_t(joint_)].description.axis;
  force_ = axis.dot(world_->contactForce(cap_));
  const bool touched = force_ > kTouch;
  touches_ += touched && !touching_;
  touching_ = touched;
  const bool down = travel() >= (pressed_ ? parameters_.release : parameters_.click);
  clicks_ += down && !pressed_;
  pressed_ = down;
  deepest_ = std::max(deepest_, travel());
}

void Button::reset() noexcept
{
  force_ = deepest_ = 0.0;
  touching_ = pressed_ = false;
  touches_ = clicks_ = 0;
}
}  // namespace phri_sim
