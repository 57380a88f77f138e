// Theorems of the primitive library: clusters, their independence of the order, distances, files, merging.
#include "phri_learning/primitive_library.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "phri_core/random.hpp"
#include "phri_learning/learned_primitives.hpp"

namespace phri_learning
{
namespace
{
constexpr double kNoise = 0.01;  // [m], against shapes 0.3 m in size
constexpr int kShapes = 3, kExamples = 8;

/// Example of one of three shapes, (T, 4) = position and velocity at 20 Hz, about 2 s, with its own pace and offset.
Eigen::MatrixXd example(int shape, phri_core::Random* random)
{
  constexpr double kDt = 0.05;
  const int count = static_cast<int>(std::lround(40.0 * std::exp(0.1 * random->normal())));
  const Eigen::Vector2d offset(kNoise * random->normal(), kNoise * random->normal());
  const double size = 0.3 * (1.0 + 0.03 * random->normal());
  Eigen::MatrixXd x(count, 4);
  for (int t = 0; t < count; ++t)
  {
    const double u = static_cast<double>(t) / (count - 1);
    Eigen::Vector2d p;
    if (shape == 0)
      p << u, 0.0;
    else if (shape == 1)
      p << 0.5 * std::sin(3.14 * u), u;
    else
      p << -u, -0.5 * (1.0 - std::cos(3.14 * u));
    x.row(t).head(2) = (size * p + offset).transpose();
  }
  for (int t = 0; t < count; ++t)
  {
    const int before = std::max(t - 1, 0), after = std::min(t + 1, count - 1);
    x.row(t).tail(2) = (x.row(after).head(2) - x.row(before).head(2)) / (kDt * (after - before));
  }
  return x;
}

struct Example
{
  int shape = 0, number = 0;
  Eigen::MatrixXd samples;
};

std::vector<Example> shuffled(std::uint64_t seed, std::uint64_t order)
{
  phri_core::Random random(seed), shuffle(order);
  std::vector<Example> all;
  for (int i = 0; i < kExamples; ++i)
    for (int shape = 0; shape < kShapes; ++shape)
      all.push_back({ shape, static_cast<int>(all.size()), example(shape, &random) });
  for (std::size_t i = all.size(); i-- > 1;)
    std::swap(all[i], all[static_cast<std::size_t>(shuffle.uniform() * static_cast<double>(i + 1))]);
  return all;
}

PrimitiveOptions options()
{
  PrimitiveOptions o;
  o.training.states = 6;
  o.training.dt = 0.05;
  return o;
}

PrimitiveLibrary learned(const std::vector<Example>& examples)
{
  PrimitiveLibrary library(options());
  for (const Example& e : examples)
    library.add(e.samples);
  return library;
}

/// The upper nodes as sets of example numbers; those in no node are left out.
std::set<std::set<int>> partition(const PrimitiveLibrary& library, const std::vector<Example>& examples)
{
  std::map<int, std::set<int>> sets;
  for (std::size_t i = 0; i < examples.size(); ++i)
    if (library.primitiveOf(static_cast<int>(i)) >= 0)
      sets[library.primitiveOf(static_cast<int>(i))].insert(examples[i].number);
  std::set<std::set<int>> result;
  for (const auto& entry : sets)
    result.insert(entry.second);
  return result;
}

std::string read(const std::string& file)
{
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

class PrimitiveFile : public ::testing::Test
{
protected:
  PrimitiveFile() : folder_(std::filesystem::temp_directory_path() / ("primitives_" + std::to_string(getpid())))
  {
    std::filesystem::create_directories(folder_);
  }
  ~PrimitiveFile() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  static std::string cause(const std::string& file)
  {
    try
    {
      PrimitiveLibrary::load(file);
    }
    catch (const ModelFileError& error)
    {
      EXPECT_FALSE(error.expected.empty() || error.found.empty());
      EXPECT_EQ(error.file, file);
      return error.cause;
    }
    return "";
  }
  std::filesystem::path folder_;
};

TEST(PrimitiveLibrary, AnAxisThatMovesByRoundingOnlyDecidesNothing)
{
  // A pose solved for a constant height comes back as 1e-17 m here and 0 there. That is no shape: the partition is that
  // of the axes that move.
  const std::vector<Example> flat = shuffled(3, 1);
  std::vector<Example> examples = flat;
  for (std::size_t i = 0; i < examples.size(); ++i)
  {
    Eigen::MatrixXd& x = examples[i].samples;
    x.conservativeResize(Eigen::NoChange, 5);
    x.col(4) = (i % 2 == 0 ? 0.0 : 1e-17) * (1.0 + 0.1 * static_cast<double>(i)) * x.col(0);
  }
  EXPECT_EQ(partition(learned(examples), examples), partition(learned(flat), flat));
}

TEST(PrimitiveLibrary, ThreeShapesInAnyOrderBecomeThreePurePrimitives)
{
  // The distance within a shape is that of its noise, between shapes that of their size: one partition is right, and
  // the order of arrival cannot change it once every shape has been seen m times.
  for (std::uint64_t order = 1; order <= 6; ++order)
  {
    const std::vector<Example> examples = shuffled(3, order);
    const PrimitiveLibrary library = learned(examples);
    ASSERT_EQ(library.upperNodes().size(), static_cast<std::size_t>(kShapes)) << "order " << order;
    std::set<std::set<int>> expected;
    for (int shape = 0; shape < kShapes; ++shape)
    {
      std::set<int> numbers;
      for (int i = 0; i < kExamples; ++i)
        numbers.insert(shape + kShapes * i);
      expected.insert(numbers);
    }
    EXPECT_EQ(partition(library, examples), expected) << "order " << order;
    for (const int id : library.upperNodes())
      EXPECT_EQ(library.node(id).count, kExamples);
  }
}

TEST(PrimitiveLibrary, NothingIsAPrimitiveBeforeMExamples)
{
  phri_core::Random random(5);
  PrimitiveLibrary library(options());
  for (const int shape : { 0, 1, 2, 0, 1, 2 })
    EXPECT_EQ(library.add(example(shape, &random)), std::vector<int>{ 0 });
  EXPECT_TRUE(library.upperNodes().empty());
  EXPECT_EQ(library.add(example(1, &random)), (std::vector<int>{ 0, 1 }));
  EXPECT_EQ(library.node(1).segments.size(), 3u);
}

TEST(PrimitiveLibrary, ASingleExampleIsItsOwnModel)
{
  phri_core::Random random(7);
  const Eigen::MatrixXd only = example(1, &random);
  PrimitiveLibrary library(options());
  library.add(only);
  EXPECT_TRUE(library.models().empty());
  const auto models = library.models(true);
  ASSERT_EQ(models.size(), 1u);
  EXPECT_EQ(models[0].second, -1);
  const TimeHmm alone = train({ only }, options().training).model;
  EXPECT_EQ(models[0].first->parameters().mean_s, alone.parameters().mean_s);
  EXPECT_EQ(modelDistance(*models[0].first, alone), 0.0);
}

TEST(PrimitiveLibrary, DistancesAreZeroForEqualSymmetricAndPositiveInTheMean)
{
  phri_core::Random random(11);
  std::vector<TimeHmm> models;
  for (int i = 0; i < 9; ++i)
    models.push_back(train({ example(i % kShapes, &random) }, options().training).model);
  double sum = 0.0;
  for (std::size_t i = 0; i < models.size(); ++i)
    for (std::size_t j = 0; j < models.size(); ++j)
    {
      const double d = modelDistance(models[i], models[j]);
      EXPECT_EQ(d, modelDistance(models[j], models[i]));
      if (i == j)
      {
        EXPECT_EQ(d, 0.0);
      }
      sum += d;
    }
  EXPECT_GT(sum, 0.0);
  EXPECT_THROW(modelDistance(models[0], models[0].leading(2)), std::invalid_argument);
}

TEST(PrimitiveLibrary, DistanceOfTwoStaticGaussiansIsTheirKnownValue)
{
  // One state, equal variance v, means 0 and a, constant outputs: log P(O_2 | 2) - log P(O_2 | 1) = a^2 / (2 v) per
  // sample, and the same the other way round.
  constexpr double kRounding = 1e-9;
  const auto still = [](double mean) {
    TimeHmmParameters p;
    p.dt = 0.05;
    p.transition = p.weights = Eigen::MatrixXd::Ones(1, 1);
    p.initial = p.mean_t = p.scale = p.memory = Eigen::VectorXd::Ones(1);
    p.mean_s = Eigen::MatrixXd::Constant(1, 1, mean);
    p.ss = { Eigen::MatrixXd::Constant(1, 1, 0.3) };
    p.tt = Eigen::VectorXd::Constant(1, 0.1);
    p.between_tt = Eigen::VectorXd::Zero(1);
    p.ts = Eigen::MatrixXd::Zero(1, 1);
    return TimeHmm(p);
  };
  EXPECT_NEAR(modelDistance(still(0.0), still(1.5)), 1.5 * 1.5 / (2.0 * 0.3), kRounding);
}

TEST(PrimitiveLibrary, SuccessionsAreCountedAsTheyHappened)
{
  // 0 1 0 2 0 1 0 2 ..: 0 is followed by 1 and 2 in turn, they by 0 only.
  phri_core::Random random(13);
  PrimitiveOptions o = options();
  o.laplace = 1.0;
  PrimitiveLibrary library(o);
  const int cycle[] = { 0, 1, 0, 2 };
  for (int i = 0; i < 24; ++i)
    library.add(example(cycle[i % 4], &random));
  const PrimitiveLibrary::Successions s = library.successions();
  ASSERT_EQ(s.nodes.size(), 3u);
  const auto at = [&](int segment) {
    return std::find(s.nodes.begin(), s.nodes.end(), library.primitiveOf(segment)) - s.nodes.begin();
  };
  EXPECT_EQ(s.counts(at(0), at(1)), 6);
  EXPECT_EQ(s.counts(at(0), at(3)), 6);
  EXPECT_EQ(s.counts(at(1), at(0)), 6);
  EXPECT_EQ(s.counts(at(3), at(0)), 5);
  EXPECT_EQ(s.counts.sum(), 23);
  EXPECT_DOUBLE_EQ(s.probability(at(0), at(1)), 7.0 / 15.0);  // (6 + 1) / (12 + 3)
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(s.probability.row(i).sum(), 1.0, 1e-15);

  library.add(example(0, &random), false);  // after a pause: nothing follows anything
  EXPECT_EQ(library.successions().counts.sum(), 23);
}

TEST(PrimitiveLibrary, WhatANodeRemembersIsBounded)
{
  phri_core::Random random(17);
  PrimitiveOptions o = options();
  o.remembered = 4;
  o.waiting = 10;
  PrimitiveLibrary library(o);
  for (int i = 0; i < 45; ++i)
    library.add(example(i % kShapes, &random));
  ASSERT_EQ(library.upperNodes().size(), 3u);
  int counted = 0;
  for (const int id : library.nodeIds())
    EXPECT_LE(library.node(id).segments.size(), id == 0 ? 10u : 4u);
  for (const int id : library.upperNodes())
    counted += library.node(id).count;
  EXPECT_EQ(counted, 45);
  for (const int id : library.upperNodes())
  {
    // the latest of its branch, on which its model is trained, latest first
    std::vector<Eigen::MatrixXd> latest = memberSamples(library, id);
    ASSERT_EQ(latest.size(), 4u);
    std::reverse(latest.begin(), latest.end());
    EXPECT_EQ(library.node(id).model->hmm->parameters().mean_s, train(latest, o.training).model.parameters().mean_s);
  }
  EXPECT_EQ(library.node(0).count, 45);
}

TEST(PrimitiveLibrary, BadSegmentsChangeNothing)
{
  phri_core::Random random(19);
  PrimitiveLibrary library(options());
  library.add(example(0, &random));
  Eigen::MatrixXd bad = example(0, &random);
  bad(3, 1) = std::nan("");
  EXPECT_THROW(library.add(bad), std::invalid_argument);
  EXPECT_THROW(library.add(Eigen::MatrixXd::Zero(20, 3)), std::invalid_argument);
  EXPECT_THROW(library.add(Eigen::MatrixXd::Zero(1, 4)), std::invalid_argument);
  EXPECT_EQ(library.segmentCount(), 1);
  EXPECT_EQ(library.node(0).segments.size(), 1u);
  EXPECT_THROW(library.node(4), std::invalid_argument);
  EXPECT_THROW(library.path(1), std::invalid_argument);
  PrimitiveOptions o = options();
  o.remembered = 2;
  EXPECT_THROW(PrimitiveLibrary{ o }, std::invalid_argument);
}

TEST_F(PrimitiveFile, RoundTripIsExactAndLearningGoesOnAlike)
{
  const std::vector<Example> examples = shuffled(23, 2);
  PrimitiveLibrary library = learned(examples);
  library.save(path("a.json"));
  PrimitiveLibrary loaded = PrimitiveLibrary::load(path("a.json"));
  loaded.save(path("b.json"));
  EXPECT_EQ(read(path("a.json")), read(path("b.json")));
  EXPECT_EQ(loaded.upperNodes(), library.upperNodes());
  phri_core::Random random(29);
  for (int i = 0; i < 6; ++i)
  {
    const Eigen::MatrixXd next = example(i % kShapes, &random);
    EXPECT_EQ(library.add(next), loaded.add(next));
  }
  EXPECT_EQ(library.successions().counts, loaded.successions().counts);
}

TEST_F(PrimitiveFile, DamageIsRefusedByName)
{
  const PrimitiveLibrary library = learned(shuffled(31, 1));
  library.save(path("good.json"));
  const std::string good = read(path("good.json"));
  const auto damaged = [&](const std::string& what, const std::string& with) {
    std::string text = good;
    const std::size_t at = text.find(what);
    EXPECT_NE(at, std::string::npos);
    std::ofstream(path("bad.json"), std::ios::binary) << text.replace(at, what.size(), with);
    return cause(path("bad.json"));
  };
  EXPECT_EQ(damaged("\"count\": 8", "\"count\": 9"), "sha256");
  EXPECT_EQ(damaged("PrimitiveLibrary", "TimeHmm"), "schema");
  EXPECT_EQ(damaged("\"schema_version\": 1", "\"schema_version\": 2"), "schema_version");
  std::ofstream(path("bad.json"), std::ios::binary) << good.substr(0, good.size() / 2);
  EXPECT_EQ(cause(path("bad.json")), "no JSON, or truncated");
  EXPECT_EQ(cause(path("absent.json")), "not readable");
  EXPECT_EQ(cause(path("good.json")), "");
}

TEST(PrimitiveLibrary, MergingKeepsEverySegmentAndJoinsEqualPrimitives)
{
  const std::vector<Example> first = shuffled(37, 1), second = shuffled(41, 2);
  PrimitiveLibrary merged = learned(first);
  const PrimitiveLibrary other = learned(second);
  const int successions = merged.successions().counts.sum() + other.successions().counts.sum();
  merged.merge(other);
  EXPECT_EQ(merged.segmentCount(), 2 * kShapes * kExamples);
  EXPECT_EQ(merged.node(0).count, 2 * kShapes * kExamples);
  ASSERT_EQ(merged.upperNodes().size(), static_cast<std::size_t>(kShapes));
  for (const int id : merged.upperNodes())
    EXPECT_EQ(merged.node(id).count, 2 * kExamples);
  EXPECT_EQ(merged.successions().counts.sum(), successions);
  for (std::size_t i = 0; i < first.size(); ++i)
    for (std::size_t j = 0; j < second.size(); ++j)
      EXPECT_EQ(merged.primitiveOf(static_cast<int>(i)) == merged.primitiveOf(static_cast<int>(first.size() + j)),
                first[i].shape == second[j].shape);
  PrimitiveOptions o = options();
  o.cutoff = 0.5;
  EXPECT_THROW(merged.merge(PrimitiveLibrary(o)), std::invalid_argument);
}
}  // namespace
}  // namespace phri_learning
