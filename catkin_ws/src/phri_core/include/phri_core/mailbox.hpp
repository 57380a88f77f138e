#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <utility>

namespace phri_core
{
/// Newest value from one writer thread to one reader thread; neither waits (a triple buffer). The reader's side neither
/// allocates nor frees, whatever T holds: values are replaced in the writer's slot only.
template <typename T>
class Mailbox
{
public:
  /// Writer: makes `value` the newest. May allocate and free (in the writer's thread).
  void post(T value)
  {
    slots_[write_] = std::move(value);
    write_ = state_.exchange(write_ | kFresh, std::memory_order_acq_rel) & kIndex;
  }
  /// Reader: the newest value if one arrived since the last call, else nullptr. Valid until the next call.
  const T* take() noexcept
  {
    if (!(state_.load(std::memory_order_relaxed) & kFresh))
      return nullptr;
    read_ = state_.exchange(read_, std::memory_order_acq_rel) & kIndex;
    return &slots_[read_];
  }

private:
  static constexpr std::uint32_t kFresh = 4, kIndex = 3;
  std::array<T, 3> slots_{};
  std::atomic<std::uint32_t> state_{ 1 };
  std::uint32_t write_ = 0, read_ = 2;
};
}  // namespace phri_core
