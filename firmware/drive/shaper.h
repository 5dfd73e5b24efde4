#ifndef FIRMWARE_DRIVE_SHAPER_H_
#define FIRMWARE_DRIVE_SHAPER_H_

/* Command shaping (thesis, 6.2.1): a command that is convolved with up to three impulses does not
 * excite the mode that they are made for.
 *
 *   y[n] = (a_1 x[n] + a_2 x[n - d_2] + a_3 x[n - d_3]) / 65536
 *
 * Amplitudes are not negative and their sum is 65536, so y stays within the range of x, and a
 * constant command passes unchanged. What the rounding of y drops is added in the next tick: once x
 * has been 0 for the longest delay, the sum of all y is that of all x.
 *
 * Any x is allowed. A step takes some 45 instructions; what begins again costs no more, because
 * inputs from before the beginning are one value instead of a history that is filled with it. */

#include <stdbool.h>
#include <stdint.h>

enum { SHAPER_IMPULSES = 3, SHAPER_TICKS = 256 };

typedef struct {
  int32_t history[SHAPER_TICKS]; /* of x, a ring */
  int32_t amplitude_q16[SHAPER_IMPULSES];
  int32_t before;         /* every x before the first one of the history */
  uint32_t remainder_q16; /* what the last output dropped */
  uint16_t age;           /* inputs since the beginning, at most SHAPER_TICKS; 0: not begun */
  uint8_t delay_tick[SHAPER_IMPULSES];
  uint8_t next;     /* slot of the coming input */
  uint8_t impulses; /* 0: off */
} shaper_t;

/* Puts a set of impulses in force, or none where it does not fit; not begun. Returns what it is,
 * AXIS_FORCE_SHAPER_STATE_: off (no impulses), wrong_order (the first delay is not 0, or one is not
 * longer than that before it), wrong_sum (of the amplitudes) or valid. */
uint8_t shaper_set(shaper_t *shaper, uint8_t impulses, const uint32_t amplitude[SHAPER_IMPULSES],
                   const uint8_t delay_tick[SHAPER_IMPULSES]);

static inline bool shaper_is_on(const shaper_t *shaper) { return shaper->impulses != 0; }

static inline bool shaper_has_begun(const shaper_t *shaper) { return shaper->age != 0; }

/* The next input is the first one. */
static inline void shaper_clear(shaper_t *shaper) { shaper->age = 0; }

/* The command of a tick, shaped; of the first one as if it had been `before` for ever. For a shaper
 * that is on. */
int32_t shaper_step(shaper_t *shaper, int32_t x, int32_t before);

#endif
