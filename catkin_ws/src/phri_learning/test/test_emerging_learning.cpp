// Theorems of the emerging partner's learning: apart from its predictions, complete, kept in files; and bad input.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <thread>

#include "fixtures.hpp"
#include "flower.hpp"

namespace phri_learning
{
namespace
{
using testing::Drawing;
using testing::flower;
using testing::kHorizon;
using testing::kSampling;
using testing::kStep;
using testing::observation;
using testing::options;
using testing::Taught;

TEST(EmergingLearning, learningBesideItLosesNothing)
{
  // segments do not depend on what is known, so a partner whose learner runs in a thread of its own, and is adopted
  // whenever it happens to be ready, ends with the same library as one in lockstep
  const Drawing drawing = flower(8, 6);
  Taught lockstep(options());
  EmergingPartner partner(options());
  PrimitiveLearner learner(options());
  std::vector<CommittedSegment> batch;
  std::shared_ptr<const LearnedPrimitives> ready;
  std::thread thread;
  for (Eigen::Index t = 0; t < drawing.samples.rows(); ++t)
  {
    const double time = static_cast<double>(t) * kSampling;
    lockstep.see(time, drawing.samples.row(t));
    partner.observe(observation(time, drawing.samples.row(t)));
    partner.predict(kHorizon, kStep);
    if (t % 100 != 99)
      continue;
    if (thread.joinable())
    {
      thread.join();
      if (ready)
        partner.adopt(ready);
    }
    batch = partner.takeSegments();
    thread = std::thread([&] {
      for (const CommittedSegment& segment : batch)
        ready = learner.add(segment);
    });
  }
  thread.join();
  partner.adopt(ready);
  learn(&partner, &learner);
  EXPECT_GE(partner.primitive(), 0) << "recognition looks back at what was observed before";
  EXPECT_EQ(partner.primitive(), lockstep.partner.primitive());
  EXPECT_EQ(partner.lostSegments(), 0);
  const PrimitiveLibrary &a = partner.learned()->library, &b = lockstep.partner.learned()->library;
  ASSERT_EQ(a.segmentCount(), b.segmentCount());
  ASSERT_EQ(a.nodeIds(), b.nodeIds());
  for (int segment = 0; segment < a.segmentCount(); ++segment)
    EXPECT_EQ(a.path(segment), b.path(segment));
}

TEST(EmergingLearning, fasterObservationsAreResampled)
{
  // 100 Hz, of which every fifth is a sample: nothing else may matter
  const Drawing drawing = flower(9, 2);
  EmergingOptions roomy = options();
  roomy.queue = 100;
  EmergingPartner slow(roomy), fast(roomy);
  for (Eigen::Index t = 0; t < drawing.samples.rows(); ++t)
  {
    slow.observe(observation(static_cast<double>(t) * kSampling, drawing.samples.row(t)));
    for (int k = t == 0 ? 0 : 1; k <= 4 && t > 0; ++k)
    {
      const double share = k / 5.0;
      fast.observe(observation((static_cast<double>(t) - 1.0 + share) * kSampling,
                               (1.0 - share) * drawing.samples.row(t - 1) + share * drawing.samples.row(t)));
    }
    fast.observe(observation(static_cast<double>(t) * kSampling, drawing.samples.row(t)));
  }
  slow.reset();
  fast.reset();
  const auto a = slow.takeSegments(), b = fast.takeSegments();
  ASSERT_EQ(a.size(), b.size());
  ASSERT_GT(a.size(), 10u);
  constexpr double kRounding = 1e-9;  // of interpolating at times that are multiples of 0.05 but for rounding
  Eigen::Index samples = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
  {
    ASSERT_EQ(a[i].samples.rows(), b[i].samples.rows());
    EXPECT_LT((a[i].samples - b[i].samples).cwiseAbs().maxCoeff(), kRounding * 100.0);
    EXPECT_NEAR(a[i].begin, b[i].begin, kRounding);
    EXPECT_EQ(a[i].follows, i > 0);
    EXPECT_EQ(a[i].samples, drawing.samples.middleRows(samples, a[i].samples.rows()));
    samples += a[i].samples.rows();
  }
  EXPECT_EQ(samples, drawing.samples.rows()) << "the segments are the series, whole and in order";
}

TEST(EmergingLearning, samplesLieOnTheLineBetweenObservations)
{
  // linear interpolation is exact for motion at constant velocity, whenever it is observed
  constexpr double kObserved = 0.031, kStart = 2.5, kRounding = 1e-12;  // [s], [s], [m]
  Eigen::RowVectorXd velocity(6);
  velocity << 0.1, -0.2, 0.3, 0.05, 1.0, -2.0;
  EmergingPartner partner(options());
  for (int k = 0; k < 100; ++k)
    partner.observe(observation(kStart + k * kObserved, k * kObserved * velocity));
  partner.reset();
  int samples = 0;
  for (const CommittedSegment& segment : partner.takeSegments())
  {
    EXPECT_NEAR(segment.begin, kStart + samples * kSampling, kRounding * 10.0);
    for (Eigen::Index t = 0; t < segment.samples.rows(); ++t, ++samples)
      EXPECT_LT((segment.samples.row(t) - samples * kSampling * velocity).norm(), kRounding * 100.0) << samples;
  }
  EXPECT_EQ(samples, 62) << "99 * 0.031 s / 0.05 s = 61.4";
}

TEST(EmergingLearning, savedKnowledgePredictsAsBefore)
{
  for (const Reference reference : { Reference::kPath, Reference::kDisplacement })
  {
    const Drawing drawing = flower(10, 5);
    Taught taught(options(reference));
    for (Eigen::Index t = 0; t < drawing.samples.rows(); ++t)
      taught.see(static_cast<double>(t) * kSampling, drawing.samples.row(t));
    const auto path = std::filesystem::temp_directory_path() / ("emerging_" + std::to_string(getpid()) + ".json");
    taught.learner.save(path);
    const PrimitiveLearner loaded = PrimitiveLearner::load(options(reference), path);
    std::filesystem::remove(path);
    EmergingPartner one(options(reference)), other(options(reference));
    one.adopt(taught.learner.snapshot());
    other.adopt(loaded.snapshot());
    int predicted = 0;
    for (Eigen::Index t = 0; t < 200; ++t)
    {
      const auto o = observation(static_cast<double>(t) * kSampling, drawing.samples.row(t));
      one.observe(o);
      other.observe(o);
      const auto a = one.predict(kHorizon, kStep), b = other.predict(kHorizon, kStep);
      ASSERT_EQ(a.has_value(), b.has_value());
      if (a)
      {
        ++predicted;
        ASSERT_EQ(a->desired_state.back().mean, b->desired_state.back().mean);
      }
    }
    EXPECT_GT(predicted, 150);
  }
}

TEST(EmergingLearning, refusesBadInputAndStaysAsItWas)
{
  EmergingPartner one(options()), other(options());
  const Drawing drawing = flower(11, 1);
  const auto at = [&](Eigen::Index t) {
    return observation(static_cast<double>(t) * kSampling, drawing.samples.row(t));
  };
  for (Eigen::Index t = 0; t < drawing.samples.rows(); ++t)
  {
    one.observe(at(t));
    other.observe(at(t));
    auto bad = at(std::min(t + 1, drawing.samples.rows() - 1));
    bad.state(1) = NAN;
    EXPECT_THROW(one.observe(bad), std::invalid_argument);
    EXPECT_THROW(one.observe(at(t)), std::invalid_argument) << "not later";
    bad = at(t);
    bad.human_wrench = Eigen::VectorXd::Zero(1);
    EXPECT_THROW(one.observe(bad), std::invalid_argument);
  }
  one.reset();
  other.reset();
  const auto a = one.takeSegments(), b = other.takeSegments();
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i)
    EXPECT_EQ(a[i].samples, b[i].samples);
  EXPECT_THROW(one.predict(0.31, kStep), std::invalid_argument);
  EXPECT_THROW(one.predict(kHorizon, 0.0), std::invalid_argument);
  EXPECT_THROW(one.adopt(nullptr), std::invalid_argument);
  EXPECT_THROW(one.adopt(PrimitiveLearner(options(Reference::kDisplacement)).snapshot()), std::invalid_argument);
  for (const auto& spoil : std::vector<void (*)(EmergingOptions*)>{
           [](EmergingOptions* o) { o->dof = 0; }, [](EmergingOptions* o) { o->window_states = 7; },
           [](EmergingOptions* o) { o->horizon = 0.0; }, [](EmergingOptions* o) { o->shortest = 5; },
           [](EmergingOptions* o) { o->recogniser.window = 0; }, [](EmergingOptions* o) { o->segmentation.window = 1; },
           [](EmergingOptions* o) { o->primitives.members = 1; } })
  {
    EmergingOptions o;
    spoil(&o);
    EXPECT_THROW(EmergingPartner{ o }, std::invalid_argument);
    EXPECT_THROW(PrimitiveLearner{ o }, std::invalid_argument);
  }
}

TEST(EmergingLearning, segmentsThatNobodyTakesAreLostOldestFirstAndCounted)
{
  EmergingOptions small = options();
  small.queue = 4;
  EmergingPartner limited(small), roomy(options());
  const Drawing drawing = flower(12, 1);
  for (Eigen::Index t = 0; t < drawing.samples.rows(); ++t)
    for (EmergingPartner* partner : { &limited, &roomy })
      partner->observe(observation(static_cast<double>(t) * kSampling, drawing.samples.row(t)));
  limited.reset();
  roomy.reset();
  const auto all = roomy.takeSegments(), kept = limited.takeSegments();
  ASSERT_GT(all.size(), 6u);
  ASSERT_EQ(kept.size(), 4u);
  EXPECT_EQ(limited.lostSegments(), static_cast<int>(all.size()) - 4);
  EXPECT_FALSE(kept[0].follows) << "what it followed was lost";
  for (std::size_t i = 0; i < 4; ++i)
    EXPECT_EQ(kept[i].samples, all[all.size() - 4 + i].samples);
}
TEST(EmergingLearning, aWindowHoldsTheNeighboursInTheirOrderAndTime)
{
  const TimeHmm before(testing::randomModel(1, 6, 1, 2)), own(testing::randomModel(2, 5, 1, 2)),
      after(testing::randomModel(3, 7, 1, 2));
  const PrimitiveWindow all = primitiveWindow(&before, own, &after, 8);
  ASSERT_EQ(all.hmm->states(), 4 + 5 + 4);
  EXPECT_EQ(all.before, 4);
  EXPECT_EQ(all.begin, before.length());
  const Eigen::MatrixXd& mean = all.hmm->parameters().mean_s;
  EXPECT_EQ(mean.topRows(4), before.parameters().mean_s.bottomRows(4));
  EXPECT_EQ(mean.middleRows(4, 5), own.parameters().mean_s);
  EXPECT_EQ(mean.bottomRows(4), after.parameters().mean_s.topRows(4));
  constexpr double kRounding = 1e-12;  // of sums of times
  for (int i = 0; i < 5; ++i)
    EXPECT_NEAR(all.hmm->stateTime(4 + i), all.begin + own.stateTime(i), kRounding);
  for (int i = 0; i < 4; ++i)
    EXPECT_NEAR(all.hmm->stateTime(9 + i), all.begin + own.length() + after.stateTime(i), kRounding);
  const PrimitiveWindow alone = primitiveWindow(nullptr, own, nullptr, 8);
  EXPECT_EQ(alone.hmm->states(), 5);
  EXPECT_EQ(alone.begin, 0.0);
  EXPECT_EQ(alone.hmm->parameters().mean_t, own.parameters().mean_t);
  EXPECT_THROW(primitiveWindow(nullptr, own, nullptr, 7), std::invalid_argument);
}
}  // namespace
}  // namespace phri_learning
