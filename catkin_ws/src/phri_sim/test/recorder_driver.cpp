// Records a trial of condition (a) the way the experiment node does, without ROS around it: for tests that kill this
// process or take its disk away. `recorder_test_driver FOLDER SECONDS PACE [CHUNK]`: SECONDS [s] of trial at PACE times
// real time (0: as fast as it goes), chunks of CHUNK bytes. Writes to its standard output, unbuffered, the path and
// then the time of the newest tick that was recorded, every 10 ms of trial. Exit status 74 when the bag cannot be
// written.
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "../ros/markers.hpp"
#include "../ros/recorder.hpp"
#include "../ros/trial_messages.hpp"

namespace
{
constexpr std::int64_t kStart = 1000000000;  // [ns] of session time

template <typename Value>
void say(const char* format, const Value& value)
{
  char line[512];
  const int size = std::snprintf(line, sizeof(line), format, value);
  if (::write(STDOUT_FILENO, line, std::size_t(size)) != size)
    std::_Exit(70);
}

void record(phri_sim::Recorder& recorder, const std::string& topic, const ros::Time& now,
            const phri_sim::TickMessages& messages)
{
  recorder.write("/phri/experiment_node/tick", now, messages.tick);
  recorder.write("/phri/joint_states", now, messages.joints);
  recorder.write("/phri/human_wrench", now, messages.human);
  recorder.write("/phri/environment_wrench", now, messages.environment);
  recorder.write("/phri/assistance_wrench", now, messages.assistance);
  recorder.write(topic, now, messages.requested);
}

int run(const std::string& folder, double seconds, double pace, std::uint32_t chunk)
{
  using Clock = std::chrono::steady_clock;
  const auto experiment = std::make_shared<const phri_sim::Experiment>(
      phri_sim::loadExperiment("maze_assistance", { { "timeout", seconds } }));
  phri_sim::Trial trial(experiment, phri_sim::trialSpec(0, "none", 1, 1, 0, 3));
  phri_sim::Recorder recorder(folder, "driven", chunk);
  say("%s\n", recorder.path().c_str());

  ros::Time now;
  now.fromNSec(kStart);
  std_msgs::String metadata;
  metadata.data = R"({"participant":0,"controller":"none","trial":1,"completed":false,"clock":"realtime"})";
  recorder.writeLatched("/phri/metadata", now, metadata);
  recorder.writeLatched("/phri/map", now, phri_sim::occupancyGrid(*experiment->scene, now));
  phri_sim::TickMessages messages;
  const Clock::time_point begin = Clock::now();
  for (std::int64_t tick = 0; !trial.finished(); ++tick)
  {
    // a made-up lateness, which a reader can tell without having seen it
    trial.step(1e-6 * double(tick % 1000));
    now.fromNSec(kStart + trial.record().time_ns);
    messages.fill(trial.record(), now);
    record(recorder, "/phri/requested_wrench", now, messages);
    if (tick % 10 != 0)
      continue;
    recorder.write("/phri/experiment_node/state", now, phri_sim::controllerState(trial.record(), {}, now, {}));
    say("%lld\n", static_cast<long long>(now.toNSec()));
    if (pace > 0.0)
      std::this_thread::sleep_until(begin + std::chrono::microseconds(std::llround(1e3 * double(tick) / pace)));
  }
  recorder.finish();
  std::fprintf(stderr, "%lld ticks\n", static_cast<long long>(std::llround(seconds * 1e3)));
  std::fprintf(stderr, "%.3f s\n", std::chrono::duration<double>(Clock::now() - begin).count());
  return 0;
}
}  // namespace

int main(int count, char** words)
{
  try
  {
    if (count < 4)
      throw std::invalid_argument("usage: recorder_test_driver FOLDER SECONDS PACE [CHUNK]");
    return run(words[1], std::atof(words[2]), std::atof(words[3]),
               count > 4 ? std::uint32_t(std::atoi(words[4])) : phri_sim::Recorder::kChunk);
  }
  catch (const phri_sim::RecordingError& error)
  {
    std::fprintf(stderr, "%s\n", error.what());
    return 74;
  }
  catch (const std::exception& error)
  {
    std::fprintf(stderr, "%s\n", error.what());
    return 70;
  }
}
