#ifndef FIRMWARE_PORT_TICK_H_
#define FIRMWARE_PORT_TICK_H_

/* The timer of a board. tick_start() starts an interrupt of 1500 Hz. tick_interrupt() is the
 * handler of this interrupt: it counts its calls and calls port_tick(). tick_entries() returns the
 * number of these calls since power-up. */

#include <stdint.h>

void tick_start(void);
void tick_interrupt(void);
uint32_t tick_entries(void);

enum { TICK_HZ = 1500 };

/* Returns the number of counts of the next tick, for a timer with `hz` counts per second. If `hz`
 * is no multiple of 1500, some ticks are longer by one count, so that the average rate of the ticks
 * is exactly 1500 Hz. *fraction is the part of a count that remains for the next tick, in 1/1500
 * count. It must be 0 at the start. */
static inline uint32_t tick_counts(uint32_t hz, uint32_t *fraction) {
  *fraction += hz % TICK_HZ;
  const uint32_t longer = (*fraction >= TICK_HZ) ? 1 : 0;
  *fraction -= longer * TICK_HZ;
  return hz / TICK_HZ + longer;
}

#endif
