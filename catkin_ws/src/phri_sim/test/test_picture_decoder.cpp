#include <gtest/gtest.h>

#include <cstring>
#include <functional>

#include "phri_core/random.hpp"
#include "picture_decoder.hpp"
#include "pictures.hpp"

using namespace phri_sim;
using pictures::temporary;

namespace
{
constexpr Raster kSmall{ 24, 0 };
constexpr int kMutations = 2000;  // per format

/// A small picture with walls and two dots, saved by gdk-pixbuf as `type`.
std::string saved(const char* type, bool alpha)
{
  PixbufPtr pixbuf(gdk_pixbuf_new(GDK_COLORSPACE_RGB, alpha, 8, 24, 20));
  gdk_pixbuf_fill(pixbuf.get(), 0xffffffff);
  const auto paint = [&](int x, int y, int w, int h, guint32 rgba) {
    PixbufPtr part(gdk_pixbuf_new_subpixbuf(pixbuf.get(), x, y, w, h));
    gdk_pixbuf_fill(part.get(), rgba);
  };
  paint(0, 0, 24, 2, 0x000000ff);
  paint(11, 0, 2, 14, 0x000000ff);
  paint(4, 6, 4, 4, 0x00c000ff);
  paint(17, 6, 4, 4, 0xdc0000ff);
  gchar* data = nullptr;
  gsize size = 0;
  gdk_pixbuf_save_to_buffer(pixbuf.get(), &data, &size, type, nullptr, nullptr);
  const std::string bytes(data, size);
  g_free(data);
  return bytes;
}

std::vector<std::pair<std::string, std::string>> formats()
{
  pictures::Canvas canvas(24, 20);
  canvas.box(11, 0, 13, 14, 0).disc(6, 8, 3, canvas.kGreen).disc(19, 8, 3, canvas.kRed);
  std::string ascii = "P2 24 20 15\n";
  for (int k = 0; k < 480; ++k)
    ascii += std::to_string(k % 16) + ' ';
  return { { "png", saved("png", false) },
           { "rgba.png", saved("png", true) },
           { "jpg", saved("jpeg", false) },
           { "ppm", canvas.ppm() },
           { "pgm", ascii },
           { "svg",
             "<?xml version='1.0'?><svg xmlns='http://www.w3.org/2000/svg' width='24' height='20' viewBox='0 0 24 20'>"
             "<g transform='translate(1 1)' style='stroke:black;stroke-width:2'><path d='M0 0H22V18H0Z M11 0V12' "
             "fill='none'/></g><circle cx='6' cy='8' r='3' fill='#00c000'/></svg>" } };
}

std::string pixels(const GdkPixbuf* pixbuf)
{
  std::string out;
  const int bytes = gdk_pixbuf_get_width(pixbuf) * gdk_pixbuf_get_n_channels(pixbuf);
  for (int row = 0; row < gdk_pixbuf_get_height(pixbuf); ++row)
    out.append(reinterpret_cast<const char*>(gdk_pixbuf_read_pixels(pixbuf)) + row * gdk_pixbuf_get_rowstride(pixbuf),
               bytes);
  return out;
}
}  // namespace

class Format : public testing::TestWithParam<std::pair<std::string, std::string>>
{
protected:
  void SetUp() override
  {
    g_log_set_default_handler([](const char*, GLogLevelFlags, const char*, void*) {}, nullptr);
  }
};

// A file that ends early is refused, or nothing of its picture was in the part that is missing.
TEST_P(Format, TruncatedFilesAreRefused)
{
  const auto& [name, bytes] = GetParam();
  const std::string path = temporary(name, bytes), whole = pixels(decodePicture(path, kSmall).get());
  int refused = 0;
  for (std::size_t length = 0; length < bytes.size(); ++length)
  {
    temporary(name, bytes.substr(0, length));
    try
    {
      EXPECT_EQ(pixels(decodePicture(path, kSmall).get()), whole) << name << " cut at " << length;
    }
    catch (const std::runtime_error&)
    {
      ++refused;
    }
  }
  constexpr int kTrailer = 8;  // [byte] checksum, newline or blanks behind the picture
  EXPECT_GE(refused, int(bytes.size()) - kTrailer) << name;
}

// Flipped bits, overwritten and missing pieces: a picture within the limits comes out, or std::runtime_error.
TEST_P(Format, DamagedFilesLoadOrAreRefused)
{
  const auto& [name, bytes] = GetParam();
  phri_core::Random random(17);
  int loaded = 0, refused = 0;
  for (int k = 0; k < kMutations; ++k)
  {
    std::string damaged = bytes;
    const auto place = [&] { return std::size_t(random.uniform() * double(damaged.size())); };
    const int kind = int(random.uniform() * 4.0);
    if (kind == 0)
      damaged.resize(place());
    else if (kind == 1)
      damaged.erase(place(), std::size_t(1 + random.uniform() * 8.0));
    else
      for (int flips = 1 + int(random.uniform() * 4.0); flips > 0; --flips)
        damaged[place()] ^= kind == 2 ? char(1 << int(random.uniform() * 8.0)) : char(random.uniform() * 256.0);
    const std::string path = temporary(name, damaged);
    try
    {
      const PixbufPtr pixbuf = decodePicture(path, kSmall);
      const int width = gdk_pixbuf_get_width(pixbuf.get()), height = gdk_pixbuf_get_height(pixbuf.get());
      EXPECT_TRUE(std::min(width, height) >= kSmallestSide && std::max(width, height) <= kLargestSide);
      EXPECT_GT(pixels(pixbuf.get()).size(), 0u);
      ++loaded;
    }
    catch (const std::runtime_error& error)
    {
      EXPECT_GT(std::strlen(error.what()), 10u);
      ++refused;
    }
  }
  RecordProperty("loaded", loaded);
  RecordProperty("refused", refused);
  EXPECT_GT(loaded, 0) << name;
  EXPECT_GT(refused, 0) << name;
}

INSTANTIATE_TEST_SUITE_P(PictureDecoder, Format, testing::ValuesIn(formats()),
                         [](const auto& info) { return "n" + std::to_string(info.index); });
