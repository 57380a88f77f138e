// decode_picture FILE [WIDTH HEIGHT]: writes FILE as PPM (P6) to the standard output, transparent parts on white; or,
// instead of it, a line that starts with "error: ". SVG is drawn WIDTH x HEIGHT pixels; HEIGHT 0: longer side WIDTH.
// Limits itself to 200 MB and 1.5 s of processor time, so that a picture made to hurt cannot; the library starts it.
#include <sys/resource.h>
#include <sys/time.h>

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <vector>

#include "picture_decoder.hpp"

namespace
{
constexpr rlim_t kMemory = 200ul << 20;                // [byte]
constexpr itimerval kTime{ { 0, 0 }, { 1, 500000 } };  // [s, us]

void limitThisProcess()
{
  const rlimit core{ 0, 0 };
  setitimer(ITIMER_PROF, &kTime, nullptr);
  setrlimit(RLIMIT_CORE, &core);
#ifndef __SANITIZE_ADDRESS__  // its shadow memory alone would break the limit
  const rlimit memory{ kMemory, kMemory };
  setrlimit(RLIMIT_DATA, &memory);
#endif
}

void ignore(const char*, GLogLevelFlags, const char*, void*) {}

bool writePpm(GdkPixbuf* pixbuf)
{
  const int width = gdk_pixbuf_get_width(pixbuf), height = gdk_pixbuf_get_height(pixbuf);
  const int stride = gdk_pixbuf_get_rowstride(pixbuf), channels = gdk_pixbuf_get_n_channels(pixbuf);
  const guchar* const pixels = gdk_pixbuf_read_pixels(pixbuf);
  std::printf("P6\n%d %d\n255\n", width, height);
  std::vector<guchar> row(3 * std::size_t(width));
  for (int j = 0; j < height; ++j)
  {
    const guchar* pixel = pixels + std::size_t(j) * stride;
    for (int i = 0; i < width; ++i, pixel += channels)
    {
      const int alpha = channels == 4 ? pixel[3] : 255;
      for (int c = 0; c < 3; ++c)
        row[3 * i + c] = guchar((pixel[c] * alpha + 255 * (255 - alpha) + 127) / 255);
    }
    if (std::fwrite(row.data(), 1, row.size(), stdout) != row.size())
      return false;
  }
  return std::fflush(stdout) == 0;
}
}  // namespace

int main(int argc, char** argv)
{
  if (argc != 2 && argc != 4)
  {
    std::fprintf(stderr, "usage: decode_picture FILE [WIDTH HEIGHT]\n");
    return 64;
  }
  limitThisProcess();
  g_log_set_default_handler(ignore, nullptr);
  phri_sim::Raster raster;
  if (argc == 4)
    raster = { std::atoi(argv[2]), std::atoi(argv[3]) };
  try
  {
    return writePpm(phri_sim::decodePicture(argv[1], raster).get()) ? 0 : 74;
  }
  catch (const std::exception& error)
  {
    std::printf("error: %s\n", error.what());
    return 65;
  }
}
