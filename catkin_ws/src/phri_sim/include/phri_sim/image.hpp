#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace phri_sim
{
/// A picture that cannot be a scene: file, what was found and what was expected. Exit code 65 (bad data), whereas bad
/// keys of a configuration file are 78.
class PictureError : public std::invalid_argument
{
public:
  using std::invalid_argument::invalid_argument;
};

/// Smallest and largest side of a picture [pixel]; largest file that is opened [byte].
constexpr int kSmallestSide = 2, kLargestSide = 4096;
constexpr long kLargestFile = 64l << 20;

/// Monochrome picture in ROS map orientation: row 0 is the top (largest y).
struct GrayImage
{
  int width = 0, height = 0;         ///< [pixel]
  std::vector<std::uint8_t> pixels;  ///< row-major, 0 black to 255 white
};

/// How a vector drawing becomes pixels; pixel pictures ignore it.
struct Raster
{
  int width = 600;  ///< [pixel]
  int height = 0;   ///< [pixel]; 0: the longer side gets `width`, the other follows from the drawing
};

/// A green or red dot, which marks the start or the goal.
struct Dot
{
  bool found = false;
  Eigen::Vector2d center{ 0, 0 };     ///< [pixel] right of and below the picture's upper left corner
  double radius = 0.0;                ///< [pixel] of the disc of the same area
  std::vector<std::uint32_t> pixels;  ///< that belong to it, rim included: free space whatever their luma
  std::string fault;                  ///< why none was found
};

struct Picture
{
  GrayImage image;
  Dot green, red;
};

/// Reads a PNG, JPEG, PGM (P1 to P6) or SVG file, told apart by content. Luma is (299 R + 587 G + 114 B) / 1000,
/// rounded; transparent parts are white. The file is decoded by gdk-pixbuf in a process of its own, decode_picture,
/// that is limited to 200 MB and 1.5 s of processor time. Throws PictureError naming the file, what was found and the
/// limit; std::runtime_error when that process cannot be started.
Picture readPicture(const std::string& path, const Raster& raster = {});

/// Its luma alone.
GrayImage readImage(const std::string& path);

/// Finds the dot of one colour, `channel` 0 red, 1 green. A pixel is of that colour where the channel exceeds both
/// others by kDotContrast; the dot is the largest connected region of such pixels that has 4 or more and fills half of
/// its bounding square (a line does not). `contrast` holds, per pixel, by how much the channel exceeds the others (0
/// where it does not). A second region of more than half the size makes it ambiguous: not found.
constexpr int kDotContrast = 60;
Dot findDot(std::vector<std::uint8_t> contrast, int width, int height, const std::string& color,
            const std::string& meaning);
}  // namespace phri_sim
