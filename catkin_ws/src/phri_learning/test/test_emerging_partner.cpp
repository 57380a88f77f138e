// Theorems of the emerging partner's predictions: what it predicts and when, smoothness, no allocation.
#include "phri_learning/emerging_partner.hpp"

#include <gtest/gtest.h>
#include <Eigen/Cholesky>

#include "flower.hpp"
#include "phri_core/testing.hpp"

namespace phri_learning
{
namespace
{
using testing::Drawing;
using testing::flower;
using testing::kAhead;
using testing::kHorizon;
using testing::kSampling;
using testing::kStep;
using testing::observation;
using testing::options;
using testing::Taught;
struct Repetition
{
  double samples = 0.0, predicted = 0.0, error = 0.0, straight = 0.0;  // sums over predicted samples [m]
};

std::vector<Repetition> judged(const EmergingOptions& o, const Drawing& drawing)
{
  std::vector<Repetition> result(static_cast<std::size_t>(drawing.repetition.back()) + 1);
  Taught taught(o);
  const Eigen::MatrixXd& x = drawing.samples;
  for (Eigen::Index t = 0; t + kAhead < x.rows(); ++t)
  {
    Repetition& r = result[static_cast<std::size_t>(drawing.repetition[static_cast<std::size_t>(t)])];
    r.samples += 1.0;
    const auto prediction = taught.see(static_cast<double>(t) * kSampling, x.row(t));
    if (!prediction)
      continue;
    const Eigen::RowVector2d target = x.row(t + kAhead).head(2);
    r.predicted += 1.0;
    r.error += (prediction->desired_state.back().mean.head(2).transpose() - target).norm();
    r.straight += (x.row(t).head(2) + kHorizon * x.row(t).segment(2, 2) - target).norm();
  }
  return result;
}

class References : public ::testing::TestWithParam<Reference>
{
};

TEST_P(References, predictsNothingAtFirstAndBetterThanConstantVelocityOnceLearned)
{
  // the third segment of a kind makes a primitive (m = 3), and it is committed when the movement has gone on: so the
  // first two repetitions are predicted by nothing, the fifth is known all through
  const std::vector<Repetition> r = judged(options(GetParam()), flower(1, 10));
  ASSERT_EQ(r.size(), 10u);
  EXPECT_EQ(r[0].predicted + r[1].predicted, 0.0);
  double error = 0.0, straight = 0.0;
  for (std::size_t k = 4; k < r.size(); ++k)
  {
    EXPECT_GT(r[k].predicted, 0.95 * r[k].samples) << k;
    error += r[k].error;
    straight += r[k].straight;
  }
  EXPECT_LT(error, 0.8 * straight);
}

TEST_P(References, sameInputSameOutputToTheLastBit)
{
  const Drawing drawing = flower(2, 4);
  Taught one(options(GetParam())), other(options(GetParam()));
  int predicted = 0;
  for (Eigen::Index t = 0; t < drawing.samples.rows(); ++t)
  {
    const double time = static_cast<double>(t) * kSampling;
    const auto a = one.see(time, drawing.samples.row(t)), b = other.see(time, drawing.samples.row(t));
    ASSERT_EQ(a.has_value(), b.has_value());
    if (!a)
      continue;
    ++predicted;
    for (std::size_t k = 0; k < a->desired_state.size(); ++k)
    {
      ASSERT_EQ(a->desired_state[k].mean, b->desired_state[k].mean);
      ASSERT_EQ(a->human_wrench[k].covariance, b->human_wrench[k].covariance);
    }
  }
  EXPECT_GT(predicted, 100);
}

TEST_P(References, predictionsAreWellFormedAndMoveNoFasterThanTheMotion)
{
  const Drawing drawing = flower(3, 6);
  const Eigen::MatrixXd& x = drawing.samples;
  constexpr double kAside = 0.25,
                   kSeldom = 0.05;  // [s] a change is confirmed in 3 samples; neighbours overlap a little
  double scale = 0.0;               // farthest that the motion itself goes within the horizon
  for (Eigen::Index t = 0; t + kAhead < x.rows(); ++t)
    scale = std::max(scale, (x.row(t + kAhead) - x.row(t)).head(2).norm());
  Taught taught(options(GetParam()));
  Eigen::VectorXd last;
  int switches = 0, primitive = -1, samples = 0, outside = 0;
  for (Eigen::Index t = 0; t < x.rows(); ++t)
  {
    const auto prediction = taught.see(static_cast<double>(t) * kSampling, x.row(t));
    if (!prediction)
    {
      last.resize(0);
      continue;
    }
    ASSERT_EQ(prediction->desired_state.size(), 16u);
    ASSERT_EQ(prediction->human_wrench.size(), 16u);
    for (std::size_t k = 0; k < 16; ++k)
      for (const auto& g : { prediction->desired_state[k], prediction->human_wrench[k] })
      {
        ASSERT_TRUE(g.mean.allFinite() && g.covariance.allFinite());
        ASSERT_EQ(g.covariance, g.covariance.transpose());
        ASSERT_EQ(g.covariance.llt().info(), Eigen::Success);
      }
    if (GetParam() == Reference::kDisplacement)
    {
      const double now = (prediction->desired_state[0].mean - x.row(t).head(4).transpose()).norm();
      ASSERT_LT(now, 1e-12) << "a displacement begins where the handle is";
    }
    const Eigen::VectorXd end = prediction->desired_state.back().mean.head(2);
    if (last.size() > 0)
    {
      EXPECT_LT((end - last).norm(), scale) << t;
    }
    last = end;
    switches += primitive >= 0 && taught.partner.primitive() != primitive;
    primitive = taught.partner.primitive();
    if (primitive < 0)
      continue;
    ++samples;
    const double time = taught.partner.primitiveTime();
    outside += time < -kAside || time > taught.partner.learned()->library.node(primitive).model->hmm->length() + kAside;
  }
  EXPECT_GT(switches, 20);
  EXPECT_LT(outside, kSeldom * samples) << "the primitive in force is the one that the movement is in";
}

TEST_P(References, observesAndPredictsWithoutAllocating)
{
  if (!phri_core::testing::kCountsAllocations)
    GTEST_SKIP();
  const Drawing drawing = flower(4, 6);
  Taught taught(options(GetParam()));
  const Eigen::Index taught_until = drawing.samples.rows() * 4 / 6;
  Eigen::Index t = 0;
  for (; t < taught_until; ++t)
    taught.see(static_cast<double>(t) * kSampling, drawing.samples.row(t));
  phri_core::Prediction prediction;
  taught.partner.predict(kHorizon, kStep, &prediction);
  std::vector<phri_core::Observation> all;
  for (; t < drawing.samples.rows(); ++t)
    all.push_back(observation(static_cast<double>(t) * kSampling, drawing.samples.row(t)));
  long allocations = 0;
  int known = 0, switches = 0, primitive = -1;
  for (const phri_core::Observation& o : all)
  {
    allocations += phri_core::testing::countAllocations([&] {
      taught.partner.observe(o);
      known += taught.partner.predict(kHorizon, kStep, &prediction);
    });
    switches += taught.partner.primitive() != primitive;
    primitive = taught.partner.primitive();
  }
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(known, 300);
  EXPECT_GT(switches, 5);
  EXPECT_GT(taught.partner.waitingSegments(), 5);
}

TEST_P(References, aNewSeriesIsPredictedAsByAPartnerThatSawNoOther)
{
  const Drawing drawing = flower(15, 6);
  constexpr Eigen::Index kBack = 12;  // [samples] it begins where the one before has just been
  const Eigen::Index half = drawing.samples.rows() / 2 + 137;
  Taught taught(options(GetParam()));
  for (Eigen::Index t = 0; t < half; ++t)
    taught.see(static_cast<double>(t) * kSampling, drawing.samples.row(t));
  EmergingPartner fresh(options(GetParam()));
  fresh.adopt(taught.learner.snapshot());
  taught.partner.reset();
  EXPECT_FALSE(taught.partner.predict(kHorizon, kStep)) << "of a series without a sample";
  EXPECT_EQ(taught.partner.primitive(), -1);
  int predicted = 0;
  for (Eigen::Index t = 0; t < 100; ++t)
  {
    const auto o = observation(static_cast<double>(t) * kSampling, drawing.samples.row(half - kBack + t));
    taught.partner.observe(o);
    fresh.observe(o);
    const auto a = taught.partner.predict(kHorizon, kStep), b = fresh.predict(kHorizon, kStep);
    ASSERT_EQ(a.has_value(), b.has_value()) << t;
    for (std::size_t k = 0; a && k < a->desired_state.size(); ++k)
    {
      ASSERT_EQ(a->desired_state[k].mean, b->desired_state[k].mean) << t;
      ASSERT_EQ(a->desired_state[k].covariance, b->desired_state[k].covariance) << t;
    }
    predicted += a.has_value();
  }
  EXPECT_GT(predicted, 80);
}

INSTANTIATE_TEST_SUITE_P(All, References, ::testing::Values(Reference::kPath, Reference::kDisplacement),
                         [](const auto& tested) { return tested.param == Reference::kPath ? "path" : "displacement"; });

TEST(EmergingPartner, anUnknownShapeIsNotPredictedAndAKnownOneIsAgain)
{
  Taught taught(options());
  // petals where the known flower has none
  const Drawing known = flower(5, 5), other = flower(6, 1, 0.015, testing::kPi / 5.0);
  double t = 0.0;
  for (Eigen::Index k = 0; k < known.samples.rows(); ++k, t += kSampling)
    taught.see(t, known.samples.row(k));
  ASSERT_GE(taught.partner.primitive(), 0);
  // no learning from here on: what is to be tested is recognition
  const auto share = [&](const Eigen::MatrixXd& x) {
    double predicted = 0.0;
    const Eigen::Index window = taught.partner.options().recogniser.window;
    for (Eigen::Index k = 0; k < x.rows(); ++k, t += kSampling)
    {
      taught.partner.observe(observation(t, x.row(k)));
      if (k >= window)
        predicted += taught.partner.predict(kHorizon, kStep).has_value();
    }
    return predicted / static_cast<double>(x.rows() - window);
  };
  EXPECT_LT(share(other.samples), 0.05);
  EXPECT_GT(share(known.samples.topRows(300)), 0.9);
}

TEST(EmergingPartner, betweenSamplesADisplacementStillBeginsAtTheHandleAndAPathStaysWhereItIs)
{
  const Drawing drawing = flower(14, 5);
  for (const Reference reference : { Reference::kPath, Reference::kDisplacement })
  {
    Taught taught(options(reference));
    double t = 0.0;
    const Eigen::Index end = drawing.samples.rows() - 1;
    for (Eigen::Index k = 0; k < end; ++k, t += kSampling)
      taught.see(t, drawing.samples.row(k));
    const auto before = taught.partner.predict(0.2, kSampling / 2);
    // half a sampling time later the handle is pushed aside by 5 mm
    Eigen::RowVectorXd pushed = drawing.samples.row(end - 1);
    pushed(0) += 0.005;
    taught.partner.observe(observation(t - kSampling / 2, pushed));
    const auto after = taught.partner.predict(0.2, kSampling / 2);
    ASSERT_TRUE(before && after);
    constexpr double kRounding = 1e-9;  // [m]
    for (std::size_t k = 0; k + 2 < before->desired_state.size(); k += 2)
    {
      const auto spread = [&](std::size_t node) { return before->desired_state[node].covariance; };
      EXPECT_LT((0.5 * (spread(k) + spread(k + 2)) - spread(k + 1)).norm(), kRounding * spread(k + 1).norm()) << k;
    }
    for (std::size_t k = 0; k + 1 < after->desired_state.size(); ++k)
    {
      const Eigen::VectorXd expected = before->desired_state[k + 1].mean, now = after->desired_state[k].mean;
      if (reference == Reference::kPath)
      {
        EXPECT_LT((now - expected).norm(), kRounding) << k;
        continue;
      }
      const Eigen::VectorXd change = expected - before->desired_state[1].mean;
      EXPECT_LT((now - pushed.head(4).transpose() - change).norm(), kRounding) << k;
    }
  }
}

TEST(EmergingPartner, thePrimitiveInForceIsTheOneWhoseStateIsLikeliestForLongEnough)
{
  // the winner's window holds the end of its predecessor and the beginning of its successor
  Taught taught(options());
  const Drawing drawing = flower(7, 6);
  const int confirm = options().recogniser.confirm;
  int expected = -1, same = 0, in_predecessor = 0, in_successor = 0, in_force = -1;
  for (Eigen::Index t = 0; t < drawing.samples.rows(); ++t)
  {
    taught.see(static_cast<double>(t) * kSampling, drawing.samples.row(t));
    const int winner = taught.partner.recogniser().winner(), now = taught.partner.primitive();
    EXPECT_EQ(now >= 0, winner >= 0) << t;
    if (winner < 0)
    {
      in_force = expected = -1;
      continue;
    }
    const std::size_t i = static_cast<std::size_t>(winner);
    const LearnedPrimitive& p = taught.partner.learned()->primitives[i];
    const int state = taught.partner.recogniser().entries()[i].state;
    const bool before = state < p.window.before, after = state >= p.window.before + p.own->states();
    const int node = before ? p.predecessor : after ? p.successor : p.node;
    same = node == expected ? same + 1 : 1;
    expected = node;
    if (in_force < 0 || same >= confirm)
    {
      EXPECT_EQ(now, node) << t;
      in_predecessor += before;
      in_successor += after;
    }
    else
      EXPECT_TRUE(now == in_force || now == node) << t;  // `node` at once: where knowledge is new
    in_force = now;
  }
  EXPECT_GT(in_predecessor, 0);
  EXPECT_GT(in_successor, 100);
}

TEST(EmergingPartner, aRobotThatTracksItGoesOnAloneAlongTheFlower)
{
  // 5.1.1: the handle is let go. An object of 40 kg and 90 Ns/m, K_x = 200 N/m and K_xdot = 90 Ns/m towards what is
  // predicted 0.3 s ahead, points farther than 0.02 m ignored. Going round takes 16 s at the pace that was learned.
  constexpr double kTick = 0.005, kMass = 40.0, kDamping = 90.0, kStiffness = 200.0, kTracking = 90.0, kGate = 0.02;
  constexpr int kTicksPerPrediction = 4;
  Taught taught(options());
  const Drawing drawing = flower(13, 5);
  double t = 0.0;
  for (Eigen::Index k = 0; k < drawing.samples.rows(); ++k, t += kSampling)
    taught.see(t, drawing.samples.row(k));
  Eigen::RowVectorXd state = drawing.samples.bottomRows(1);
  state.tail(2).setZero();
  double turned = 0.0, off = 0.0;
  int ticks = 0;
  phri_core::Prediction prediction;
  for (bool known = false; ticks < static_cast<int>(20.0 / kTick); ++ticks, t += kTick)
  {
    if (ticks % kTicksPerPrediction == 0)
    {
      taught.partner.observe(observation(t, state));
      known = taught.partner.predict(kHorizon, kStep, &prediction);
    }
    Eigen::RowVector2d force(0.0, 0.0);
    const Eigen::RowVector2d x = state.head(2), v = state.segment(2, 2);
    if (known)
    {
      const Eigen::RowVector4d ahead = prediction.desired_state.back().mean.transpose();
      if ((ahead.head(2) - x).norm() < kGate)
        force = kStiffness * (ahead.head(2) - x) + kTracking * (ahead.tail(2) - v);
    }
    state.segment(2, 2) += kTick / kMass * (force - kDamping * v);
    state.head(2) += kTick * state.segment(2, 2);
    const Eigen::RowVector2d now = state.head(2);
    turned += std::atan2(x(0) * now(1) - x(1) * now(0), x.dot(now));
    off += std::abs(now.norm() - 0.06 * (1.0 + 0.5 * std::cos(5.0 * std::atan2(now(1), now(0)))));
  }
  EXPECT_GT(turned, 0.8 * 2.0 * testing::kPi);
  EXPECT_LT(turned, 1.6 * 2.0 * testing::kPi);
  EXPECT_LT(off / ticks, 0.01) << "[m] radially, of petals 0.06 m long";
}

TEST(EmergingPartner, aChangeOfPrimitiveIsBlended)
{
  // at the first sample after a change, b / (b + 1) of the difference to the earlier forecast of the same moment is
  // kept, so its jump is 1 / (b + 1) of the one without blending; b = blend. Nothing else depends on b.
  constexpr int kBlend = 4;
  constexpr double kInterpolation = 1e-9;  // [m]: predictions at the grid's own times
  EmergingOptions plain = options(), blended = options();
  plain.blend = 0;
  blended.blend = kBlend;
  Taught one(plain), other(blended);
  const Drawing drawing = flower(7, 5);
  std::optional<phri_core::Prediction> last_one, last_other;
  int changes = 0, since = 0, primitive = -1;
  for (Eigen::Index t = 0; t < drawing.samples.rows(); ++t)
  {
    const phri_core::Observation o = observation(static_cast<double>(t) * kSampling, drawing.samples.row(t));
    std::optional<phri_core::Prediction> now[2];
    int learned = 0, k = 0;
    for (Taught* taught : { &one, &other })
    {
      taught->partner.observe(o);
      now[k++] = taught->partner.predict(kHorizon, kSampling);
    }
    ASSERT_EQ(one.partner.primitive(), other.partner.primitive());
    const bool changed = primitive >= 0 && one.partner.primitive() >= 0 && one.partner.primitive() != primitive;
    if (changed && since > kBlend + 1 && last_one && last_other)
    {
      ++changes;
      const auto jump = [](const phri_core::Prediction& before, const phri_core::Prediction& after) {
        return (after.desired_state[1].mean - before.desired_state[2].mean).eval();
      };
      EXPECT_LT((jump(*last_one, *now[0]) / (kBlend + 1) - jump(*last_other, *now[1])).norm(), kInterpolation);
    }
    since = changed ? 0 : since + 1;
    primitive = one.partner.primitive();
    last_one = now[0];
    last_other = now[1];
    learned += learn(&one.partner, &one.learner) + learn(&other.partner, &other.learner);
    if (learned > 0)
      since = 0;  // new knowledge is blended too
  }
  EXPECT_GT(changes, 5);
}

}  // namespace
}  // namespace phri_learning
