#pragma once
/// Markers in space, made shape by shape. Lengths in metres, in the frame given at the construction.

#include <visualization_msgs/MarkerArray.h>

#include <Eigen/Geometry>
#include <map>
#include <string>

namespace phri_sim
{
struct Color
{
  float r, g, b, a = 1.0f;
};

/// Collects markers of one frame and stamp; numbers them within their names.
class MarkerShapes
{
public:
  MarkerShapes(std::string frame, const ros::Time& stamp) : frame_(std::move(frame)), stamp_(stamp) {}
  using Vector = Eigen::Vector3d;

  void box(const std::string& name, const Color& color, const Eigen::Isometry3d& pose, const Vector& size);
  void sphere(const std::string& name, const Color& color, const Vector& at, const Vector& diameters);
  /// From `a` to `b`.
  void rod(const std::string& name, const Color& color, const Vector& a, const Vector& b, double radius);
  void arrow(const std::string& name, const Color& color, const Vector& from, const Vector& to, double width);
  void line(const std::string& name, const Color& color, const std::vector<Vector>& points, double width);
  void text(const std::string& name, const Color& color, const Vector& at, double height, const std::string& words);

  /// A last marker that takes away everything of this name with a higher number than now is used, up to `most`.
  void removeRest(const std::string& name, int most);
  /// Moves what was made into `out`.
  void moveInto(visualization_msgs::MarkerArray& out);

private:
  visualization_msgs::Marker& add(const std::string& name, int type, const Color& color);

  std::string frame_;
  ros::Time stamp_;
  std::map<std::string, int> used_;
  visualization_msgs::MarkerArray made_;
};

/// Turned by `yaw` [rad] about the vertical.
Eigen::Isometry3d upright(const Eigen::Vector3d& at, double yaw);
}  // namespace phri_sim
