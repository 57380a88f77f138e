#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <sstream>

#include "phri_sim/configuration.hpp"
#include "phri_sim/route.hpp"
#include "phri_sim/scene.hpp"

namespace phri_sim
{
namespace
{
namespace fs = std::filesystem;
using Eigen::Vector2d;
constexpr double kWorkspace = 0.3;  // [m] of the haptic device: longer side of a picture that says nothing of its size
constexpr double kPiece = 0.003;    // [m] longest straight one of a path
constexpr double kClearance = 0.012;  // [m] wanted by the route that is tried at the start

/// The keys of a scene file, as they stand in it.
struct SceneFile
{
  std::string image;
  double resolution = 0.0005, occupied = 0.65, free = 0.2;
  int negate = 0;
  std::vector<double> size{ kWorkspace, kWorkspace }, origin{ 0.0, 0.0, 0.0 }, start{ 0.0, 0.0 }, goal{ 0.0, 0.0 };
  double goal_radius = 0.006, object_radius = 0.003, turning_x = NAN, stiffness = 2e4, damping = 1500.0;
  std::vector<double> obstacle_x, obstacle_y, obstacle_size{ 0.02, 0.01 }, period{ 3.0, 5.0 };
  double amplitude = 0.05;
  std::vector<double> path_x, path_y;
  Parameters given;  ///< what the file says, to tell it from defaults

  bool has(const std::string& key) const { return given.count(key) > 0; }
  phri_core::ParameterTable table()
  {
    phri_core::ParameterTable t;
    t.text("image", &image, {}, "picture (png, jpg, pgm, svg), relative to this file; dark is wall")
        .number("resolution", &resolution, "m/pixel", 1e-5, 1.0, "size of a pixel")
        .list("size", &size, 2, "m", 1e-3, 1000.0, "width and height of the picture, instead of resolution; svg: both")
        .list("origin", &origin, 3, "m, m, rad", -100.0, 100.0, "lower left corner and yaw (0); default: centred")
        .number("occupied_thresh", &occupied, "-", 0.0, 1.0, "darkness above which a pixel is wall")
        .number("free_thresh", &free, "-", 0.0, 1.0, "kept for ROS; not used")
        .integer("negate", &negate, "", 0, 1, "1: bright is wall")
        .list("start", &start, 2, "m", -100.0, 100.0, "where the object starts; default: the green dot")
        .list("goal", &goal, 2, "m", -100.0, 100.0, "where it shall go; default: the red dot")
        .number("goal_radius", &goal_radius, "m", 1e-4, 1.0,
                "how near counts as reached; default: the red dot's radius if larger")
        .number("object_radius", &object_radius, "m", 1e-4, 1.0, "radius of the object")
        .number("turning_x", &turning_x, "m", -100.0, 100.0, "left of it the subtask narrow channel begins")
        .number("wall/stiffness", &stiffness, "N/m", 10.0, 5e4, "of walls and obstacles")
        .number("wall/damping", &damping, "Ns/m", 0.0, 1e4, "of walls and obstacles, while approaching")
        .list("path/x", &path_x, 0, "m", -100.0, 100.0, "points of a line to follow from end to end; no picture needed")
        .list("path/y", &path_y, 0, "m", -100.0, 100.0, "points of a line to follow")
        .list("obstacles/x", &obstacle_x, 0, "m", -100.0, 100.0, "centres of the moving boxes")
        .list("obstacles/y", &obstacle_y, 0, "m", -100.0, 100.0, "centres of the moving boxes")
        .list("obstacles/half_size", &obstacle_size, 2, "m", 1e-3, 10.0, "half width and height of the moving boxes")
        .number("obstacles/amplitude", &amplitude, "m", 0.0, 10.0, "of their motion along x")
        .list("obstacles/period", &period, 2, "s", 0.1, 1000.0, "range that the period is drawn from, per trial");
    return t;
  }
};

template <typename... Parts>
std::string text(const Parts&... parts)
{
  std::ostringstream out;
  (out << ... << parts);
  return out.str();
}

std::string extension(const std::string& path)
{
  std::string end = fs::path(path).extension().string();
  std::transform(end.begin(), end.end(), end.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return end;
}

bool isPicture(const std::string& path)
{
  const std::string end = extension(path);
  return end == ".png" || end == ".jpg" || end == ".jpeg" || end == ".pgm" || end == ".svg";
}

SceneFile readFile(const std::string& path)
{
  SceneFile file;
  file.given = loadYaml(path);
  std::vector<std::string> errors;
  try
  {
    file.table().assign(path, file.given);
  }
  catch (const phri_core::ParameterError& error)
  {
    errors = error.errors();
  }
  const bool vector_drawing = file.has("image") && std::holds_alternative<std::string>(file.given["image"]) &&
                              extension(std::get<std::string>(file.given["image"])) == ".svg";
  const bool blank = !file.has("image") && file.has("path/x");
  if (!file.has("image") && !blank)
    errors.push_back("image: missing; expected the name of a picture, or a path to follow");
  else if (blank && file.has("resolution") && std::max(file.size[0], file.size[1]) / file.resolution > kLargestSide)
    errors.push_back(text("resolution = ", file.resolution, " m/pixel over size = [", file.size[0], ", ", file.size[1],
                          "] m: expected at most ", kLargestSide, " pixels along a side"));
  else if (blank)
    ;  // nothing but the path
  else if (!vector_drawing && file.has("size") == file.has("resolution"))
    errors.push_back(text("size [m] and resolution [m/pixel]: ", file.has("size") ? "both are" : "neither is",
                          " given; expected exactly one of them"));
  if (file.obstacle_x.size() != file.obstacle_y.size())
    errors.push_back(text("obstacles/x has ", file.obstacle_x.size(), " elements, obstacles/y ", file.obstacle_y.size(),
                          ": expected equally many"));
  if (file.path_x.size() != file.path_y.size())
    errors.push_back(
        text("path/x has ", file.path_x.size(), " elements, path/y ", file.path_y.size(), ": expected equally many"));
  else if (file.path_x.size() == 1)
    errors.push_back("path: 1 point; expected at least 2");
  if (!file.path_x.empty() && (file.has("start") || file.has("goal")))
    errors.push_back("start, goal: given beside a path; expected neither, they are its ends");
  if (file.origin[2] != 0.0)
    errors.push_back(text("origin: yaw ", file.origin[2], " rad: expected 0"));
  if (vector_drawing && errors.empty() && std::max(file.size[0], file.size[1]) / file.resolution > kLargestSide + 0.5)
    errors.push_back(text("size = [", file.size[0], ", ", file.size[1], "] m at resolution = ", file.resolution,
                          " m/pixel makes ", std::llround(file.size[0] / file.resolution), " x ",
                          std::llround(file.size[1] / file.resolution), " pixels: expected at most ", kLargestSide,
                          " x ", kLargestSide));
  if (!errors.empty())
    throw phri_core::ParameterError(path, errors);
  if (!blank && fs::path(file.image).is_relative())
    file.image = (fs::path(path).parent_path() / file.image).string();
  return file;
}

/// Reads the picture and settles the resolution.
Picture readPictureOf(const std::string& path, SceneFile& file)
{
  if (file.image.empty())
  {
    const auto pixels = [&](double length) { return std::max(1, int(std::lround(length / file.resolution))); };
    Picture blank;
    blank.image.width = pixels(file.size[0]);
    blank.image.height = pixels(file.size[1]);
    blank.image.pixels.assign(std::size_t(blank.image.width) * std::size_t(blank.image.height), 255);
    return blank;
  }
  if (extension(file.image) == ".svg")
  {
    const auto pixels = [&](double length) { return std::max(1, int(std::lround(length / file.resolution))); };
    return readPicture(file.image, { pixels(file.size[0]), file.has("size") ? pixels(file.size[1]) : 0 });
  }
  Picture picture = readPicture(file.image);
  const GrayImage& image = picture.image;
  if (file.has("resolution"))
    return picture;
  if (!file.has("size"))
  {
    file.resolution = kWorkspace / std::max(image.width, image.height);
    return picture;
  }
  file.resolution = file.size[0] / image.width;
  if (std::abs(file.size[1] / file.resolution - image.height) > 1.0)
    throw phri_core::ParameterError(
        path, { text("size = [", file.size[0], ", ", file.size[1], "] m: picture ", file.image, " is ", image.width,
                     " x ", image.height, " pixels; expected its aspect ratio, for instance [", file.size[0], ", ",
                     file.resolution * image.height, "]") });
  return picture;
}

struct Ends
{
  Vector2d start, goal;
};

/// A line through the path's points, cubic pieces whose tangent at a point is that of the chord between its neighbours
/// (Catmull-Rom).
std::vector<Vector2d> pathOf(const SceneFile& file)
{
  const int last = int(file.path_x.size()) - 1;
  const auto point = [&](int k) {
    k = std::clamp(k, 0, last);
    return Vector2d(file.path_x[k], file.path_y[k]);
  };
  std::vector<Vector2d> line;
  for (int k = 0; k < last; ++k)
  {
    const Vector2d a = point(k - 1), b = point(k), c = point(k + 1), d = point(k + 2);
    const int pieces = std::max(1, int(std::ceil((c - b).norm() / kPiece)));
    for (int i = 0; i < pieces; ++i)
    {
      const double u = double(i) / pieces;
      line.push_back(b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d + u * (3.0 * (b - c) + d - a))));
    }
  }
  if (last >= 0)
    line.push_back(point(last));
  return line;
}

/// Start and goal from the dots where the file gives none.
Ends endsOf(const SceneFile& file, const Picture& picture, const Vector2d& origin)
{
  if (!file.path_x.empty())
    return { { file.path_x.front(), file.path_y.front() }, { file.path_x.back(), file.path_y.back() } };
  std::string faults;
  const auto end = [&](const char* key, const std::vector<double>& given, const Dot& dot) {
    if (!file.has(key) && !dot.found)
      faults += text(faults.empty() ? "" : "; ", dot.fault, ", or ", key, ": [x, y] in a scene file");
    return file.has(key)
               ? Vector2d(given[0], given[1])
               : Vector2d(origin + file.resolution * Vector2d(dot.center(0), picture.image.height - dot.center(1)));
  };
  const Ends ends{ end("start", file.start, picture.green), end("goal", file.goal, picture.red) };
  if (!faults.empty())
    throw PictureError("picture " + file.image + ": " + faults);
  return ends;
}

void requirePassable(const std::string& path, const Scene& scene)
{
  const GrayImage& image = scene.image;
  const Vector2d low = scene.walls.origin() + Vector2d::Constant(scene.walls.resolution());
  const Vector2d high = low + scene.walls.resolution() * Vector2d(image.width, image.height);
  std::string faults;
  for (const auto& [what, x] : { std::pair("start", scene.start), std::pair("goal", scene.goal) })
  {
    const std::string where = text(faults.empty() ? "" : "; ", "the ", what, " (", x(0), ", ", x(1), ") m lies ");
    if ((x.array() < low.array()).any() || (x.array() > high.array()).any())
      faults += text(where, "outside the picture: expected x from ", low(0), " to ", high(0), " m, y from ", low(1),
                     " to ", high(1), " m");
    else if (scene.clearance(x) <= 0.0)
      faults += text(where, -scene.clearance(x), " m inside a wall or too near to one: expected at least ",
                     scene.object_radius, " m, the object's radius, to the nearest wall");
  }
  if (!faults.empty())
    throw PictureError(path + ": " + faults);
  for (const Vector2d& x : scene.path)
    if (scene.clearance(x) <= 0.0)
      throw PictureError(text(path, ": the path touches a wall at (", x(0), ", ", x(1),
                              ") m: expected more than the object's radius, ", scene.object_radius, " m, to it"));
  const Passage passage = scene.path.empty() ? widestPassage(scene.walls, scene.start, scene.goal, scene.object_radius)
                                             : Passage{ 0.0, true };
  if (passage.width < 0.0)
    throw PictureError(path + ": no way leads from the start to the goal: walls separate them");
  if (!passage.fits)
    throw PictureError(text(path, ": no way leads from the start to the goal for an object of radius ",
                            scene.object_radius, " m: the widest one narrows to about ", passage.width,
                            " m; expected more than ", 2.0 * scene.object_radius, " m"));
  try
  {
    planRoute(scene, kClearance);
  }
  catch (const PictureError& error)
  {
    throw PictureError(path + ": " + error.what());
  }
}

Scene build(const std::string& path, SceneFile file)
{
  Picture picture = readPictureOf(path, file);
  GrayImage& image = picture.image;
  const Vector2d origin = file.has("origin") ? Vector2d(file.origin[0], file.origin[1])
                                             : Vector2d(-0.5 * file.resolution * Vector2d(image.width, image.height));
  if (file.negate)
    for (std::uint8_t& pixel : image.pixels)
      pixel = static_cast<std::uint8_t>(255 - pixel);
  for (const Dot* dot : { &picture.green, &picture.red })
    for (const std::uint32_t at : dot->pixels)
      image.pixels[at] = 255;
  const std::uint8_t lightest = *std::max_element(image.pixels.begin(), image.pixels.end());
  if (255 - lightest > file.occupied * 255.0)
    throw PictureError(text("picture ", file.image, ": all of its ", image.width, " x ", image.height,
                            " pixels are wall; the lightest has the darkness ", (255 - lightest) / 255.0,
                            ": expected free space, at most ", file.occupied));
  const Ends ends = endsOf(file, picture, origin);
  DistanceField walls(image, file.resolution, origin, file.occupied);
  Scene scene{ fs::path(path).stem().string(), file.image, std::move(image), std::move(walls), file.occupied };
  scene.start = ends.start;
  scene.goal = ends.goal;
  // reached is what lies in the dot
  const bool painted = !file.has("goal") && !file.has("goal_radius");
  scene.goal_radius = painted ? std::max(file.goal_radius, picture.red.radius * file.resolution) : file.goal_radius;
  scene.object_radius = file.object_radius;
  scene.path = pathOf(file);
  scene.turning_x = file.turning_x;
  scene.stiffness = file.stiffness;
  scene.damping = file.damping;
  scene.period_low = std::min(file.period[0], file.period[1]);
  scene.period_high = std::max(file.period[0], file.period[1]);
  for (std::size_t i = 0; i < file.obstacle_x.size(); ++i)
  {
    MovingObstacle obstacle;
    obstacle.center = { file.obstacle_x[i], file.obstacle_y[i] };
    obstacle.half_size = { file.obstacle_size[0], file.obstacle_size[1] };
    obstacle.amplitude = file.amplitude;
    scene.obstacles.push_back(obstacle);
  }
  requirePassable(path, scene);
  return scene;
}
}  // namespace

Scene loadScene(const std::string& name_or_path)
{
  if (!isPicture(name_or_path))
  {
    const std::string path = findConfiguration("scenes", name_or_path);
    return build(path, readFile(path));
  }
  SceneFile file;
  file.image = name_or_path;
  const fs::path shipped = fs::path(shareFolder()) / "config" / "scenes" / name_or_path;
  if (!fs::exists(name_or_path) && fs::exists(shipped))
    file.image = shipped.string();
  const std::string path = file.image;
  return build(path, std::move(file));
}
}  // namespace phri_sim
