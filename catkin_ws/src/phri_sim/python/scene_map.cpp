#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <string>
#include <vector>

#include "phri_sim/scene.hpp"

namespace py = pybind11;
using namespace phri_sim;

/// The walls as a reader of the bag gets them from its OccupancyGrid, whose resolution is a float. Rows from the
/// bottom, '#' where wall; text, for attributes of a table must compare and be written as JSON.
py::dict mapOf(const Scene& scene)
{
  const GrayImage& image = scene.image;
  std::vector<std::string> rows(image.height, std::string(image.width, '.'));
  for (int row = 0; row < image.height; ++row)
    for (int column = 0; column < image.width; ++column)
      if ((255 - image.pixels[row * image.width + column]) / 255.0 > scene.occupied)
        rows[image.height - 1 - row][column] = '#';
  const double resolution = scene.walls.resolution();
  py::dict map;
  map["grid"] = rows;
  map["resolution"] = double(float(resolution));
  // the field has one pixel of wall around the picture
  map["origin"] = std::vector<double>{ scene.walls.origin()(0) + resolution, scene.walls.origin()(1) + resolution };
  return map;
}
