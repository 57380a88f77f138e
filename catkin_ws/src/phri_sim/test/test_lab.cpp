#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "phri_core/parameters.hpp"
#include "phri_sim/configuration.hpp"
#include "phri_sim/lab.hpp"
#include "pictures.hpp"

using namespace phri_sim;
using Eigen::Vector2d;

namespace
{
constexpr double kBase = 0.46;    // [m] radius of a disc around a base of 0.7 x 0.6 m
constexpr double kBehind = 0.7;   // [m] of the base's middle behind the robot's grasp
constexpr double kPerson = 0.25;  // [m] radius of a person
constexpr double kAhead = 0.35;   // [m] of the person before the far grasp

std::string refusal(const std::string& text)
{
  try
  {
    loadLab(pictures::temporary("lab.yaml", text));
  }
  catch (const phri_core::ParameterError& error)
  {
    return error.what();
  }
  return "";
}

const std::string kRoom =
    "start: {position: [1, 1], yaw: 0}\n"
    "goal: {position: [4.45, 1], axis: 0}\n";
const std::string kRoute = "routes:\n  straight: {x: [1, 5], y: [1, 1], passes: [nothing]}\n";
}  // namespace

TEST(LabBox, DistanceIsThatToItsOutline)
{
  const LabBox box{ "box", { 1, 2 }, { 2, 1 }, M_PI / 6.0, 1.0 };
  // against the nearest of many points on the outline, from outside and inside
  const Vector2d along(std::cos(M_PI / 6.0), std::sin(M_PI / 6.0)), aside(-along(1), along(0));
  for (double x = -2.0; x < 4.0; x += 0.31)
    for (double y = -1.0; y < 5.0; y += 0.37)
    {
      double nearest = 1e9;
      for (double u = -1.0; u <= 1.0; u += 0.0005)
        for (const Vector2d& p :
             { Vector2d(u, 0.5), Vector2d(u, -0.5), Vector2d(1.0, 0.5 * u), Vector2d(-1.0, 0.5 * u) })
          nearest = std::min(nearest, (box.center + p(0) * along + p(1) * aside - Vector2d(x, y)).norm());
      const Vector2d d = Vector2d(x, y) - box.center;
      const bool inside = std::abs(d.dot(along)) < 1.0 && std::abs(d.dot(aside)) < 0.5;
      EXPECT_NEAR(box.distance({ x, y }), inside ? -nearest : nearest, 1e-3);  // spacing of the points
    }
}

// The thesis' three semantically different ways, and room for all three bodies on each: person, bumper, robot.
TEST(Lab, RoutesHaveRoomForPersonBumperAndRobot)
{
  const Lab lab = loadLab("lab");
  ASSERT_EQ(lab.routes.size(), 3u);
  ASSERT_EQ(lab.boxes.size(), 3u);
  for (const LabRoute& route : lab.routes)
  {
    const WalkingPath path = lab.path(route);
    const AlongPath yaw = trailingYaw(path, lab.grasp_distance, lab.start_yaw);
    EXPECT_EQ(route.passes.front(), "before the trolley");
    for (double s = 0.0; s <= path.length(); s += 0.02)
    {
      const PathPoint far = path.at(s);
      const Vector2d axis(std::cos(yaw.at(s)), std::sin(yaw.at(s)));
      const Vector2d person = far.position + kAhead * Vector2d(std::cos(far.heading), std::sin(far.heading));
      EXPECT_GT(lab.clearance(person), kPerson) << route.name << " at " << s;
      EXPECT_GT(lab.clearance(far.position - (lab.grasp_distance + kBehind) * axis), kBase)
          << route.name << " at " << s;
      for (double k = -1.15; k <= 0.05; k += 0.05)
        EXPECT_GT(lab.clearance(far.position + k * axis), 0.1) << route.name << " at " << s;
    }
    EXPECT_LT(std::abs(std::sin(yaw.values.back() - lab.goal_axis)), 0.12) << "across the car's front";
  }
}

// Different sides of trolley and car, not different wiggles: the turning of the path around each box's centre tells.
TEST(Lab, RoutesDifferInWhatTheyPass)
{
  const Lab lab = loadLab("lab");
  std::vector<std::pair<bool, bool>> sides;
  for (const LabRoute& route : lab.routes)
  {
    const WalkingPath path = lab.path(route);
    const auto turning = [&](const LabBox& box) {
      double sum = 0.0;
      for (double s = 0.01; s <= path.length(); s += 0.01)
      {
        const Vector2d a = path.at(s - 0.01).position - box.center, b = path.at(s).position - box.center;
        sum += std::atan2(a(0) * b(1) - a(1) * b(0), a.dot(b));
      }
      return sum > 0.0;
    };
    const auto named = [&](const std::string& name) {
      for (const LabBox& box : lab.boxes)
        if (box.name == name)
          return turning(box);
      throw std::runtime_error("no " + name);
    };
    sides.emplace_back(named("trolley"), named("car"));
  }
  EXPECT_NE(sides[0], sides[1]);
  EXPECT_NE(sides[1], sides[2]);
  EXPECT_NE(sides[0], sides[2]);
}

TEST(Lab, ReadsAMinimalFile)
{
  const Lab lab = loadLab(pictures::temporary("lab.yaml", kRoom + kRoute));
  EXPECT_EQ(lab.name, "lab");
  EXPECT_EQ(lab.route("straight").waypoints.back(), Vector2d(5, 1));
  EXPECT_NEAR(lab.clearance({ 5, 0.3 }), 0.3, 1e-12) << "the room's edge";
  EXPECT_THROW(lab.route("bent"), std::invalid_argument);
}

TEST(Lab, NamesAllThatIsWrong)
{
  const std::string keys =
      refusal(kRoom + kRoute + "turning_radius: -1\nobstacles:\n  car: {centre: [1, 1], height: x}\n");
  for (const char* expected :
       { "turning_radius", "obstacles/car/centre", "obstacles/car/center", "obstacles/car/height" })
    EXPECT_NE(keys.find(expected), std::string::npos) << keys;

  const std::string missing = refusal("routes:\n  a: {x: [1, 2], y: [1]}\nobstacles:\n  car: {center: [1, 1]}\n");
  for (const char* expected : { "start/position: missing", "goal/position: missing", "routes/a: x has 2 elements, y 1",
                                "obstacles/car: size is missing" })
    EXPECT_NE(missing.find(expected), std::string::npos) << missing;
  EXPECT_NE(refusal(kRoom).find("routes: there is none"), std::string::npos);
}

TEST(Lab, RefusesRoutesThatDoNotFit)
{
  const std::string wrong = refusal(kRoom +
                                    "routes:\n"
                                    "  begins: {x: [2, 5], y: [1, 1]}\n"
                                    "  ends: {x: [1, 6], y: [1, 1]}\n"
                                    "  across: {x: [1, 3, 5, 5], y: [1, 4, 4, 1]}\n"
                                    "  narrow: {x: [1, 1.1, 3, 5], y: [1, 1.5, 1, 1]}\n"
                                    "  fits: {x: [1, 5], y: [1, 1]}\n");
  for (const char* expected : { "4 errors", "routes/begins: begins at [2 1] m: expected start/position [1 1]",
                                "routes/ends: ends at [6 1] m: expected [5 1]", "routes/across: its last leg heads for",
                                "routes/narrow: walking path: the leg from waypoint 0 to 1" })
    EXPECT_NE(wrong.find(expected), std::string::npos) << wrong;
  EXPECT_EQ(wrong.find("routes/fits"), std::string::npos) << wrong;
  const std::string through = refusal(kRoom + kRoute + "obstacles:\n  box: {center: [3, 1.5], size: [1, 0.7]}\n");
  EXPECT_NE(through.find("0.15 m from an obstacle"), std::string::npos) << through;
}
