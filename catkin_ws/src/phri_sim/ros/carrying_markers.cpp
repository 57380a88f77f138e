#include <Eigen/Eigenvalues>
#include <cmath>
#include <cstdio>

#include "lab_markers.hpp"
#include "robot_messages.hpp"

namespace phri_sim
{
namespace
{
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr Color kHuman{ 0.12f, 0.42f, 0.80f }, kTrousers{ 0.25f, 0.28f, 0.34f }, kShoe{ 0.12f, 0.12f, 0.13f },
    kSkin{ 0.87f, 0.68f, 0.55f }, kHair{ 0.30f, 0.21f, 0.15f }, kAssistance{ 0.90f, 0.45f, 0.05f },
    kSensed{ 0.05f, 0.55f, 0.60f }, kContact{ 0.80f, 0.08f, 0.15f }, kPrediction{ 0.55f, 0.25f, 0.70f },
    kReal{ 0.15f, 0.16f, 0.20f, 0.9f }, kBelieved{ 0.85f, 0.55f, 0.05f, 0.95f }, kRoute{ 0.12f, 0.42f, 0.80f, 0.55f },
    kText{ 0.15f, 0.15f, 0.18f };

constexpr double kMetresPerNewton = 0.04;
constexpr double kShown = 0.5;           // [N] smaller forces are not drawn
constexpr double kAbove = 0.12;          // [m] of arrows over the object
constexpr double kChiSquared95 = 5.991;  // 2 degrees of freedom
constexpr int kEllipsePoints = 36, kEllipseEvery = 5, kMostEllipses = 32;
constexpr double kTextHeight = 0.13;  // [m]
constexpr double kStride = 1.1;       // [m] of the figure's two steps

// the figure [m]: heights, half widths, and how far it stands from what it holds
constexpr double kHip = 0.92, kShoulder = 1.42, kHead = 1.63, kHipWidth = 0.1, kShoulderWidth = 0.21, kReach = 0.42;

std::string format(const char* pattern, double a, double b = 0.0)
{
  char text[96];
  std::snprintf(text, sizeof(text), pattern, a, b);
  return text;
}

Vector3d onFloor(const Vector2d& x, double z)
{
  return { x(0), x(1), z };
}

/// Stands beyond the far grasp, looks at the object, holds it with both hands. Which way it faces means nothing.
void addPerson(const StageSample& sample, MarkerShapes& shapes)
{
  const Vector3d hands = sample.far.translation();
  Vector3d away = sample.far.linear().col(0);
  away.z() = 0.0;
  away.normalize();
  const Vector3d left(-away.y(), away.x(), 0.0), up(0.0, 0.0, 1.0);
  const Vector3d feet = onFloor((hands + kReach * away).head<2>(), 0.0);
  const double swing = 0.5 * 0.5 * kStride * std::sin(2.0 * M_PI * sample.way / kStride) * 0.6;
  const std::string name = "simulated person";
  for (const double side : { -1.0, 1.0 })
  {
    const Vector3d hip = feet + kHip * up + side * kHipWidth * left;
    const Vector3d foot = feet + 0.07 * up + side * kHipWidth * left + side * swing * away;
    const Vector3d knee = 0.5 * (hip + foot) - 0.04 * away;
    shapes.rod(name, kTrousers, hip, knee, 0.075);
    shapes.sphere(name, kTrousers, knee, Vector3d::Constant(0.145));
    shapes.rod(name, kTrousers, knee, foot, 0.06);
    shapes.sphere(name, kShoe, foot - 0.03 * up - 0.04 * away, { 0.2, 0.2, 0.1 });
    const Vector3d shoulder = feet + kShoulder * up + side * kShoulderWidth * left - 0.02 * away;
    const Vector3d hand = hands + 0.05 * side * left;
    const Vector3d elbow = 0.55 * shoulder + 0.45 * hand + 0.08 * side * left - 0.12 * up;
    shapes.sphere(name, kHuman, shoulder, Vector3d::Constant(0.14));
    shapes.rod(name, kHuman, shoulder, elbow, 0.05);
    shapes.sphere(name, kHuman, elbow, Vector3d::Constant(0.095));
    shapes.rod(name, kSkin, elbow, hand, 0.04);
    shapes.sphere(name, kSkin, hand, Vector3d::Constant(0.1));
  }
  shapes.sphere(name, kTrousers, feet + (kHip + 0.02) * up, { 0.3, 0.3, 0.24 });
  const double yaw = std::atan2(away.y(), away.x());
  shapes.box(name, kHuman, upright(feet + 0.5 * (kHip + kShoulder + 0.08) * up, yaw), { 0.21, 0.36, kShoulder - kHip });
  shapes.rod(name, kSkin, feet + kShoulder * up, feet + (kHead - 0.08) * up, 0.05);
  shapes.sphere(name, kSkin, feet + kHead * up, { 0.19, 0.19, 0.24 });
  shapes.sphere(name, kHair, feet + (kHead + 0.03) * up + 0.02 * away, { 0.205, 0.205, 0.21 });
  shapes.text(name, kText, feet + 1.92 * up, kTextHeight, name);
}

/// `beside`: where its label is.
void addForce(const std::string& name, const Color& color, const Vector3d& at, const Vector3d& force,
              const Vector3d& beside, MarkerShapes& shapes)
{
  if (force.norm() >= kShown)
  {
    const Vector3d from = at + Vector3d(0.0, 0.0, kAbove);
    shapes.arrow(name, color, from, from + kMetresPerNewton * force, 0.03);
    shapes.text(name, color, beside, kTextHeight, name + format(" %.0f N", force.norm()));
  }
  shapes.removeRest(name, 2);
}

void addPrediction(const phri_core::Prediction& prediction, const CarryingPicture& picture, double height,
                   MarkerShapes& shapes)
{
  const double length = picture.lab->grasp_distance;
  for (std::size_t k = 0; k < prediction.desired_state.size(); k += kEllipseEvery)
  {
    const phri_core::Gaussian& belief = prediction.desired_state[k];
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(belief.covariance.topLeftCorner<2, 2>().eval());
    const Vector2d radii = (kChiSquared95 * solver.eigenvalues()).cwiseMax(0.0).cwiseSqrt();
    std::vector<Vector3d> rim;
    for (int i = 0; i <= kEllipsePoints; ++i)
    {
      const double angle = 2.0 * M_PI * i / kEllipsePoints;
      const Vector2d on_circle(radii(0) * std::cos(angle), radii(1) * std::sin(angle));
      rim.push_back(onFloor(belief.mean.head<2>() + solver.eigenvectors() * on_circle, height));
    }
    shapes.line("prediction", kPrediction, rim, 0.012);
    const double yaw = belief.mean(2);
    const Vector2d end = belief.mean.head<2>() + length * Vector2d(std::cos(yaw), std::sin(yaw));
    shapes.line("prediction", { kPrediction.r, kPrediction.g, kPrediction.b, 0.45f },
                { onFloor(belief.mean.head<2>(), height), onFloor(end, height) }, 0.02);
  }
}

void addPaths(const CarryingPicture& picture, const StageSample& sample, MarkerShapes& shapes)
{
  const auto points = [](const std::deque<Vector2d>& path, double z) {
    std::vector<Vector3d> out;
    for (const Vector2d& x : path)
      out.push_back(onFloor(x, z));
    return out;
  };
  shapes.line("path, real", kReal, points(picture.real, 0.012), 0.03);
  shapes.line("path, by odometry", kBelieved, points(picture.believed, 0.016), 0.02);
  if (picture.route)
  {
    const WalkingPath path = picture.lab->path(*picture.route);
    std::vector<Vector3d> way;
    for (double s = 0.0; s <= path.length(); s += 0.05)
      way.push_back(onFloor(path.at(s).position, 0.002));
    shapes.line("route", kRoute, way, 0.02);
  }
  const Vector3d real = sample.tip.translation(), believed = odomInWorld(sample).inverse() * real;
  const Vector2d drift = (believed - real).head<2>();
  shapes.line("drift", kBelieved, { onFloor(real.head<2>(), 0.02), onFloor(believed.head<2>(), 0.02) }, 0.02);
  std::vector<Vector3d> ring;
  for (int i = 0; i <= kEllipsePoints; ++i)
  {
    const double angle = 2.0 * M_PI * i / kEllipsePoints;
    ring.push_back(onFloor(believed.head<2>() + 0.06 * Vector2d(std::cos(angle), std::sin(angle)), 0.02));
  }
  shapes.line("drift", kBelieved, ring, 0.015);
  shapes.text("drift", kBelieved, onFloor(believed.head<2>() + Vector2d(0.3, -0.4), 0.02), kTextHeight,
              "odometry " + format("%.0f cm off", 100.0 * drift.norm()));
}
}  // namespace

visualization_msgs::MarkerArray carryingMarkers(const CarryingPicture& picture, const Moment& moment,
                                                const phri_core::Prediction* prediction, const std::string& controller)
{
  const StageSample& sample = moment.sample;
  visualization_msgs::MarkerArray out;
  MarkerShapes world("world", moment.stamp);
  addPerson(sample, world);
  addPaths(picture, sample, world);
  const Vector3d tip = sample.tip.translation(), far = sample.far.translation();
  addForce("person", kHuman, far, onFloor(sample.person.head<2>(), 0.0),
           far + 0.25 * (tip - far) + onFloor({ 0, 0 }, 0.35), world);
  for (int i = 0; i < sample.contacts; ++i)
  {
    const StageSample::ContactPoint& contact = sample.contact[std::size_t(i)];
    world.sphere("contacts", kContact, contact.point, Vector3d::Constant(0.06));
    world.arrow("contacts", kContact, contact.point, contact.point + kMetresPerNewton * contact.force, 0.02);
  }
  world.removeRest("contacts", 2 * StageSample::kMaxContacts);
  const Lab& lab = *picture.lab;
  world.text("title", kText, { 0.5 * lab.size(0), -0.5, 0.0 }, 0.28,
             picture.title + "     " + controller + "     " + format("%.1f s", moment.record.time_ns * 1e-9) + "     " +
                 phri_core::stateName(moment.record.state));
  world.moveInto(out);

  MarkerShapes grasp("grasp", moment.stamp);
  const auto force = [](const phri_core::VectorDof& wrench) { return Vector3d(wrench(0), wrench(1), 0.0); };
  addForce("sensed", kSensed, { 0, 0, 0.05 }, force(moment.record.human_wrench), { 0, 0, 0.4 }, grasp);
  addForce("assistance", kAssistance, { 0, 0, 0.15 }, force(moment.record.assistance_wrench), { 0, 0, 0.58 }, grasp);
  grasp.moveInto(out);

  MarkerShapes odom("odom", moment.stamp);
  if (prediction)
    addPrediction(*prediction, picture, sample.tip.translation().z() + 0.08, odom);
  odom.removeRest("prediction", kMostEllipses);
  odom.moveInto(out);
  return out;
}
}  // namespace phri_sim
