/* Times single calls step(model, data) with CLOCK_MONOTONIC, as bench_tick does ours: count times into ns[count]. With
 * step = 0: the cost of reading the clock. */
#include <stdint.h>
#include <time.h>

static int64_t now(void)
{
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

void timed_calls(void (*step)(void*, void*), void* model, void* data, int64_t count, int64_t* ns)
{
  for (int64_t i = 0; i < count; ++i)
  {
    const int64_t start = now();
    if (step)
      step(model, data);
    ns[i] = now() - start;
  }
}
