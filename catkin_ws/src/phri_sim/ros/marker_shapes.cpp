#include "marker_shapes.hpp"

#include <algorithm>

namespace phri_sim
{
namespace
{
using visualization_msgs::Marker;

geometry_msgs::Point toMessage(const Eigen::Vector3d& x)
{
  geometry_msgs::Point point;
  point.x = x(0);
  point.y = x(1);
  point.z = x(2);
  return point;
}

void place(Marker& marker, const Eigen::Vector3d& at, const Eigen::Quaterniond& turn)
{
  marker.pose.position = toMessage(at);
  marker.pose.orientation.x = turn.x();
  marker.pose.orientation.y = turn.y();
  marker.pose.orientation.z = turn.z();
  marker.pose.orientation.w = turn.w();
}

void scale(Marker& marker, double x, double y, double z)
{
  marker.scale.x = x;
  marker.scale.y = y;
  marker.scale.z = z;
}
}  // namespace

Marker& MarkerShapes::add(const std::string& name, int type, const Color& color)
{
  Marker marker;
  marker.header.frame_id = frame_;
  marker.header.stamp = stamp_;
  marker.ns = name;
  marker.id = used_[name]++;
  marker.type = type;
  marker.pose.orientation.w = 1.0;
  marker.color.r = color.r;
  marker.color.g = color.g;
  marker.color.b = color.b;
  marker.color.a = color.a;
  made_.markers.push_back(marker);
  return made_.markers.back();
}

void MarkerShapes::box(const std::string& name, const Color& color, const Eigen::Isometry3d& pose, const Vector& size)
{
  Marker& marker = add(name, Marker::CUBE, color);
  place(marker, pose.translation(), Eigen::Quaterniond(pose.linear()));
  scale(marker, size(0), size(1), size(2));
}

void MarkerShapes::sphere(const std::string& name, const Color& color, const Vector& at, const Vector& diameters)
{
  Marker& marker = add(name, Marker::SPHERE, color);
  place(marker, at, Eigen::Quaterniond::Identity());
  scale(marker, diameters(0), diameters(1), diameters(2));
}

void MarkerShapes::rod(const std::string& name, const Color& color, const Vector& a, const Vector& b, double radius)
{
  Marker& marker = add(name, Marker::CYLINDER, color);
  place(marker, 0.5 * (a + b), Eigen::Quaterniond::FromTwoVectors(Vector::UnitZ(), b - a));
  scale(marker, 2.0 * radius, 2.0 * radius, (b - a).norm());
}

void MarkerShapes::arrow(const std::string& name, const Color& color, const Vector& from, const Vector& to,
                         double width)
{
  Marker& marker = add(name, Marker::ARROW, color);
  marker.points = { toMessage(from), toMessage(to) };
  scale(marker, width, 2.5 * width, std::min(4.0 * width, 0.6 * (to - from).norm()));
}

void MarkerShapes::line(const std::string& name, const Color& color, const std::vector<Vector>& points, double width)
{
  Marker& marker = add(name, Marker::LINE_STRIP, color);
  marker.scale.x = width;
  for (const Vector& x : points)
    marker.points.push_back(toMessage(x));
  if (points.size() < 2)
    marker.action = Marker::DELETE;
}

void MarkerShapes::text(const std::string& name, const Color& color, const Vector& at, double height,
                        const std::string& words)
{
  Marker& marker = add(name, Marker::TEXT_VIEW_FACING, color);
  marker.pose.position = toMessage(at);
  marker.scale.z = height;
  marker.text = words;
}

void MarkerShapes::removeRest(const std::string& name, int most)
{
  while (used_[name] < most)
    add(name, Marker::CUBE, { 0, 0, 0, 0 }).action = Marker::DELETE;
}

void MarkerShapes::moveInto(visualization_msgs::MarkerArray& out)
{
  out.markers.insert(out.markers.end(), std::make_move_iterator(made_.markers.begin()),
                     std::make_move_iterator(made_.markers.end()));
  made_.markers.clear();
  used_.clear();
}

Eigen::Isometry3d upright(const Eigen::Vector3d& at, double yaw)
{
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = at;
  pose.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return pose;
}
}  // namespace phri_sim
