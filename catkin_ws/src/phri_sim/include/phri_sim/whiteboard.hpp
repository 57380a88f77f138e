#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "phri_sim/world.hpp"

namespace phri_sim
{
struct WhiteboardParameters
{
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< of the surface's centre in the world; z out of the board
  Eigen::Vector2d size{ 1.2, 0.9 };                        ///< along the surface's x and y [m]
  double thickness = 0.02;                                 ///< of the box behind the surface [m]
  double cell = 5e-3;                                      ///< edge of a cell of dirt [m]
  Eigen::Vector2d text_centre{ 0, 0 };                     ///< in the surface's frame [m]
  Eigen::Vector2d text_size{ 0.3, 0.1 };                   ///< [m]
  double pressure = 1000.0;                                ///< that wipes [Pa]: 5 N on an eraser of 100 mm x 50 mm
  double speed = 5e-3;                                     ///< along the surface, below which nothing is wiped [m/s]
};

/// A whiteboard with text on it, and what an eraser has done to the text. The eraser is a link with a box whose face
/// lies on the board. The pressure under that face is the linear distribution with the force and the centre of pressure
/// of the contact points; where it exceeds the threshold while the eraser moves along the board, cells become clean.
class Whiteboard
{
public:
  /// The box to put into the world's static shapes under `name`.
  static StaticShape shape(const WhiteboardParameters& parameters, const std::string& name = "whiteboard",
                           const Material& material = {});

  /// `eraser` is a link with exactly one box. Throws std::invalid_argument on that, on a text area that is not on the
  /// board, and on parameters out of range; std::out_of_range for unknown names.
  Whiteboard(const World& world, const WhiteboardParameters& parameters, const std::string& eraser,
             const std::string& name = "whiteboard");

  /// After each step of the world.
  void update(const World& world) noexcept;
  void reset() noexcept;  ///< all text back on the board

  double share() const;                    ///< of the text area wiped [-]
  double force() const { return force_; }  ///< normal, of the eraser on the board, last step [N]
  bool wiping() const { return wiping_; }  ///< last step
  const WhiteboardParameters& parameters() const { return parameters_; }

  // ---- the text area as a nav_msgs/OccupancyGrid has it: row by row along x, from the corner of least x and y
  int columns() const { return columns_; }
  int rows() const { return rows_; }
  const std::vector<std::int8_t>& dirt() const { return dirt_; }  ///< 100: text, 0: wiped
  Eigen::Isometry3d gridPose() const;                             ///< of that corner in the world

private:
  WhiteboardParameters parameters_;
  int static_, link_;
  Eigen::Vector3d eraser_size_;
  Eigen::Isometry3d eraser_origin_;
  int columns_, rows_, wiped_ = 0;
  std::vector<std::int8_t> dirt_;
  double force_ = 0.0;
  bool wiping_ = false;
};
}  // namespace phri_sim
