#ifndef FIRMWARE_PORT_LINUX_LATENESS_H_
#define FIRMWARE_PORT_LINUX_LATENESS_H_

/* Statistics about how late the ticks of a process are. */

#include <stdint.h>

enum { LATENESS_STEP_US = 10, LATENESS_STEPS = 2000 };

typedef struct {
  uint64_t ticks;
  uint64_t missed; /* number of missed ticks, which were not computed */
  uint64_t longest_us;
  /* number of ticks whose lateness is within each step; the last step also counts all later
   * ticks */
  uint64_t counts[LATENESS_STEPS + 1];
} lateness_t;

/* Counts one tick that began `late_ns` nanoseconds after it was due. */
void lateness_add(lateness_t *lateness, uint64_t late_ns);

/* Writes a line of JSON to standard output. It has the numbers of ticks, and the latenesses in us
 * that 50 %, 99 %, 99.9 % and 99.99 % of the ticks do not exceed. */
void lateness_print(const lateness_t *lateness);

#endif
