#include "phri_learning/model_file.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>

#include "fixtures.hpp"

namespace phri_learning
{
namespace
{
class ModelFile : public ::testing::Test
{
protected:
  ModelFile() : folder_(std::filesystem::temp_directory_path() / ("model_file_" + std::to_string(getpid())))
  {
    std::filesystem::create_directories(folder_);
  }
  ~ModelFile() override { std::filesystem::remove_all(folder_); }

  std::string path(const std::string& name = "model.json") const { return (folder_ / name).string(); }
  static std::string read(const std::string& file)
  {
    std::ifstream stream(file, std::ios::binary);
    std::ostringstream text;
    text << stream.rdbuf();
    return text.str();
  }
  static void write(const std::string& file, const std::string& text) { std::ofstream(file, std::ios::binary) << text; }
  /// The cause of the refusal, or "" if the file loads.
  static std::string cause(const std::string& file, int dimension = 0)
  {
    try
    {
      loadTimeHmm(file, dimension);
    }
    catch (const ModelFileError& error)
    {
      EXPECT_NE(std::string(error.what()).find(file), std::string::npos);
      EXPECT_FALSE(error.expected.empty() || error.found.empty());
      return error.cause;
    }
    return "";
  }
  static std::string replaced(std::string text, const std::string& what, const std::string& with)
  {
    const std::size_t at = text.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    return text.replace(at, what.size(), with);
  }

  std::filesystem::path folder_;
};

bool sameBits(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b)
{
  return a.rows() == b.rows() && a.cols() == b.cols() &&
         std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<std::size_t>(a.size())) == 0;
}

bool sameBits(const TimeHmm& a, const TimeHmm& b)
{
  const TimeHmmParameters &p = a.parameters(), &q = b.parameters();
  bool same = a.formulas() == b.formulas() && p.dt == q.dt && p.covariance_floor == q.covariance_floor &&
              p.pace_variance == q.pace_variance && p.repeat_variance == q.repeat_variance &&
              sameBits(p.transition, q.transition) && sameBits(p.initial, q.initial) &&
              sameBits(p.weights, q.weights) && sameBits(p.mean_s, q.mean_s) && sameBits(p.mean_t, q.mean_t) &&
              sameBits(p.tt, q.tt) && sameBits(p.ts, q.ts) && sameBits(p.between_tt, q.between_tt) &&
              sameBits(p.scale, q.scale) && sameBits(p.memory, q.memory) && p.ss.size() == q.ss.size();
  for (std::size_t c = 0; same && c < p.ss.size(); ++c)
    same = sameBits(p.ss[c], q.ss[c]);
  return same;
}

TEST_F(ModelFile, comesBackBitByBit)
{
  for (std::uint64_t seed = 1; seed <= 20; ++seed)
  {
    TimeHmmParameters p = testing::randomModel(seed, 4, 2, 3);
    p.mean_s(0, 0) = 0.1 + 0.2;  // 17 digits
    p.mean_s(1, 1) = -0.0;
    p.mean_s(2, 2) = std::numeric_limits<double>::denorm_min();
    p.mean_s(3, 0) = 1e300 / 3.0;
    const TimeHmm model(p, seed % 2 ? Formulas::kThesis : Formulas::kCorrected);
    saveTimeHmm(model, path());
    EXPECT_TRUE(sameBits(loadTimeHmm(path()), model));
  }
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 1);  // no temporary file is left
}

TEST_F(ModelFile, isRefusedWhenTruncatedAnywhere)
{
  saveTimeHmm(TimeHmm(testing::randomModel(1, 3, 1, 2)), path());
  const std::string text = read(path());
  for (std::size_t length = 0; length + 2 < text.size(); length += 7)  // the last bytes are "}" and a line end
  {
    write(path("cut.json"), text.substr(0, length));
    EXPECT_EQ(cause(path("cut.json")), "no JSON, or truncated") << "cut at byte " << length;
  }
}

TEST_F(ModelFile, isRefusedOrUnchangedAfterAnyFlippedBit)
{
  const TimeHmm model(testing::randomModel(2, 2, 1, 1));
  saveTimeHmm(model, path());
  const std::string text = read(path());
  int refused = 0;
  for (std::size_t byte = 0; byte < text.size(); ++byte)
    for (int bit = 0; bit < 8; ++bit)
    {
      std::string flipped = text;
      flipped[byte] = static_cast<char>(flipped[byte] ^ (1 << bit));
      write(path("flip.json"), flipped);
      if (cause(path("flip.json")).empty())
        EXPECT_TRUE(sameBits(loadTimeHmm(path("flip.json")), model)) << "byte " << byte << " bit " << bit;
      else
        ++refused;
    }
  EXPECT_GT(refused, static_cast<int>(text.size()) * 6);  // the rest are white space and the e of exponents
}

TEST_F(ModelFile, namesTheChecksumWhenANumberChanges)
{
  TimeHmmParameters p = testing::randomModel(3, 2, 1, 1);
  p.mean_t(0) = 0.046875;
  saveTimeHmm(TimeHmm(p), path());
  write(path(), replaced(read(path()), "0.046875", "0.046876"));
  EXPECT_EQ(cause(path()), "sha256");
}

TEST_F(ModelFile, isRefusedByItsContents)
{
  saveTimeHmm(TimeHmm(testing::randomModel(4, 2, 1, 3)), path());
  const std::string text = read(path());
  EXPECT_EQ(cause(path(), 3), "");
  EXPECT_EQ(cause(path(), 6), "dimension");
  write(path("a.json"), replaced(text, "phri_learning/TimeHmm", "something else"));
  EXPECT_EQ(cause(path("a.json")), "schema");
  write(path("a.json"), replaced(text, "\"schema_version\": 1", "\"schema_version\": 2"));
  EXPECT_EQ(cause(path("a.json")), "schema_version");
  write(path("a.json"), "[1, 2]");
  EXPECT_EQ(cause(path("a.json")), "schema");
  write(path("a.json"), "");
  EXPECT_EQ(cause(path("a.json")), "no JSON, or truncated");
  EXPECT_EQ(cause(path("absent.json")), "not readable");
  std::filesystem::copy_file(path(), path("large.json"));
  std::filesystem::resize_file(path("large.json"), (64u << 20) + 1);  // sparse: needs no disk
  EXPECT_EQ(cause(path("large.json")), "too large");
}

TEST_F(ModelFile, isRefusedByItsContentsEvenWithARightChecksum)
{
  // a writer without our checks: the message names the sum it should have had, so it can be put in
  const auto forged = [this](const std::string& text) {
    write(path("forged.json"), text);
    try
    {
      loadTimeHmm(path("forged.json"));
    }
    catch (const ModelFileError& error)
    {
      if (error.cause == "sha256")
        write(path("forged.json"), replaced(text, error.found.substr(1, 64), error.expected));
    }
    return cause(path("forged.json"));
  };
  TimeHmmParameters p = testing::randomModel(5, 2, 1, 1);
  p.tt(1) = 0.00390625;
  p.ts.setZero();
  p.ss[0](0, 0) = 1.375;
  saveTimeHmm(TimeHmm(p), path());
  const std::string text = read(path());
  EXPECT_EQ(forged(text), "");
  EXPECT_EQ(forged(replaced(text, "1.375", "-1.375")), "contents");  // not positive definite
  EXPECT_EQ(forged(replaced(text, "1.375", "null")), "field ss");    // how JSON spells NaN
  EXPECT_EQ(forged(replaced(text, "1.375", "1.375, 1.0")), "contents");
  EXPECT_EQ(forged(replaced(text, "0.00390625", "0.0")), "contents");
  EXPECT_EQ(forged(replaced(text, "0.00390625", "\"x\"")), "field tt");
  EXPECT_EQ(forged(replaced(text, "\"corrected\"", "\"other\"")), "field formulas");
  EXPECT_EQ(forged(replaced(text, "\"mean_t\"", "\"mean_x\"")), "field mean_t");
}

TEST_F(ModelFile, keepsTheOldFileWhenItCannotWrite)
{
  const TimeHmm model(testing::randomModel(6, 2, 1, 1));
  EXPECT_THROW(saveTimeHmm(model, path("no/such/folder.json")), ModelFileError);
  std::filesystem::create_directories(path("taken.json/inside"));
  EXPECT_THROW(saveTimeHmm(model, path("taken.json")), ModelFileError);  // a folder is in the way
  EXPECT_TRUE(std::filesystem::is_directory(path("taken.json")));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 1);
}
}  // namespace
}  // namespace phri_learning
