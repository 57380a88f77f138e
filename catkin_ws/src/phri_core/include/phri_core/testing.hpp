#pragma once
/// For tests only: counts the heap allocations that a piece of code makes, Eigen's (malloc) and C++'s (operator new,
/// which calls malloc) alike. Include it in exactly one source file of a test program: it replaces glibc's malloc.
/// Under AddressSanitizer, which needs malloc for itself, nothing is counted: tests skip where kCountsAllocations is
/// false.

#include <atomic>
#include <cstddef>
#include <cstdlib>

namespace phri_core::testing
{
#ifdef __SANITIZE_ADDRESS__
constexpr bool kCountsAllocations = false;
#else
constexpr bool kCountsAllocations = true;
#endif

inline std::atomic<long> allocation_count{ 0 };

/// Number of heap allocations made while `code` runs, by any thread of the program.
template <typename Code>
long countAllocations(Code&& code)
{
  const long before = allocation_count.load();
  code();
  return allocation_count.load() - before;
}
}  // namespace phri_core::testing

#ifndef __SANITIZE_ADDRESS__
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* memory, std::size_t size);

void* malloc(std::size_t size)
{
  ++phri_core::testing::allocation_count;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size)
{
  ++phri_core::testing::allocation_count;
  return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size)
{
  ++phri_core::testing::allocation_count;
  return __libc_realloc(memory, size);
}
}
#endif
