#include "../ros/realtime_loop.hpp"

#include <gtest/gtest.h>

namespace
{
constexpr int kNumbers = 200000;

std::shared_ptr<const phri_sim::Experiment> experiment(double timeout)
{
  return std::make_shared<const phri_sim::Experiment>(phri_sim::loadExperiment(
      "maze_assistance", { { "timeout", timeout }, { "override/safety/guard/late_cycle", 1.0 } }));
}
}  // namespace

// A full ring refuses, an empty one gives nothing, and what comes out is what went in, in order.
TEST(SpscRing, KeepsOrderAndRefusesWhenFull)
{
  phri_sim::SpscRing<int> ring(3);
  int value = 0;
  EXPECT_FALSE(ring.pop(value));
  for (int i = 0; i < 3; ++i)
    EXPECT_TRUE(ring.push(i));
  EXPECT_FALSE(ring.push(3));
  for (int i = 0; i < 3; ++i)
  {
    ASSERT_TRUE(ring.pop(value));
    EXPECT_EQ(value, i);
  }
  EXPECT_FALSE(ring.pop(value));
}

TEST(SpscRing, LosesNothingBetweenTwoThreads)
{
  phri_sim::SpscRing<int> ring(64);
  std::thread writer([&] {
    for (int i = 0; i < kNumbers;)
      if (ring.push(i))
        ++i;
      else
        std::this_thread::yield();
  });
  for (int expected = 0; expected < kNumbers;)
  {
    int value = -1;
    if (!ring.pop(value))
      std::this_thread::yield();
    else
      ASSERT_EQ(value, expected++);
  }
  writer.join();
}

TEST(LatenessHistogram, EveryTickIsCountedOnceInItsBin)
{
  phri_sim::LatenessHistogram histogram;
  for (const double lateness : { 0.0, 50e-6, 51e-6, 0.9e-3, 19e-3, 21e-3, 5.0 })
    histogram.add(lateness);
  std::vector<std::uint64_t> counts(histogram.counts.begin(), histogram.counts.end());
  EXPECT_EQ(counts, (std::vector<std::uint64_t>{ 2, 1, 0, 0, 1, 0, 0, 1, 2 }));
  EXPECT_EQ(histogram.worst, 5.0);
}

// The clock on the wall decides when a tick runs, never what it does: records equal those of a trial that is just
// stepped.
TEST(RealtimeLoop, TicksTheTrialUnchanged)
{
  const auto short_trial = experiment(1.0);
  const phri_sim::TrialSpec spec = phri_sim::trialSpec(0, "none", 1, 1, 0, 3);
  phri_sim::Trial ticked(short_trial, spec), stepped(short_trial, spec);
  phri_sim::RealtimeLoop loop(ticked);
  int plans = 0;
  phri_control::TickRecord record;
  const auto drain = [&] {
    while (loop.pop(record))
    {
      stepped.step();
      ASSERT_EQ(record.time_ns, stepped.record().time_ns);
      ASSERT_EQ(record.position, stepped.record().position);
      ASSERT_EQ(record.human_wrench, stepped.record().human_wrench);
    }
  };
  while (loop.running())
  {
    if (loop.newestDue())
      ++plans;
    drain();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  loop.stop();
  drain();
  EXPECT_TRUE(stepped.finished());
  EXPECT_GT(plans, 0);
  EXPECT_EQ(loop.lateness().dropped, 0u);
}

TEST(RealtimeLoop, StopsWhenAsked)
{
  const auto long_trial = experiment(3600.0);
  phri_sim::Trial trial(long_trial, phri_sim::trialSpec(0, "none", 1, 1, 0, 3));
  phri_sim::RealtimeLoop loop(trial);
  loop.stop();
  EXPECT_FALSE(loop.running());
  EXPECT_FALSE(trial.finished());
}
