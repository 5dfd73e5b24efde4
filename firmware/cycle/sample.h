#ifndef FIRMWARE_CYCLE_SAMPLE_H_
#define FIRMWARE_CYCLE_SAMPLE_H_

/* Whether a sample of force and position is valid, so that the verdict on a pressed part may depend
 * on it. A sample is valid if
 *   - the force code is at no end of its range. If force_zero_code is 0, the lower end is
 *     permitted, because code 0 is then the force 0;
 *   - force and position are at most cycle_age_max ticks old;
 *   - no protection that is switched on is tripped. A protection that trips is a fault, which
 *     aborts the cycle, so it needs no bit here.
 *
 * A broken wire that reads as zero is not detected here. The fault force_disconnected
 * (guard/sensor.h) and the lower bounds of the evaluation elements detect it.
 *
 * A sample that is not valid meets no condition on force, travel or depth. A tare, travel 0 and the
 * evaluation elements ignore it. A force code at an end of its range exceeds force_max in every
 * phase. In an evaluated phase (cycle_program_judged()) a sample that is not valid makes the part
 * bad.*/

#include <stdbool.h>
#include <stdint.h>

/* Reasons why a sample is not valid, as bits. */
enum { CYCLE_SAMPLE_VALID = 0, CYCLE_SAMPLE_AT_END = 1, CYCLE_SAMPLE_OLD = 2 };

/* Returns the reasons why a sample is not valid, as bits. is_at_end is true if the force code is at
 * an end of its range. All ages are in ticks. */
static inline uint8_t cycle_sample_defects(bool is_at_end, uint8_t force_age, uint8_t position_age,
                                           uint8_t age_max) {
  const bool is_old = force_age > age_max || position_age > age_max;
  return (uint8_t)((is_at_end ? CYCLE_SAMPLE_AT_END : 0) | (is_old ? CYCLE_SAMPLE_OLD : 0));
}

#endif
