#ifndef FIRMWARE_DRIVE_SHAPER_H_
#define FIRMWARE_DRIVE_SHAPER_H_

/* Input shaping (thesis 6.2.1). A command that is convolved with up to three impulses does not
 * excite the mode of vibration for which the impulses were computed.
 *
 *   y[n] = (a_1 x[n] + a_2 x[n - d_2] + a_3 x[n - d_3]) / 65536
 *
 * The amplitudes are not negative, and their sum is 65536. So y stays within the range of x, and a
 * constant command is not changed. The rounding remainder of y is added in the next tick. When x
 * has been 0 for the longest delay, the sum of all y equals the sum of all x.
 *
 * Every value of x is permitted. A step of the shaper needs about 45 instructions. The first step
 * needs no more instructions, because one value stands for all earlier inputs and the history is
 * not filled. */

#include <stdbool.h>
#include <stdint.h>

enum { SHAPER_IMPULSES = 3, SHAPER_TICKS = 256 };

typedef struct {
  int32_t history[SHAPER_TICKS]; /* ring buffer of the inputs x */
  int32_t amplitude_q16[SHAPER_IMPULSES];
  /* value that all inputs of the shaper before the oldest one in `history` are assumed to have */
  int32_t before;
  uint32_t remainder_q16; /* rounding remainder of the last output of the shaper */
  /* number of inputs since the shaper began, at most SHAPER_TICKS; 0 before the first input */
  uint16_t age;
  uint8_t delay_tick[SHAPER_IMPULSES];
  uint8_t next;     /* index in `history` at which the shaper stores its next input */
  uint8_t impulses; /* number of impulses; 0 if the shaper is off */
} shaper_t;

/* Sets the impulses of the shaper. Impulses that are not valid switch the shaper off. The shaper
 * begins again with the next input. Returns the state (AXIS_FORCE_SHAPER_STATE_) of the shaper.
 * `off`: there are no impulses. `wrong_order`: the first delay is not 0, or a delay is not longer
 * than the delay before it. `wrong_sum`: the sum of the amplitudes is not 65536. `valid`: the
 * impulses are used. */
uint8_t shaper_set(shaper_t *shaper, uint8_t impulses, const uint32_t amplitude[SHAPER_IMPULSES],
                   const uint8_t delay_tick[SHAPER_IMPULSES]);

static inline bool shaper_is_on(const shaper_t *shaper) { return shaper->impulses != 0; }

static inline bool shaper_has_begun(const shaper_t *shaper) { return shaper->age != 0; }

/* Clears the history of the shaper, so that the next input is the first input. */
static inline void shaper_clear(shaper_t *shaper) { shaper->age = 0; }

/* Returns the shaped command of a tick for the input `x`. The shaper computes its first output as
 * if all earlier inputs had the value `before`. Call this function only while the shaper has
 * impulses. */
int32_t shaper_step(shaper_t *shaper, int32_t x, int32_t before);

#endif
