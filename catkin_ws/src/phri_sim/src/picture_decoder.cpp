#include "picture_decoder.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <stdexcept>

namespace phri_sim
{
namespace
{
struct LoaderRelease
{
  void operator()(GdkPixbufLoader* loader) const
  {
    gdk_pixbuf_loader_close(loader, nullptr);  // a loader must not be destroyed open; a second close does nothing
    g_object_unref(loader);
  }
};

struct Format
{
  const char* name;     ///< of the gdk-pixbuf module
  const char* shown;    ///< in messages
  const char* package;  ///< Debian package that holds the module
};
constexpr std::size_t kChunk = 4096;  // [byte] at a time: little is inflated before the size is known

constexpr Format kPng{ "png", "PNG", "libgdk-pixbuf-2.0-0" }, kJpeg{ "jpeg", "JPEG", "libgdk-pixbuf-2.0-0" },
    kPnm{ "pnm", "PGM", "libgdk-pixbuf-2.0-0" }, kSvg{ "svg", "SVG", "librsvg2-common" };

/// What the loader's handlers get and leave.
struct Progress
{
  const Format* format;
  Raster raster;
  std::string refusal;  ///< of the size
  int rows = 0;         ///< [pixel] decoded: the modules take what a truncated file does not hold for black
};

std::string sizeText(int width, int height)
{
  return std::to_string(width) + " x " + std::to_string(height) + " pixels";
}

std::string sizeRefusal(int width, int height)
{
  if (std::min(width, height) >= kSmallestSide && std::max(width, height) <= kLargestSide)
    return "";
  return sizeText(width, height) + ": expected " + std::to_string(kSmallestSide) + " x " +
         std::to_string(kSmallestSide) + " to " + std::to_string(kLargestSide) + " x " + std::to_string(kLargestSide);
}

/// Pixels that a drawing of the size width x height gets. gdk-pixbuf rounds a drawing's own size to whole pixels, so
/// the aspect ratio is known to half a pixel of that.
std::string fitDrawing(int width, int height, const Raster& raster, int& columns, int& rows)
{
  if (width < 1 || height < 1)
    return "the drawing is " + sizeText(width, height) +
           " large: expected at least 1 x 1 (its width and height, or viewBox)";
  columns = raster.width;
  rows = raster.height;
  if (raster.height == 0)
  {
    const double scale = double(raster.width) / std::max(width, height);
    columns = std::max(1, int(std::lround(width * scale)));
    rows = std::max(1, int(std::lround(height * scale)));
    return sizeRefusal(columns, rows);
  }
  const double wanted = double(columns) * height / width;
  const double tolerance = 1.0 + wanted * (0.5 / width + 0.5 / height);
  if (std::abs(wanted - rows) > tolerance)
    return "the drawing is " + sizeText(width, height) + ", the size asks for " + sizeText(columns, rows) +
           ": expected the same aspect ratio";
  return sizeRefusal(columns, rows);
}

void prepareSize(GdkPixbufLoader* loader, int width, int height, void* data)
{
  Progress& sizing = *static_cast<Progress*>(data);
  if (sizing.format != &kSvg)
    sizing.refusal = sizeRefusal(width, height);
  else
  {
    int columns = 0, rows = 0;
    sizing.refusal = fitDrawing(width, height, sizing.raster, columns, rows);
    if (sizing.refusal.empty())
      gdk_pixbuf_loader_set_size(loader, columns, rows);
  }
  if (!sizing.refusal.empty())
    gdk_pixbuf_loader_set_size(loader, 0, 0);  // asks the module not to decode
}

void countRows(GdkPixbufLoader*, int, int y, int, int height, void* data)
{
  Progress& progress = *static_cast<Progress*>(data);
  progress.rows = std::max(progress.rows, y + height);
}

/// Whether the end of a file has come by: the modules take truncated PNG and JPEG files for whole ones.
class EndMark
{
public:
  void read(const std::string& bytes)
  {
    for (const char byte : bytes)
    {
      last_ = last_ << 8 | std::uint8_t(byte);
      if (last_ == 0x49454e44)  // IEND
        png_ended_ = true;
      if ((last_ & 0xffff) == 0xffda)  // start of scan; a preview in the header has its own
        jpeg_ended_ = false;
      if ((last_ & 0xffff) == 0xffd9)
        jpeg_ended_ = true;
    }
  }
  bool missing(const Format& format) const
  {
    return (&format == &kPng && !png_ended_) || (&format == &kJpeg && !jpeg_ended_);
  }

private:
  std::uint32_t last_ = 0;
  bool png_ended_ = false, jpeg_ended_ = false;
};

const Format& formatOf(const std::string& head)
{
  const auto starts = [&](const std::string& magic) { return head.compare(0, magic.size(), magic) == 0; };
  if (starts("\x89PNG\r\n\x1a\n"))
    return kPng;
  if (starts("\xff\xd8\xff"))
    return kJpeg;
  if (head.size() > 2 && head[0] == 'P' && head[1] >= '1' && head[1] <= '6' && std::strchr(" \t\r\n#", head[2]))
    return kPnm;
  if (head.find("<svg") != std::string::npos || head.find("<!DOCTYPE svg") != std::string::npos)
    return kSvg;
  throw std::runtime_error("its first bytes are of no picture: expected a PNG, JPEG, PGM or SVG file");
}

[[noreturn]] void refuse(const Format& format, const std::string& cause)
{
  throw std::runtime_error(std::string("damaged ") + format.shown + " file (" + cause + ')');
}

std::string take(GError* error)
{
  const std::string text = error ? error->message : "unknown cause";
  g_clear_error(&error);
  return text;
}
}  // namespace

PixbufPtr decodePicture(const std::string& path, const Raster& raster)
{
  std::ifstream in(path, std::ios::binary);
  std::string chunk(kChunk, '\0');
  in.read(&chunk[0], std::streamsize(chunk.size()));
  if (in.gcount() == 0)
    throw std::runtime_error("empty or unreadable: expected a PNG, JPEG, PGM or SVG file");
  const Format& format = formatOf(chunk.substr(0, std::size_t(in.gcount())));

  GError* error = nullptr;
  std::unique_ptr<GdkPixbufLoader, LoaderRelease> loader(gdk_pixbuf_loader_new_with_type(format.name, &error));
  if (!loader)
    throw std::runtime_error(std::string("this machine cannot read ") + format.shown + " files (" + take(error) +
                             "): install the package " + format.package);
  Progress progress{ &format, raster, "" };
  g_signal_connect(loader.get(), "size-prepared", G_CALLBACK(prepareSize), &progress);
  g_signal_connect(loader.get(), "area-updated", G_CALLBACK(countRows), &progress);
  EndMark end;
  long total = 0;
  bool good = true;
  for (; in.gcount() > 0 && good && progress.refusal.empty(); in.read(&chunk[0], std::streamsize(chunk.size())))
  {
    total += in.gcount();
    if (total > kLargestFile)
      throw std::runtime_error("more than " + std::to_string(kLargestFile >> 20) + " MB: expected a smaller file");
    end.read(chunk.substr(0, std::size_t(in.gcount())));
    good = gdk_pixbuf_loader_write(loader.get(), reinterpret_cast<const guchar*>(chunk.data()), gsize(in.gcount()),
                                   &error);
  }
  if (good && progress.refusal.empty())
    good = gdk_pixbuf_loader_close(loader.get(), &error);
  if (!progress.refusal.empty())
  {
    g_clear_error(&error);
    throw std::runtime_error(progress.refusal);
  }
  if (!good)
    refuse(format, take(error) + "; " + std::to_string(total) + " bytes read");
  GdkPixbuf* const raw = gdk_pixbuf_loader_get_pixbuf(loader.get());
  if (!raw)
    refuse(format, "no pixels");
  if (&format != &kSvg && progress.rows < gdk_pixbuf_get_height(raw))
    refuse(format, "it ends after " + std::to_string(progress.rows) + " of " +
                       std::to_string(gdk_pixbuf_get_height(raw)) + " rows");
  if (end.missing(format))
    refuse(format, "it ends before its end mark");
  PixbufPtr upright(gdk_pixbuf_apply_embedded_orientation(raw));
  if (!upright || gdk_pixbuf_get_bits_per_sample(upright.get()) != 8 || gdk_pixbuf_get_n_channels(upright.get()) < 3)
    refuse(format, "not 8 bits RGB");
  const std::string refusal = sizeRefusal(gdk_pixbuf_get_width(upright.get()), gdk_pixbuf_get_height(upright.get()));
  if (!refusal.empty())
    throw std::runtime_error(refusal);
  return upright;
}
}  // namespace phri_sim
