#pragma once
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

/// Small pictures for tests.
namespace pictures
{
/// A folder that goes with the program.
class Folder
{
public:
  Folder() : path(std::filesystem::temp_directory_path() / ("phri_test_" + std::to_string(getpid())))
  {
    std::filesystem::create_directory(path);
  }
  ~Folder()
  {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  const std::filesystem::path path;
};

/// Path of a file with this content.
inline std::string temporary(const std::string& name, const std::string& content)
{
  static const Folder folder;
  const std::string path = (folder.path / name).string();
  std::ofstream(path, std::ios::binary) << content;
  return path;
}

/// What `action` throws, as text; empty when it throws no `Error`.
template <typename Error, typename Action>
std::string refusal(Action&& action)
{
  try
  {
    action();
  }
  catch (const Error& error)
  {
    return error.what();
  }
  return "";
}

/// A picture in colour, to be written as PPM.
struct Canvas
{
  using Color = std::uint32_t;  ///< 0xrrggbb
  static constexpr Color kWhite = 0xffffff, kBlack = 0, kGreen = 0x00c000, kRed = 0xdc0000;
  int width, height;
  std::vector<Color> pixels;

  Canvas(int w, int h, Color color = kWhite) : width(w), height(h), pixels(std::size_t(w) * h, color) {}
  /// Columns and rows from (left, top) up to, not including, (right, bottom).
  Canvas& box(int left, int top, int right, int bottom, Color color)
  {
    for (int row = std::max(0, top); row < std::min(height, bottom); ++row)
      for (int column = std::max(0, left); column < std::min(width, right); ++column)
        pixels[std::size_t(row) * width + column] = color;
    return *this;
  }
  /// A disc around a point given in pixels right of and below the upper left corner.
  Canvas& disc(double x, double y, double radius, Color color)
  {
    for (int row = 0; row < height; ++row)
      for (int column = 0; column < width; ++column)
        if (std::hypot(column + 0.5 - x, row + 0.5 - y) <= radius)
          pixels[std::size_t(row) * width + column] = color;
    return *this;
  }
  std::string ppm() const
  {
    std::string out = "P6 " + std::to_string(width) + ' ' + std::to_string(height) + " 255\n";
    for (const Color color : pixels)
      for (const int shift : { 16, 8, 0 })
        out += char(color >> shift & 255);
    return out;
  }
};
}  // namespace pictures
