#include <png.h>

#include <cctype>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "phri_sim/scene.hpp"

namespace phri_sim
{
namespace
{
constexpr int kLargestSide = 4096;

[[noreturn]] void refuse(const std::string& path, const std::string& cause)
{
  throw std::invalid_argument("picture " + path + ": " + cause);
}

void requireSize(const std::string& path, long width, long height)
{
  if (width >= 2 && height >= 2 && width <= kLargestSide && height <= kLargestSide)
    return;
  std::ostringstream text;
  text << width << " x " << height << " pixels: expected 2 x 2 to " << kLargestSide << " x " << kLargestSide;
  refuse(path, text.str());
}

GrayImage readPng(const std::string& path)
{
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  if (!png_image_begin_read_from_file(&png, path.c_str()))
    refuse(path, std::string("not a readable PNG file (") + png.message + ')');
  if (png.width > kLargestSide || png.height > kLargestSide || png.width < 2 || png.height < 2)
  {
    png_image_free(&png);
    requireSize(path, png.width, png.height);
  }
  png.format = PNG_FORMAT_GRAY;
  GrayImage image{ int(png.width), int(png.height), std::vector<std::uint8_t>(PNG_IMAGE_SIZE(png)) };
  const png_color white = { 255, 255, 255 };
  if (!png_image_finish_read(&png, &white, image.pixels.data(), 0, nullptr))
    refuse(path, std::string("damaged PNG file (") + png.message + ')');
  return image;
}

/// Next number of a PGM header; '#' starts a comment to the line's end.
long headerNumber(std::istream& in)
{
  while (in && (std::isspace(in.peek()) || in.peek() == '#'))
    if (in.get() == '#')
      in.ignore(1 << 20, '\n');
  long value = -1;
  in >> value;
  return in ? value : -1;
}

GrayImage readPgm(const std::string& path, std::istream& in, bool binary)
{
  const long width = headerNumber(in), height = headerNumber(in), largest = headerNumber(in);
  requireSize(path, width, height);
  if (largest < 1 || largest > 255)
    refuse(path, "largest grey value " + std::to_string(largest) + ": expected 1 to 255");
  GrayImage image{ int(width), int(height), std::vector<std::uint8_t>(std::size_t(width) * height) };
  if (binary)
  {
    in.get();
    in.read(reinterpret_cast<char*>(image.pixels.data()), image.pixels.size());
  }
  else
    for (std::uint8_t& pixel : image.pixels)
      pixel = static_cast<std::uint8_t>(std::max(0l, headerNumber(in)));
  if (!in)
    refuse(path, "ends before its " + std::to_string(image.pixels.size()) + " pixels");
  for (std::uint8_t& pixel : image.pixels)
    pixel = static_cast<std::uint8_t>(std::min<long>(pixel, largest) * 255 / largest);
  return image;
}
}  // namespace

GrayImage readImage(const std::string& path)
{
  std::ifstream in(path, std::ios::binary);
  char magic[2] = { 0, 0 };
  if (!in.read(magic, 2))
    refuse(path, "cannot be read: expected an existing PNG or PGM file");
  if (magic[0] == 'P' && (magic[1] == '2' || magic[1] == '5'))
    return readPgm(path, in, magic[1] == '5');
  return readPng(path);
}
}  // namespace phri_sim
