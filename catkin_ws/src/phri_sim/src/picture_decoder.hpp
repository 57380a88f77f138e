#pragma once
#include <gdk-pixbuf/gdk-pixbuf.h>

#include <memory>
#include <string>

#include "phri_sim/image.hpp"

namespace phri_sim
{
struct PixbufRelease
{
  void operator()(GdkPixbuf* pixbuf) const { g_object_unref(pixbuf); }
};
using PixbufPtr = std::unique_ptr<GdkPixbuf, PixbufRelease>;

/// Decodes a PNG, JPEG, PNM (P1 to P6) or SVG file, told apart by its first bytes, with gdk-pixbuf: 8 bits per channel,
/// RGB or RGBA, turned as a camera's orientation mark says. The size is checked before the pixels are decoded. Throws
/// std::runtime_error with cause, what was found and the limit (the file's name is the caller's to add).
///
/// Runs in a process of its own (decode_picture): an SVG can ask for any amount of memory and time in a few lines
/// (filters, nested groups, embedded pictures), and only the limits of a process stop all of them.
PixbufPtr decodePicture(const std::string& path, const Raster& raster);
}  // namespace phri_sim
