// The whiteboard: only pressure while moving wipes, and only under the eraser.
#include "phri_sim/whiteboard.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "mechanisms.hpp"

namespace
{
using namespace phri_sim;
using namespace phri_sim::testing;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kStep = 1e-3;

/// An upright board whose surface looks along -x, and an eraser 100 mm x 50 mm (y, z) led along it by a servo.
struct Lesson
{
  WhiteboardParameters parameters;
  World world;
  Whiteboard board;
  VectorXd tau = VectorXd::Zero(6);

  static WhiteboardParameters upright()
  {
    WhiteboardParameters p;
    p.pose.translation() = Vector3d(0.5, 0.1, 1.0);
    p.pose.linear().col(0) = Vector3d(0, -1, 0);  // the reader's right
    p.pose.linear().col(1) = Vector3d(0, 0, 1);
    p.pose.linear().col(2) = Vector3d(-1, 0, 0);
    return p;
  }
  static WorldOptions weightless()
  {
    WorldOptions o;
    o.tree.gravity.setZero();
    o.material = half(2e4, 1.0, 0.6);
    return o;
  }

  Lesson()
    : parameters(upright()),
      world({ { cart("eraser", 0.5, box(0.03, 0.1, 0.05), 0.0, true), "",
                Eigen::Isometry3d(Eigen::Translation3d(0.5 - 0.015, 0.1, 1.0)) } },
            { Whiteboard::shape(parameters, "board", half(2e4, 1.0, 0.6)) }, weightless()),
      board(world, parameters, "eraser", "board")
  {
    for (int i = 1; i < 6; ++i)
      world.dynamics().drives()[std::size_t(i)] = { 1e4, 200.0, 0.0, 0.0 };
  }

  /// From the board's middle along y [m], at a speed [m/s], pressed with a force [N].
  void wipe(double from, double to, double speed, double force)
  {
    VectorXd q = VectorXd::Zero(6), qd = VectorXd::Zero(6);
    q(1) = from;
    world.setState(q, qd);
    const int steps = int(std::abs(to - from) / speed / kStep);
    for (int i = 0; i < steps; ++i)
    {
      world.dynamics().drives()[1].position = from + (to - from) * i / steps;
      world.dynamics().drives()[1].velocity = to > from ? speed : -speed;
      tau(0) = force;
      world.step(kStep, tau);
      board.update(world);
    }
  }
};

TEST(Whiteboard, WipesTheStripUnderTheEraserAndNoMore)
{
  Lesson lesson;
  lesson.wipe(-0.3, 0.3, 0.1, 10.0);
  EXPECT_NEAR(lesson.board.force(), 10.0, 0.1);
  // text 300 mm x 100 mm, strip 50 mm high over its whole length: half of it, to half a cell on either edge
  EXPECT_NEAR(lesson.board.share(), 0.5, 0.051);
  const int columns = lesson.board.columns(), rows = lesson.board.rows();
  ASSERT_EQ(columns, 60);
  ASSERT_EQ(rows, 20);
  int wiped = 0;
  for (int row = 0; row < rows; ++row)
  {
    for (int column = 0; column < columns; ++column)
    {
      const Vector3d cell = lesson.board.gridPose() * Vector3d((column + 0.5) * 5e-3, (row + 0.5) * 5e-3, 0.0);
      const bool clean = lesson.board.dirt()[std::size_t(row * columns + column)] == 0;
      wiped += clean;
      if (std::abs(std::abs(cell.z() - 1.0) - 0.025) > 3e-3)
      {
        EXPECT_EQ(clean, std::abs(cell.z() - 1.0) < 0.025) << row << " " << column;
      }
      EXPECT_NEAR(cell.x(), 0.5, 1e-12) << "on the surface";
    }
  }
  EXPECT_DOUBLE_EQ(lesson.board.share(), double(wiped) / (columns * rows));
  lesson.board.reset();
  EXPECT_EQ(lesson.board.share(), 0.0);
}

TEST(Whiteboard, PressureDecides)
{
  // 1000 Pa on 100 mm x 50 mm are 5 N; friction at the surface tilts the eraser a little, which the margin covers
  Lesson light;
  light.wipe(-0.3, 0.3, 0.1, 2.5);
  EXPECT_LT(light.board.share(), 0.02);
  Lesson firm;
  firm.wipe(-0.3, 0.3, 0.1, 8.0);
  EXPECT_GT(firm.board.share(), 0.4);
}

TEST(Whiteboard, StandingStillWipesNothing)
{
  Lesson lesson;
  lesson.wipe(0.0, 0.001, 0.001, 20.0);  // one second, pressed hard, at 1 mm/s
  EXPECT_NEAR(lesson.board.force(), 20.0, 0.1);
  EXPECT_EQ(lesson.board.share(), 0.0);
  EXPECT_FALSE(lesson.board.wiping());
}

TEST(Whiteboard, PartOfTheWayIsPartOfTheShare)
{
  Lesson lesson;
  lesson.wipe(-0.3, 0.0, 0.1, 10.0);  // the eraser's leading edge comes 50 mm beyond the middle: 200 of 300 mm
  EXPECT_NEAR(lesson.board.share(), 0.5 * 200.0 / 300.0, 0.04);
}

TEST(Whiteboard, RefusesWhatCannotBe)
{
  Lesson lesson;
  WhiteboardParameters p = lesson.parameters;
  p.text_centre = { 0.55, 0 };
  p.pressure = 0.0;
  try
  {
    Whiteboard board(lesson.world, p, "eraser", "board");
    FAIL() << "accepted";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_NE(std::string(error.what()).find("text area"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("pressure"), std::string::npos);
  }
  EXPECT_THROW(Whiteboard(lesson.world, lesson.parameters, "eraser_root", "board"), std::invalid_argument);
  EXPECT_THROW(Whiteboard(lesson.world, lesson.parameters, "eraser", "wall"), std::out_of_range);
}
}  // namespace
