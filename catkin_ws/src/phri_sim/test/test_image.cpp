#include <gtest/gtest.h>

#include "phri_core/random.hpp"
#include "phri_sim/image.hpp"
#include "pictures.hpp"

using namespace phri_sim;
using pictures::Canvas;
using pictures::temporary;

namespace
{
std::string refusal(const std::string& path)
{
  return pictures::refusal<PictureError>([&] { readPicture(path); });
}

Picture picture(const Canvas& canvas)
{
  return readPicture(temporary("canvas.ppm", canvas.ppm()));
}

/// readPicture's `contrast` of a mask.
std::vector<std::uint8_t> mask(int width, int height, const std::string& cells)
{
  std::vector<std::uint8_t> out;
  for (const char cell : cells)
    out.push_back(cell == '#' ? 255 : 0);
  EXPECT_EQ(out.size(), std::size_t(width) * height);
  return out;
}
}  // namespace

TEST(ReadImage, TheTwoPgmFormsAreTheSamePicture)
{
  const std::string text = temporary("ascii.pgm", "P2\n# made by hand\n3 2\n10\n0 5 10\n10 0 0\n");
  const std::string binary = temporary("binary.pgm", std::string("P5 3 2 10\n") + std::string("\0\5\12\12\0\0", 6));
  const GrayImage a = readImage(text), b = readImage(binary);
  EXPECT_EQ(a.pixels, b.pixels);
  EXPECT_EQ(a.pixels, (std::vector<std::uint8_t>{ 0, 127, 255, 255, 0, 0 }));
}

// 16 bits keep their upper 8; samples are big-endian, as the format says.
TEST(ReadImage, SixteenBitsArePartOfPgm)
{
  const std::string path =
      temporary("deep.pgm", std::string("P5 2 2 65535\n") + std::string("\0\0\x7f\xff\xff\xff\x80\0", 8));
  EXPECT_EQ(readImage(path).pixels, (std::vector<std::uint8_t>{ 0, 127, 255, 128 }));
}

// Every grey comes out as it went in; the primaries as the formula in the header says.
TEST(ReadImage, LumaOfGreysAndPrimaries)
{
  Canvas canvas(16, 17);
  for (std::uint32_t v = 0; v < 256; ++v)
    canvas.pixels[v] = v << 16 | v << 8 | v;
  const Canvas::Color primaries[] = { 0xff0000, 0x00ff00, 0x0000ff, 0xffff00 };
  std::copy(std::begin(primaries), std::end(primaries), canvas.pixels.begin() + 256);
  const GrayImage image = picture(canvas).image;
  for (int v = 0; v < 256; ++v)
    EXPECT_EQ(image.pixels[v], v);
  EXPECT_EQ(image.pixels[256], 76);   // 0.299 * 255 = 76.2
  EXPECT_EQ(image.pixels[257], 150);  // 0.587 * 255 = 149.7
  EXPECT_EQ(image.pixels[258], 29);   // 0.114 * 255 = 29.1
  EXPECT_EQ(image.pixels[259], 226);  // 0.886 * 255 = 225.9
}

// A drawing of 30 x 20 becomes what the raster asks for; where nothing is drawn it is transparent, hence white.
TEST(ReadImage, SvgIsRasterised)
{
  const std::string path = temporary("half.svg",
                                     "<svg xmlns='http://www.w3.org/2000/svg' width='30' height='20'>"
                                     "<rect width='15' height='20'/></svg>");
  const GrayImage longer = readPicture(path, { 60, 0 }).image, exact = readPicture(path, { 90, 60 }).image;
  EXPECT_EQ(longer.width, 60);
  EXPECT_EQ(longer.height, 40);
  EXPECT_EQ(exact.height, 60);
  EXPECT_EQ(longer.pixels[29], 0);
  EXPECT_EQ(longer.pixels[30], 255);
  const std::string text = pictures::refusal<PictureError>([&] { readPicture(path, { 60, 60 }); });
  EXPECT_NE(text.find("30 x 20 pixels, the size asks for 60 x 60 pixels: expected the same aspect"), std::string::npos)
      << text;
}

TEST(ReadImage, RefusesWhatIsNoPictureNamingFileCauseAndLimit)
{
  const std::string folder = std::filesystem::temp_directory_path().string();
  EXPECT_NE(refusal("/nowhere/maze.png").find("/nowhere/maze.png: no such file"), std::string::npos);
  EXPECT_NE(refusal(folder).find(folder + ": is a directory"), std::string::npos);
  EXPECT_NE(refusal("/dev/zero").find("is no ordinary file"), std::string::npos);
  EXPECT_NE(refusal(temporary("empty.png", "")).find("is empty (0 bytes)"), std::string::npos);
  EXPECT_NE(refusal(temporary("text.png", "hello")).find("first bytes are of no picture"), std::string::npos);
  EXPECT_NE(refusal(temporary("short.pgm", "P5 8 8 255\n123")).find("of 8 rows"), std::string::npos);
  const std::string one = refusal(temporary("one.pgm", "P5 1 1 255\n1"));
  EXPECT_NE(one.find("1 x 1 pixels: expected 2 x 2 to 4096 x 4096"), std::string::npos) << one;
  const std::string huge = refusal(temporary("huge.pgm", "P5 30000 30000 255\n"));
  EXPECT_NE(huge.find("30000 x 30000 pixels: expected 2 x 2 to 4096 x 4096"), std::string::npos) << huge;
  const std::string flat =
      refusal(temporary("flat.svg", "<svg xmlns='http://www.w3.org/2000/svg' width='1e6' height='1'/>"));
  EXPECT_NE(flat.find("600 x 1 pixels: expected 2 x 2"), std::string::npos) << flat;
  // the text of a path is never run: it reaches the decoder as one argument
  EXPECT_NE(refusal("/nowhere/$(touch x); -h.png").find("no such file"), std::string::npos);
}

// The centroid of a drawn disc is its centre, to the pixels that its rim is made of.
TEST(Dots, AreFoundWhereTheyAreDrawn)
{
  constexpr double kPixelated = 0.25;  // [pixel] rim pixels are in or out: a disc on a grid is not symmetric
  phri_core::Random random(2);
  for (int k = 0; k < 20; ++k)
  {
    const double x = random.uniform(10, 30), y = random.uniform(10, 50), u = random.uniform(50, 70),
                 v = random.uniform(10, 50);
    const Picture found = picture(Canvas(80, 60).disc(x, y, 5.6, Canvas::kGreen).disc(u, v, 5.6, Canvas::kRed));
    ASSERT_TRUE(found.green.found && found.red.found);
    EXPECT_NEAR((found.green.center - Eigen::Vector2d(x, y)).norm(), 0.0, kPixelated);
    EXPECT_NEAR((found.red.center - Eigen::Vector2d(u, v)).norm(), 0.0, kPixelated);
  }
}

TEST(Dots, MissingOrAmbiguousOnesSayWhatToPaint)
{
  const Picture plain = picture(Canvas(40, 40));
  EXPECT_FALSE(plain.green.found);
  EXPECT_NE(plain.green.fault.find("has no green dot: expected one filled green dot where the object starts"),
            std::string::npos);
  const Picture two = picture(Canvas(40, 40).disc(8, 8, 4, Canvas::kRed).disc(30, 30, 4, Canvas::kRed));
  EXPECT_NE(two.red.fault.find("more than one red dot"), std::string::npos) << two.red.fault;
  // a speck beside a dot is no second one
  EXPECT_TRUE(picture(Canvas(40, 40).disc(8, 8, 4, Canvas::kRed).disc(30, 30, 2, Canvas::kRed)).red.found);
}

TEST(Dots, LinesAndRingsAreNoDots)
{
  EXPECT_FALSE(findDot(mask(8, 2, "########........"), 8, 2, "red", "").found);
  const std::string ring =
      "########"
      "#......#"
      "#......#"
      "#......#"
      "#......#"
      "#......#"
      "#......#"
      "########";
  EXPECT_FALSE(findDot(mask(8, 8, ring), 8, 8, "red", "").found);      // 28 of 64
  EXPECT_FALSE(findDot(mask(3, 2, "###..."), 3, 2, "red", "").found);  // 3 pixels
  EXPECT_TRUE(findDot(mask(3, 2, "##.##."), 3, 2, "red", "").found);
  EXPECT_FALSE(findDot({}, 3, 2, "red", "").found);  // a grey picture
}

// What a dot holds is free space: a letter painted in it, and the rim where JPEG has washed the colour out.
TEST(Dots, HoldTheirLettersAndTheirRim)
{
  constexpr int kSide = 21;
  std::vector<std::uint8_t> contrast(kSide * kSide, 0);
  std::vector<std::uint32_t> expected;
  for (int row = 0; row < kSide; ++row)
    for (int column = 0; column < kSide; ++column)
    {
      const double r = std::hypot(column - 10, row - 10);
      const bool letter = column == 10 && std::abs(row - 10) < 4;
      contrast[row * kSide + column] = letter ? 0 : r <= 6 ? 150 : r <= 7 ? 30 : r <= 9 ? 10 : 0;
      if (r <= 7)
        expected.push_back(row * kSide + column);
    }
  Dot dot = findDot(contrast, kSide, kSide, "green", "");
  ASSERT_TRUE(dot.found);
  std::sort(dot.pixels.begin(), dot.pixels.end());
  EXPECT_EQ(dot.pixels, expected);
}
