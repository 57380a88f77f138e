#pragma once
#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "phri_sim/image.hpp"

namespace phri_sim
{
/// Signed distance field of a monochrome picture: metres to the nearest wall, negative inside. Exact Euclidean distance
/// transform of the pixels (Felzenszwalb and Huttenlocher 2012), bilinear in between. Outside the picture is wall.
class DistanceField
{
public:
  /// A pixel is wall where its darkness (255 - value) / 255 exceeds `occupied`; `resolution` [m/pixel]; `origin` is the
  /// position of the lower left corner [m].
  DistanceField(const GrayImage& image, double resolution, const Eigen::Vector2d& origin, double occupied);
  double distance(const Eigen::Vector2d& x) const noexcept;
  /// Unit vector away from the nearest wall; zero where the field is flat.
  Eigen::Vector2d gradient(const Eigen::Vector2d& x) const noexcept;

  /// [m] at the centre of a pixel; row 0 is at the bottom; the field has one pixel of wall around the picture.
  double cell(int column, int row) const noexcept;
  double resolution() const { return resolution_; }
  int width() const { return width_; }
  int height() const { return height_; }
  const Eigen::Vector2d& origin() const { return origin_; }

private:
  int width_, height_;
  double resolution_;
  Eigen::Vector2d origin_;
  std::vector<float> distance_;  // [m], row 0 at the bottom
};

/// A box that moves sinusoidally along x: centre + amplitude sin(2 pi t / period + phase).
struct MovingObstacle
{
  Eigen::Vector2d center{ 0, 0 }, half_size{ 0.02, 0.01 };  ///< [m]
  double amplitude = 0.05;                                  ///< [m]
  double period = 4.0;                                      ///< [s]
  double phase = 0.0;                                       ///< [rad]

  Eigen::Vector2d position(double t) const;
  Eigen::Vector2d velocity(double t) const;
  /// [m] from its surface at time t, negative inside; `normal` points away from it.
  double distance(const Eigen::Vector2d& x, double t, Eigen::Vector2d* normal = nullptr) const;
};

/// What the object can touch: the walls of a picture and moving boxes, rendered as stiff, damped, frictionless
/// surfaces.
struct Scene
{
  std::string name, image_path;
  GrayImage image;
  DistanceField walls;
  double occupied = 0.65;                       ///< darkness above which a pixel is wall
  Eigen::Vector2d start{ 0, 0 }, goal{ 0, 0 };  ///< [m]
  double goal_radius = 0.006;                   ///< [m]
  double object_radius = 0.003;                 ///< [m]
  double turning_x = NAN;                      ///< [m] left of it the subtask "narrow channel" begins; NaN: it has none
  double stiffness = 2e4;                      ///< [N/m]
  double damping = 1500.0;                     ///< [Ns/m], while approaching only
  std::vector<Eigen::Vector2d> path{};         ///< [m] points of a line to follow; empty: any way to the goal will do
  std::vector<MovingObstacle> obstacles{};     ///< periods and phases are drawn per trial
  double period_low = 3.0, period_high = 5.0;  ///< [s]

  /// [m] between the object's rim and the nearest wall (moving boxes not counted).
  double clearance(const Eigen::Vector2d& x) const noexcept { return walls.distance(x) - object_radius; }
};

/// Loads a scene (docs/scenes.md): `config/scenes/<name>.yaml` or a path to one, with the keys of a ROS map file
/// (image, resolution, origin, occupied_thresh, negate) and ours, among them a path to follow, which needs no picture;
/// or a picture alone (.png .jpg .jpeg .pgm .svg, a path or a file in config/scenes), whose longer side becomes 0.3 m
/// around the origin. Start and goal that no yaml gives are the centres of the green and the red dot. Throws
/// phri_core::ParameterError listing every wrong key, or PictureError for the picture: unreadable, no dots, start or
/// goal in a wall, no way between them that the object fits through.
Scene loadScene(const std::string& name_or_path);

/// Width [m] of the narrowest place of the widest way between two points, to half a pixel; negative when walls separate
/// them. `fits` is exact: whether an object of that radius [m] gets through, its centre moving from pixel to pixel.
struct Passage
{
  double width = -1.0;
  bool fits = false;
};
Passage widestPassage(const DistanceField& walls, const Eigen::Vector2d& from, const Eigen::Vector2d& to,
                      double radius);

/// Force [N] of walls and `obstacles` at time t ON an object at x [m] moving with v [m/s]:
/// max(0, k penetration - b normal velocity) along the normal; surfaces push, they never pull.
Eigen::Vector2d contactForce(const Scene& scene, const std::vector<MovingObstacle>& obstacles, const Eigen::Vector2d& x,
                             const Eigen::Vector2d& v, double t) noexcept;

/// Periods and phases of the scene's obstacles for one trial, from the trial's seed alone: identical across
/// controllers.
std::vector<MovingObstacle> obstaclesOfTrial(const Scene& scene, std::uint64_t trial_seed);
}  // namespace phri_sim
