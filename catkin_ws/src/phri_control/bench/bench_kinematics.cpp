// One tick of whole-body control: arm of seven joints on an omnidirectional base, end-effector wandering so fast that
// the joint limits act in part of the ticks. Prints one line of JSON:
//   forward             [us] mean CPU time of pose and Jacobian
//   inverse             [us] mean CPU time of the differential inverse, pose and Jacobian included
//   gradient            [us] mean CPU time of the manipulability's gradient
//   median, p999, max   [us] wall-clock of single calls of WholeBody::update, less the median cost of the clock
//   limited             share of the ticks in which joint limits scaled the motion
//   allocations         by all timed ticks together, malloc and operator new counted
//   bench_kinematics [TICKS]   how many ticks are timed (default 100000)
#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "../test/lwr_arm.hpp"
#include "phri_control/whole_body.hpp"
#include "phri_core/testing.hpp"

namespace
{
using namespace phri_control;
constexpr double kDt = 0.001;
constexpr int kWarmUp = 1000;

std::int64_t now(clockid_t clock)
{
  timespec t;
  clock_gettime(clock, &t);
  return std::int64_t(t.tv_sec) * 1000000000 + t.tv_nsec;
}

/// [us]
double percentile(std::vector<std::int64_t>& values, double share)
{
  const std::size_t rank = std::min(values.size() - 1, static_cast<std::size_t>(share * double(values.size())));
  std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(rank), values.end());
  return 1e-3 * double(values[rank]);
}

/// Mean CPU time [us] of `code(posture)` over random postures.
template <typename Code>
double mean(const std::vector<VectorJoints>& postures, Code&& code)
{
  double sum = 0.0;
  for (const VectorJoints& q : postures)
    sum += code(q);
  const std::int64_t start = now(CLOCK_THREAD_CPUTIME_ID);
  for (int round = 0; round < 20; ++round)
    for (const VectorJoints& q : postures)
      sum += code(q);
  const std::int64_t elapsed = now(CLOCK_THREAD_CPUTIME_ID) - start;
  if (!std::isfinite(sum))
    throw std::runtime_error("bench: a result is not finite");
  return 1e-3 * double(elapsed) / (20.0 * double(postures.size()));
}

std::string measure(int ticks)
{
  if (!phri_core::testing::kCountsAllocations)
    throw std::runtime_error("bench: built with the address sanitizer, which hides allocations");
  const ArmKinematics arm = lwr::arm();
  phri_core::Random random(1);
  WholeBodySettings settings;
  settings.inverse.posture = lwr::posture();
  settings.coordination.preferred = arm.forward(lwr::posture());
  WholeBody control(arm, settings);

  std::vector<VectorJoints> postures;
  for (int i = 0; i < 1000; ++i)
    postures.push_back(lwr::randomPosture(arm, random));
  const Twist some = Twist::Constant(0.2);
  ArmJacobian jacobian;
  const double forward = mean(postures, [&](const VectorJoints& q) { return arm.forward(q, jacobian)(0, 3); });
  const double inverse = mean(postures, [&](const VectorJoints& q) {
    return control.inverse().solve(q, settings.coordination.preferred, some).velocity(0);
  });
  const double gradient = mean(postures, [&](const VectorJoints& q) {
    jacobian(0, 0) = q(0);
    return manipulabilityGradient(jacobian)(0);
  });

  VectorJoints q = settings.inverse.posture;
  BaseState base;
  EndEffectorCommand command;
  command.pose = settings.coordination.preferred;
  std::vector<std::int64_t> times, empty(20000);
  times.reserve(static_cast<std::size_t>(ticks));
  long allocations = 0, limited = 0;
  for (int k = 0; k < kWarmUp + ticks; ++k)
  {
    if (k % 500 == 0)
      command.twist = lwr::randomTwist(random, 0.25, 0.5);
    WholeBodyCommand result;
    std::int64_t elapsed = 0;
    const long count = phri_core::testing::countAllocations([&] {
      const std::int64_t start = now(CLOCK_MONOTONIC);
      result = control.update(q, base, command);
      elapsed = now(CLOCK_MONOTONIC) - start;
    });
    if (!result.arm.valid)
      throw std::runtime_error("bench: tick " + std::to_string(k) + " is not valid");
    if (k >= kWarmUp)
    {
      times.push_back(elapsed);
      allocations += count;
      limited += result.arm.scale < 1.0;
    }
    q += kDt * result.arm.velocity;
    base.twist = result.base;
    base.pose.head<2>() += kDt * (Eigen::Rotation2Dd(base.pose.z()) * Eigen::Vector2d(base.twist.head<2>()));
    base.pose.z() += kDt * base.twist.z();
    command.pose = result.end_effector;  // where it got to: the twist alone drives it
  }
  for (std::int64_t& value : empty)
  {
    const std::int64_t start = now(CLOCK_MONOTONIC);
    value = now(CLOCK_MONOTONIC) - start;
  }
  const double clock = percentile(empty, 0.5);
  std::ostringstream out;
  out << "{\"ticks\": " << ticks << ", \"forward\": " << forward << ", \"inverse\": " << inverse
      << ", \"gradient\": " << gradient << ", \"median\": " << percentile(times, 0.5) - clock
      << ", \"p999\": " << percentile(times, 0.999) - clock
      << ", \"max\": " << 1e-3 * double(*std::max_element(times.begin(), times.end())) - clock
      << ", \"limited\": " << double(limited) / ticks << ", \"allocations\": " << allocations << '}';
  return out.str();
}
}  // namespace

int main(int argc, char** argv)
{
  const int ticks = argc > 1 ? std::atoi(argv[1]) : 100000;
  if (argc > 2 || ticks < 1 || ticks > 10000000)
  {
    std::cerr << "usage: bench_kinematics [TICKS]   (1 to 10000000)\n";
    return 64;
  }
  try
  {
    std::cout << measure(ticks) << '\n';
  }
  catch (const std::exception& error)
  {
    std::cerr << error.what() << '\n';
    return 70;
  }
}
