#include <gtest/gtest.h>

#include "phri_core/parameters.hpp"
#include "phri_core/random.hpp"
#include "phri_sim/route.hpp"
#include "phri_sim/scene.hpp"
#include "pictures.hpp"

using namespace phri_sim;
using Eigen::Vector2d;
using pictures::Canvas;
using pictures::temporary;

namespace
{
/// A yaml file with `keys` for the picture.
std::string yaml(const Canvas& canvas, const std::string& keys)
{
  return temporary("scene.yaml", "image: " + temporary("scene.ppm", canvas.ppm()) + '\n' + keys);
}

std::string refusal(const std::string& path)
{
  return pictures::refusal<PictureError>([&] { loadScene(path); });
}

std::string keyRefusal(const std::string& path)
{
  return pictures::refusal<phri_core::ParameterError>([&] { loadScene(path); });
}

/// A picture alone is told by its extension; the content of a .pgm may be any PNM.
std::string alone(const Canvas& canvas)
{
  return temporary("alone.pgm", canvas.ppm());
}

/// 120 x 90 pixels: two rooms, a wall of `thickness` between them with a hole of `hole` pixels; a dot in each.
Canvas rooms(int hole, int thickness = 4)
{
  Canvas canvas(120, 90);
  canvas.box(60, 0, 60 + thickness, 90, canvas.kBlack)
      .box(60, 45 - hole / 2, 60 + thickness, 45 - hole / 2 + hole, canvas.kWhite);
  return canvas.disc(20, 30, 4, canvas.kGreen).disc(100, 60, 4, canvas.kRed);
}

/// Corridors of `corridor` pixels up and down between walls of 3, a dot at each end.
Canvas serpentine(int corridor)
{
  constexpr int kWall = 3, kCorridors = 6;
  const int pitch = corridor + kWall, height = 8 * corridor;
  Canvas canvas(kCorridors * pitch - kWall, height);
  for (int k = 1; k < kCorridors; ++k)
    canvas.box(k * pitch - kWall, k % 2 ? 0 : corridor, k * pitch, k % 2 ? height - corridor : height, canvas.kBlack);
  const double half = 0.5 * corridor;
  canvas.disc(half, half, 2.5, canvas.kGreen);
  return canvas.disc((kCorridors - 1) * pitch + half, half, 2.5, canvas.kRed);
}
}  // namespace

TEST(LoadScene, ListsAllErrorsAtOnce)
{
  const std::string path = temporary("bad.yaml", "resolutoin: 0.1\nstart: [0, nan]\nwall: {stiffness: -1}\n");
  try
  {
    loadScene(path);
    FAIL() << "accepted";
  }
  catch (const phri_core::ParameterError& error)
  {
    const std::string text = error.what();
    EXPECT_EQ(error.errors().size(), 4u) << text;
    EXPECT_NE(text.find("did you mean resolution?"), std::string::npos) << text;
    EXPECT_NE(text.find("wall/stiffness = -1 N/m"), std::string::npos) << text;
    EXPECT_NE(text.find("image: missing"), std::string::npos) << text;
  }
}

TEST(LoadScene, SizeAndResolutionSayTheSame)
{
  const std::string keys = "origin: [-0.1, 0.2, 0]\n";
  const Scene a = loadScene(yaml(rooms(20), keys + "resolution: 0.0025\n"));
  const Scene b = loadScene(yaml(rooms(20), keys + "size: [0.3, 0.225]\n"));
  EXPECT_EQ(a.walls.resolution(), b.walls.resolution());
  EXPECT_EQ(a.start, b.start);
  for (int row = 0; row < 90; ++row)
    EXPECT_EQ(a.walls.cell(30, row), b.walls.cell(30, row));
}

TEST(LoadScene, ExactlyOneOfSizeAndResolution)
{
  EXPECT_NE(keyRefusal(yaml(rooms(20), "size: [0.3, 0.225]\nresolution: 0.0025\n")).find("both are given"),
            std::string::npos);
  EXPECT_NE(keyRefusal(yaml(rooms(20), "")).find("neither is given"), std::string::npos);
  const std::string aspect = keyRefusal(yaml(rooms(20), "size: [0.3, 0.3]\n"));
  EXPECT_NE(aspect.find("is 120 x 90 pixels; expected its aspect ratio, for instance [0.3, 0.225]"), std::string::npos)
      << aspect;
  EXPECT_EQ(keyRefusal(yaml(rooms(20), "size: [0.3, 0.2274]\n")), "");  // less than a pixel of 2.5 mm off
  EXPECT_NE(keyRefusal(yaml(rooms(20), "size: [0.3, 0.2276]\n")), "");
  EXPECT_NE(keyRefusal(yaml(rooms(20), "size: [0, 0.3]\n")).find("expected a number from 0.001 to 1000"),
            std::string::npos);
}

// The longer side becomes 0.3 m around the origin, start and goal are the dots; y points up.
TEST(LoadScene, APictureAloneIsAScene)
{
  const Scene scene = loadScene(alone(rooms(20)));
  constexpr double kPixel = 0.3 / 120;
  EXPECT_DOUBLE_EQ(scene.walls.resolution(), kPixel);
  EXPECT_NEAR((scene.start - Vector2d((20 - 60) * kPixel, (45 - 30) * kPixel)).norm(), 0.0, 0.25 * kPixel);
  EXPECT_NEAR((scene.goal - Vector2d((100 - 60) * kPixel, (45 - 60) * kPixel)).norm(), 0.0, 0.25 * kPixel);
  EXPECT_EQ(scene.name, "alone");
  // the red dot of 4 pixels is reached where it is painted: 4 * 2.5 mm, to the area of its pixels
  EXPECT_NEAR(scene.goal_radius, 4 * kPixel, 0.1 * kPixel);
  EXPECT_EQ(loadScene(yaml(rooms(20), "size: [0.3, 0.225]\ngoal: [0.1, 0]\n")).goal_radius, 0.006);
  EXPECT_EQ(loadScene(yaml(rooms(20), "size: [0.3, 0.225]\ngoal_radius: 0.002\n")).goal_radius, 0.002);
  EXPECT_TRUE(std::isnan(scene.turning_x));
  EXPECT_TRUE(scene.obstacles.empty());
}

// A dot is free space whatever its luma: this one, painted on a wall, makes the hole that the object starts in.
TEST(LoadScene, DotsAreNoWalls)
{
  Canvas canvas(60, 60);
  canvas.box(0, 0, 30, 60, canvas.kBlack).disc(26, 30, 8, 0x005000).disc(50, 30, 4, canvas.kRed);
  const Scene scene = loadScene(alone(canvas));  // luma 47 of 255: darkness 0.82
  EXPECT_GT(scene.clearance(scene.start), 0.0);
  EXPECT_NE(refusal(yaml(canvas.disc(26, 30, 8, 0x2f2f2f), "size: [0.3, 0.3]\nstart: [-0.02, 0]\n")).find("the start"),
            std::string::npos);
}

TEST(LoadScene, GivenEndsWinOverDots)
{
  const Scene scene = loadScene(yaml(rooms(20), "size: [0.3, 0.225]\ngoal: [0.05, 0.05]\n"));
  EXPECT_EQ(scene.goal, Vector2d(0.05, 0.05));
  EXPECT_NEAR(scene.start(0), -0.1, 1e-3);
}

// The same drawing at half the pixel size is the same scene: distances differ by less than the coarser pixel's
// diagonal.
TEST(LoadScene, AnSvgIsTheSameSceneAtAnyResolution)
{
  const std::string drawing = temporary("rooms.svg",
                                        "<svg xmlns='http://www.w3.org/2000/svg' width='300' height='200'>"
                                        "<path d='M150 0V120' stroke='black' stroke-width='8'/>"
                                        "<circle cx='60' cy='60' r='8' fill='#00c000'/><circle cx='240' cy='60' r='8' "
                                        "fill='red'/></svg>");
  const std::string keys = "image: " + drawing + "\nsize: [0.3, 0.2]\nresolution: ";
  const Scene coarse = loadScene(temporary("coarse.yaml", keys + "0.001\n"));
  const Scene fine = loadScene(temporary("fine.yaml", keys + "0.0005\n"));
  EXPECT_EQ(coarse.image.width, 300);
  EXPECT_EQ(fine.image.width, 600);
  phri_core::Random random(8);
  for (int k = 0; k < 2000; ++k)
  {
    const Vector2d x(random.uniform(-0.15, 0.15), random.uniform(-0.1, 0.1));
    EXPECT_NEAR(coarse.walls.distance(x), fine.walls.distance(x), 0.001 * std::sqrt(2.0));
  }
  EXPECT_NEAR((coarse.start - Vector2d(-0.09, 0.04)).norm(), 0.0, 1e-4);
  const std::string many = keyRefusal(temporary("many.yaml", keys + "0.00001\n"));
  EXPECT_NE(many.find("makes 30000 x 20000 pixels: expected at most 4096 x 4096"), std::string::npos) << many;
}

TEST(LoadScene, AllFreeIsAllowed)
{
  Canvas canvas(50, 50);
  EXPECT_EQ(refusal(alone(canvas.disc(10, 10, 3, canvas.kGreen).disc(40, 40, 3, canvas.kRed))), "");
}

TEST(LoadScene, RefusesWhatCannotBeCarriedThrough)
{
  const auto contains = [](const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << "\"" << text << "\" lacks \"" << part << '"';
  };
  const Canvas black(40, 30, Canvas::kBlack), white(40, 30);
  contains(refusal(alone(black)), "all of its 40 x 30 pixels are wall; the lightest has the darkness 1");
  contains(refusal(alone(white)), "has no green dot");
  contains(refusal(alone(white)), "has no red dot");
  const std::string ends = refusal(yaml(rooms(20), "size: [0.3, 0.225]\nstart: [0.005, 0.1]\ngoal: [0.3, 0]\n"));
  contains(ends, "the start (0.005, 0.1) m lies");
  contains(ends, "m inside a wall or too near to one: expected at least 0.003 m, the object's radius");
  contains(ends, "the goal (0.3, 0) m lies outside the picture: expected x from -0.15 to 0.15 m, y from -0.1125 to");
  contains(refusal(alone(rooms(0))), "no way leads from the start to the goal: walls separate them");
  contains(refusal(yaml(rooms(20), "size: [0.3, 0.225]\nstart: [-0.1, 0]\ngoal: [-0.105, 0]\n")), "nearer than 10 mm");
  contains(refusal("/nowhere/maze.png"), "no such file");
}

// The hole must be wider than the object, to the pixel, and the refusal says how wide it is.
TEST(LoadScene, APassageNarrowerThanTheObjectIsNone)
{
  const std::string keys = "resolution: 0.001\nobject_radius: ";  // the hole has 9 mm, known to half a pixel
  EXPECT_EQ(refusal(yaml(rooms(9), keys + "0.0040\n")), "");
  const std::string text = refusal(yaml(rooms(9), keys + "0.0046\n"));
  EXPECT_NE(text.find("the widest one narrows to about 0.0087"), std::string::npos) << text;
  EXPECT_NE(text.find("expected more than 0.0092 m"), std::string::npos) << text;
}

// Oracle: for every radius, flood the pixels that are farther than it from a wall, and see whether the goal gets wet.
TEST(WidestPassage, EqualsFloodingForEveryRadius)
{
  constexpr int kSide = 40;
  phri_core::Random random(12);
  int passable = 0, blocked = 0;
  for (int k = 0; k < 60; ++k)
  {
    GrayImage image{ kSide, kSide, std::vector<std::uint8_t>(kSide * kSide, 255) };
    for (int n = 0; n < 45; ++n)
      image.pixels[std::size_t(random.uniform() * kSide * kSide)] = 0;
    const DistanceField field(image, 1.0, Vector2d(0, 0), 0.5);
    const Vector2d from(3.5, 3.5), to(36.5, 36.5);
    for (const double radius : { 0.3, 0.5, 0.9, 1.0, 1.5, 1.9, 2.4, 3.1 })
    {
      std::vector<char> wet(field.width() * field.height(), 0);
      std::vector<int> open{ 4 * field.width() + 4 };
      const auto free = [&](int at) { return field.cell(at % field.width(), at / field.width()) > radius; };

      if (!free(open[0]))
        continue;
      wet[open[0]] = 1;
      while (!open.empty())
      {
        const int at = open.back();
        open.pop_back();
        for (const int next : { at - 1, at + 1, at - field.width(), at + field.width() })
          if (!wet[next] && free(next))
          {
            wet[next] = 1;
            open.push_back(next);
          }
      }
      const int goal = 37 * field.width() + 37;
      if (!free(goal))
        continue;
      const Passage passage = widestPassage(field, from, to, radius);
      EXPECT_EQ(passage.fits, wet[goal] != 0) << k << ' ' << radius;
      EXPECT_EQ(passage.width > 2.0 * radius, passage.fits) << k << ' ' << radius << ' ' << passage.width;
      ++(passage.fits ? passable : blocked);
    }
  }
  EXPECT_GT(passable, 50);
  EXPECT_GT(blocked, 20);
}

// Passages that a grid of 2 mm does not see (free for the object's centre: 1.5 mm) are found on finer ones, and
// rounding the corners keeps off the walls.
TEST(PlanRoute, KeepsOffTheWallsOfNarrowPassages)
{
  for (const int corridor : { 30, 40, 60, 120 })  // pixels of 0.25 mm: 7.5 mm to 30 mm for an object of 6 mm
  {
    const Scene scene = loadScene(yaml(serpentine(corridor), "resolution: 0.00025\n"));
    const Route route = planRoute(scene, 0.012);
    const double widest = 0.5 * 0.00025 * corridor - scene.object_radius;
    EXPECT_GT(*std::min_element(route.clearance.begin(), route.clearance.end()), 0.2 * widest) << corridor;
    EXPECT_LT((route.points.back() - scene.goal).norm(), 1.5 * route.step);
    EXPECT_GT(route.length(), 5 * 6 * 0.00025 * corridor) << "not through all corridors";
  }
}

// An object smaller than the grid does not slip through walls thinner than it.
TEST(PlanRoute, DoesNotJumpThinWalls)
{
  const Scene scene = loadScene(yaml(serpentine(30), "resolution: 0.0001\nobject_radius: 0.0001\n"));
  const Route route = planRoute(scene, 0.0005);
  for (std::size_t k = 1; k < route.points.size(); ++k)
    for (int i = 0; i <= 20; ++i)
      EXPECT_GT(scene.walls.distance(route.points[k - 1] + (route.points[k] - route.points[k - 1]) * (i / 20.0)), 0.0);
}

TEST(ShippedScenes, CanBePlanned)
{
  constexpr double kRoom = 0.005;  // [m] between rim and wall that simulated people manage with ease
  for (const char* name : { "maze", "spiral", "handdrawn.jpg" })
  {
    const Scene scene = loadScene(name);
    const Route route = planRoute(scene, 0.012);
    EXPECT_GT(*std::min_element(route.clearance.begin(), route.clearance.end()), kRoom) << name;
    EXPECT_GT(route.length(), 0.5) << name;
  }
  // the centres of the painted dots, to less than a pixel of 0.3 mm and the hand that painted them
  const Scene scene = loadScene("handdrawn.jpg");
  EXPECT_NEAR((scene.start - Vector2d((150 - 500) * 3e-4, (380 - 140) * 3e-4)).norm(), 0.0, 5e-4);
  EXPECT_NEAR((scene.goal - Vector2d((860 - 500) * 3e-4, (380 - 130) * 3e-4)).norm(), 0.0, 5e-4);
}
