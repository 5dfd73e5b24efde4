#ifndef FIRMWARE_GUARD_TARE_H_
#define FIRMWARE_GUARD_TARE_H_

/* The tare measurement: force_tare becomes the mean of 2^tare_averaging measured forces, without
 * the previous tare, rounded half up. The command `tare` starts it and is refused while the axis is
 * enabled. From the next tick on, the first of these conditions ends the measurement and leaves
 * force_tare unchanged:
 *   refused_enabled  the axis is enabled
 *   refused_sensor   the sensors are not valid, or the force code is at an end of its range
 *   refused_moving   the encoder is more than TARE_JITTER_CNT from its count in the first tick
 *   refused_noisy    two measured forces differ by more than tare_noise, unless tare_noise is 0
 *   refused_band     the mean is beyond tare_band or, with tare_band 0, beyond the range of
 *                    force_tare
 * A repeated command starts the measurement again. The date of the verified configuration (1020h)
 * does not change, because a tare is a measurement. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

enum { TARE_JITTER_CNT = 2 };

typedef struct {
  int32_t start_cnt; /* encoder count in the first tick */
  int32_t tare_q8;   /* measured tare, in 1/256 count */
  uint32_t sum;      /* sum of the ADC codes, below 2^28 */
  uint16_t low;      /* smallest ADC code so far; high: the largest */
  uint16_t high;
  uint16_t count;    /* number of ADC codes in the sum */
  uint8_t averaging; /* tare_averaging in the first tick */
  uint8_t running;
  uint8_t found; /* 1: tare_q8 becomes active between two ticks */
} tare_t;

/* Starts a tare measurement. */
void tare_begin(tare_t *tare, drive_signals_t *signals);

/* Adds the force code of a tick to the tare measurement, and ends it when it is complete or
 * refused. */
void tare_add_sample(tare_t *tare, const drive_params_t *params, drive_signals_t *signals,
                     const axis_t *axis);
static inline void tare_tick(tare_t *tare, const drive_params_t *params, drive_signals_t *signals,
                             const axis_t *axis) {
  if (tare->running != 0) {
    tare_add_sample(tare, params, signals, axis);
  }
}

/* Ends a tare measurement with a state: AXIS_TARE_STATE_DONE if the new tare is active, or
 * refused_enabled if the axis was enabled meanwhile and the tare was not used. */
void tare_done(tare_t *tare, drive_signals_t *signals, uint8_t state);

#endif
