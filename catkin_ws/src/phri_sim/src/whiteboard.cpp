#include "phri_sim/whiteboard.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace phri_sim
{
namespace
{
using Eigen::Vector2d;
using Eigen::Vector3d;

/// Face of the eraser on the board, in the board's surface frame, and the force that presses on it.
struct Footprint
{
  Vector2d centre, x, y;    // middle of the face; unit vectors along its edges (shadows, as it lies almost flat)
  Vector2d half;            // half edges [m]
  double force = 0.0;       // [N]
  Vector2d offset{ 0, 0 };  // centre of pressure from the middle, along x, y [m]

  /// Of a linear distribution with that force and centre [Pa]; 0 outside and where it would pull.
  double pressure(const Vector2d& point) const
  {
    const Vector2d d = point - centre;
    const Vector2d local(d.dot(x), d.dot(y));
    if ((local.cwiseAbs().array() > half.array()).any())
      return 0.0;
    const double tilt = 3.0 * (local.array() * offset.array() / half.array().square()).sum();
    return std::max(0.0, force / (4.0 * half.prod()) * (1.0 + tilt));
  }
};

void check(const WhiteboardParameters& p)
{
  std::string errors;
  const auto require = [&](bool good, const std::string& what) {
    if (!good)
      errors += "\n  " + what;
  };
  require(p.pose.matrix().allFinite(), "the pose is not finite");
  require(p.size.minCoeff() > 0.0 && p.thickness > 0.0, "size and thickness must be positive [m]");
  require(p.text_size.minCoeff() > 0.0 &&
              ((p.text_centre.cwiseAbs() + 0.5 * p.text_size).array() <= 0.5 * p.size.array()).all(),
          "the text area must lie on the board");
  require(p.cell >= 1e-3 && p.cell <= p.text_size.minCoeff(),
          "cell " + std::to_string(p.cell) + " m; expected 0.001 to the shorter edge of the text area");
  require(p.pressure > 0.0, "pressure " + std::to_string(p.pressure) + " Pa; expected above 0");
  require(p.speed >= 0.0, "speed " + std::to_string(p.speed) + " m/s; expected at least 0");
  if (!errors.empty())
    throw std::invalid_argument("whiteboard:" + errors);
}
}  // namespace

StaticShape Whiteboard::shape(const WhiteboardParameters& p, const std::string& name, const Material& material)
{
  ShapeDescription box;
  box.kind = ShapeKind::Box;
  box.size = { p.size.x(), p.size.y(), p.thickness };
  box.origin = p.pose * Eigen::Translation3d(0.0, 0.0, -0.5 * p.thickness);
  return { name, box, material };
}

Whiteboard::Whiteboard(const World& world, const WhiteboardParameters& parameters, const std::string& eraser,
                       const std::string& name)
  : parameters_(parameters), static_(world.staticShape(name)), link_(world.model().link(eraser))
{
  check(parameters);
  const std::vector<ShapeDescription>& shapes = world.model().links()[std::size_t(link_)].collision;
  if (shapes.size() != 1 || shapes[0].kind != ShapeKind::Box)
    throw std::invalid_argument("whiteboard: the eraser '" + eraser + "' must have exactly one shape, a box");
  eraser_size_ = shapes[0].size;
  eraser_origin_ = shapes[0].origin;
  columns_ = int(std::lround(parameters.text_size.x() / parameters.cell));
  rows_ = int(std::lround(parameters.text_size.y() / parameters.cell));
  reset();
}

void Whiteboard::reset() noexcept
{
  dirt_.assign(std::size_t(columns_) * std::size_t(rows_), 100);
  wiped_ = 0;
  force_ = 0.0;
  wiping_ = false;
}

double Whiteboard::share() const
{
  return double(wiped_) / double(dirt_.size());
}

Eigen::Isometry3d Whiteboard::gridPose() const
{
  const Vector2d corner = parameters_.text_centre - 0.5 * parameters_.text_size;
  return parameters_.pose * Eigen::Translation3d(corner.x(), corner.y(), 0.0);
}

void Whiteboard::update(const World& world) noexcept
{
  const Eigen::Isometry3d to_board = parameters_.pose.inverse();
  Footprint print;
  Vector2d moment(0, 0);
  for (const Contact& contact : world.contacts())
  {
    const bool first = contact.link_a == link_ && contact.static_b == static_;
    if (!first && !(contact.link_b == link_ && contact.static_a == static_))
      continue;
    const double force = contact.normalForce();
    print.force += force;
    moment += force * (to_board * contact.point).head<2>();
  }
  force_ = print.force;
  wiping_ = false;
  if (!(force_ > 0.0))
    return;

  // the face of the box that looks into the board most
  const Eigen::Isometry3d box = to_board * world.linkPose(link_) * eraser_origin_;
  int normal = 0;
  box.linear().row(2).cwiseAbs().maxCoeff(&normal);
  const int u = (normal + 1) % 3, v = (normal + 2) % 3;
  const double into = box.linear()(2, normal) > 0.0 ? -1.0 : 1.0;
  const Vector3d face = box * Vector3d(0.5 * into * eraser_size_[normal] * Vector3d::Unit(normal));
  print.centre = face.head<2>();
  print.x = box.linear().col(u).head<2>().normalized();
  print.y = box.linear().col(v).head<2>().normalized();
  print.half = 0.5 * Vector2d(eraser_size_[u], eraser_size_[v]);
  const Vector2d middle = moment / force_ - print.centre;
  print.offset = { middle.dot(print.x), middle.dot(print.y) };

  const Vector3d speed = to_board.linear() * world.dynamics().pointVelocity(link_, parameters_.pose * face);
  if (!(speed.head<2>().norm() > parameters_.speed))
    return;
  const Vector2d corner = parameters_.text_centre - 0.5 * parameters_.text_size;
  const double reach = print.half.norm();
  const auto range = [&](int axis, int count) {
    const double from = (print.centre[axis] - reach - corner[axis]) / parameters_.cell;
    const double to = (print.centre[axis] + reach - corner[axis]) / parameters_.cell;
    return std::pair<int, int>(std::clamp(int(std::floor(from)), 0, count), std::clamp(int(std::ceil(to)), 0, count));
  };
  const auto [column_begin, column_end] = range(0, columns_);
  const auto [row_begin, row_end] = range(1, rows_);
  for (int row = row_begin; row < row_end; ++row)
  {
    for (int column = column_begin; column < column_end; ++column)
    {
      const Vector2d cell = corner + parameters_.cell * Vector2d(column + 0.5, row + 0.5);
      if (print.pressure(cell) < parameters_.pressure)
        continue;
      wiping_ = true;
      std::int8_t& dirt = dirt_[std::size_t(row) * std::size_t(columns_) + std::size_t(column)];
      wiped_ += dirt != 0;
      dirt = 0;
    }
  }
}
}  // namespace phri_sim
