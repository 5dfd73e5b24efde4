#ifndef FIRMWARE_CYCLE_SAMPLE_H_
#define FIRMWARE_CYCLE_SAMPLE_H_

/* Which samples of force and position decide on a part. A sample is valid if
 *   - the force code is at no end of its range. The lower end counts only if the zero of the force
 *     is not there, because code 0 is then the force 0;
 *   - force and position are at most cycle_age_max ticks old;
 *   - no protection that is switched on is tripped. A protection that trips is a fault, which
 *     aborts the cycle, so it needs no bit here.
 *
 * A wire that breaks and then reads zero is not seen here: force_disconnected (guard/sensor.h) and
 * the lower bounds of the elements find it.
 *
 * A sample that is not valid meets no condition of force, travel or depth, is no part of a tare,
 * finds no travel 0 and is passed over by the elements. At an end of the range it exceeds force_max
 * in every phase. In a phase that is judged (cycle_program_judged()) it makes the part bad. */

#include <stdbool.h>
#include <stdint.h>

/* Why a sample is not valid, as bits. */
enum { CYCLE_SAMPLE_VALID = 0, CYCLE_SAMPLE_AT_END = 1, CYCLE_SAMPLE_OLD = 2 };

/* Returns the bits of a sample whose force code is at an end of its range or not; ages in ticks. */
static inline uint8_t cycle_sample_defects(bool is_at_end, uint8_t force_age, uint8_t position_age,
                                           uint8_t age_max) {
  const bool is_old = force_age > age_max || position_age > age_max;
  return (uint8_t)((is_at_end ? CYCLE_SAMPLE_AT_END : 0) | (is_old ? CYCLE_SAMPLE_OLD : 0));
}

#endif
