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

/// The farthest prediction of a state.
Eigen::VectorXd farthest(EmergingPartner* partner)
{
  const auto prediction = partner->predict(kHorizon, kHorizon);
  return prediction ? prediction->desired_state.back().mean : Eigen::VectorXd();
}

TEST(EmergingLearning, newKnowledgeIsBlendedIn)
{
  // of what knowledge adopted at a sample changes in the forecast at that sample, 1 / (b + 1) comes at once; b = blend
  constexpr int kBlend = 4, kEvery = 20;  // [samples]
  constexpr double kRounding = 1e-9;      // [m]
  constexpr double kSomething = 1e-3;     // [m] that knowledge of more repetitions says otherwise
  EmergingOptions plain = options(), blended = options();
  plain.blend = 0;
  blended.blend = kBlend;
  Taught teacher(options());
  const Drawing drawing = flower(7, 6);
  const Eigen::Index count = drawing.samples.rows(), from = count * 2 / 3;
  std::shared_ptr<const LearnedPrimitives> less, more;
  for (Eigen::Index t = 0; t < count; ++t)
  {
    teacher.see(static_cast<double>(t) * kSampling, drawing.samples.row(t));
    (t < from ? less : more) = teacher.learner.snapshot();
  }
  EmergingPartner partners[2] = { EmergingPartner(plain), EmergingPartner(blended) };
  for (EmergingPartner& partner : partners)
    partner.adopt(less);
  int adopted = 0, since = 0, primitive = -1;
  double largest = 0.0;
  for (Eigen::Index t = from; t < count; ++t)
  {
    for (EmergingPartner& partner : partners)
      partner.observe(observation(static_cast<double>(t) * kSampling, drawing.samples.row(t)));
    since = partners[0].primitive() == primitive ? since + 1 : 0;
    primitive = partners[0].primitive();
    if ((t - from) % kEvery != kEvery - 1)
      continue;
    const bool comparable = primitive >= 0 && since > kBlend;  // what faded before has faded
    ++adopted;
    std::optional<phri_core::Prediction> before[2], after[2];
    for (std::size_t i = 0; i < 2; ++i)
    {
      before[i] = partners[i].predict(kHorizon, kSampling);
      partners[i].adopt(adopted % 2 == 1 ? more : less);
      after[i] = partners[i].predict(kHorizon, kSampling);
    }
    primitive = partners[0].primitive();
    since = 0;
    for (std::size_t k = 0; comparable && after[0] && k < after[0]->desired_state.size(); ++k)
    {
      const auto jump = [&](std::size_t i) -> Eigen::VectorXd {
        return after[i]->desired_state[k].mean - before[i]->desired_state[k].mean;
      };
      EXPECT_LT((jump(0) / (kBlend + 1) - jump(1)).norm(), kRounding) << t;
      largest = std::max(largest, jump(0).head(2).norm());
    }
  }
  EXPECT_GT(largest, kSomething);
}

TEST(EmergingLearning, aForecastReachesItsHorizonBetweenSamplesToo)
{
  // half a sampling time after a sample the farthest point lies beyond a horizon from that sample. It is the one that a
  // partner with a longer horizon sees there; and when the primitive changes, what fades (see aChangeOfPrimitiveIs-
  // Blended) is the difference to the earlier forecast, continued in a straight line.
  constexpr int kBlend = 4;
  constexpr double kRounding = 1e-9;  // [m]
  EmergingOptions o[3] = { options(), options(), options() };
  o[0].blend = o[1].blend = 0;
  o[1].horizon += 0.1;
  o[2].blend = kBlend;
  Taught learner(options());
  const Drawing drawing = flower(7, 6);
  for (Eigen::Index t = 0; t < drawing.samples.rows() / 2; ++t)
    learner.see(static_cast<double>(t) * kSampling, drawing.samples.row(t));
  EmergingPartner partners[3] = { EmergingPartner(o[0]), EmergingPartner(o[1]), EmergingPartner(o[2]) };
  for (EmergingPartner& partner : partners)
    partner.adopt(learner.learner.snapshot());
  Eigen::VectorXd earlier_at, earlier_between;
  int changes = 0, since = 0, primitive = -1;
  for (Eigen::Index t = drawing.samples.rows() / 2; t < drawing.samples.rows(); ++t)
  {
    const double time = static_cast<double>(t) * kSampling;
    Eigen::VectorXd at[3], between[3];
    for (std::size_t i = 0; i < 3; ++i)
    {
      partners[i].observe(observation(time, drawing.samples.row(t)));
      at[i] = farthest(&partners[i]);
      partners[i].observe(observation(time + 0.5 * kSampling, drawing.samples.row(t)));
      between[i] = farthest(&partners[i]);
    }
    const int now = partners[0].primitive();
    if (now >= 0)
    {
      EXPECT_LT((between[0] - between[1]).norm(), kRounding) << t;
    }
    if (now >= 0 && primitive >= 0 && now != primitive && since > kBlend)
    {
      const Eigen::VectorXd earlier = 3.0 * earlier_between - 2.0 * earlier_at;  // a whole sampling time farther
      EXPECT_LT((between[2] - between[0] - kBlend / (kBlend + 1.0) * (earlier - between[0])).norm(), kRounding) << t;
      ++changes;
    }
    since = now != primitive ? 0 : since + 1;
    primitive = now;
    earlier_at = at[2];
    earlier_between = between[2];
  }
  EXPECT_GT(changes, 5);
}
}  // namespace
}  // namespace phri_learning
