#ifndef FIRMWARE_DRIVE_SHAPER_H_
#define FIRMWARE_DRIVE_SHAPER_H_

/* Input shaping (thesis 6.2.1). A command that is convolved with up to three impulses does not
 * excite the mode of vibration for which the impulses were computed.
 *
 *   y[n] = (a_1 x[n] + a_2 x[n - d_2] + a_3 x[n - d_3]) / 65536
 *
 * The amplitudes are not negative and their sum is 65536. So y stays within the range of x, and a
 * constant command passes unchanged. The rounding remainder of y is added in the next tick: once x
 * has been 0 for the longest delay, the sum of all y equals that of all x.
 *
 * Any x is permitted. A step needs about 45 instructions. The first step needs no more, because one
 * value represents all inputs before it, so the history need not be filled. */

#include <stdbool.h>
#include <stdint.h>

enum { SHAPER_IMPULSES = 3, SHAPER_TICKS = 256 };

typedef struct {
  int32_t history[SHAPER_TICKS]; /* ring buffer of the inputs x */
  int32_t amplitude_q16[SHAPER_IMPULSES];
  int32_t before;         /* value that represents all inputs before the first one in `history` */
  uint32_t remainder_q16; /* rounding remainder of the last output of the shaper */
  /* number of inputs since the shaper began, at most SHAPER_TICKS; 0: not begun */
  uint16_t age;
  uint8_t delay_tick[SHAPER_IMPULSES];
  uint8_t next;     /* slot of the next input */
  uint8_t impulses; /* 0: off */
} shaper_t;

/* Makes a set of impulses active; a set that is not valid switches the shaper off. The shaper
 * begins again with the next input. Returns AXIS_FORCE_SHAPER_STATE_: off (no impulses),
 * wrong_order (the first delay is not 0, or a delay is not longer than the previous one), wrong_sum
 * (the amplitudes have a wrong sum) or valid. */
uint8_t shaper_set(shaper_t *shaper, uint8_t impulses, const uint32_t amplitude[SHAPER_IMPULSES],
                   const uint8_t delay_tick[SHAPER_IMPULSES]);

static inline bool shaper_is_on(const shaper_t *shaper) { return shaper->impulses != 0; }

static inline bool shaper_has_begun(const shaper_t *shaper) { return shaper->age != 0; }

/* Clears the history of the shaper: the next input is its first input. */
static inline void shaper_clear(shaper_t *shaper) { shaper->age = 0; }

/* Returns the shaped command of a tick. At the first input the shaper acts as if all earlier inputs
 * had the value `before`. Call it only if the shaper is on. */
int32_t shaper_step(shaper_t *shaper, int32_t x, int32_t before);

#endif
