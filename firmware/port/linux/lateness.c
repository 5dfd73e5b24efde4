#include "firmware/port/linux/lateness.h"

#include <inttypes.h>
#include <stdio.h>

enum { US = 1000 };

void lateness_add(lateness_t *lateness, uint64_t late_ns) {
  const uint64_t us = late_ns / US;
  const uint64_t step = us / LATENESS_STEP_US;
  lateness->ticks++;
  lateness->counts[(step < LATENESS_STEPS) ? step : LATENESS_STEPS]++;
  if (us > lateness->longest_us) {
    lateness->longest_us = us;
  }
}

/* Returns the lateness in us that at least `per_myriad` of 10,000 ticks do not exceed. The result
 * is rounded up to a step, because the lateness of ticks is counted in steps. */
static uint64_t below(const lateness_t *lateness, uint64_t per_myriad) {
  uint64_t sum = 0;
  for (uint64_t step = 0; step < LATENESS_STEPS; step++) {
    sum += lateness->counts[step];
    if (sum * 10000 >= lateness->ticks * per_myriad) {
      return (step + 1) * LATENESS_STEP_US;
    }
  }
  return lateness->longest_us;
}

void lateness_print(const lateness_t *lateness) {
  printf("{\"ticks\": %" PRIu64 ", \"missed\": %" PRIu64 ", \"late_us\": {\"50%%\": %" PRIu64
         ", \"99%%\": %" PRIu64 ", \"99.9%%\": %" PRIu64 ", \"99.99%%\": %" PRIu64
         ", \"longest\": %" PRIu64 "}}\n",
         lateness->ticks, lateness->missed, below(lateness, 5000), below(lateness, 9900),
         below(lateness, 9990), below(lateness, 9999), lateness->longest_us);
  (void)fflush(stdout);
}
