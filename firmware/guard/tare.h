#ifndef FIRMWARE_GUARD_TARE_H_
#define FIRMWARE_GUARD_TARE_H_

/* The tare measurement sets force_tare to the mean of 2^tare_averaging measured forces, rounded
 * half up. The previous tare is not subtracted from these forces. The command `tare` starts the
 * measurement; the command is refused while the axis is enabled. From the next tick on, each of the
 * following conditions ends the measurement and leaves force_tare unchanged. The first condition
 * that is true determines the state:
 *   refused_enabled  the axis is enabled
 *   refused_sensor   the sensors are not valid, or the force code is at an end of its range
 *   refused_moving   the encoder moved by more than TARE_JITTER_CNT since the first tick
 *   refused_noisy    two measured forces differ by more than tare_noise, unless tare_noise is 0
 *   refused_band     the magnitude of the mean exceeds tare_band; if tare_band is 0, it exceeds the
 *                    range of force_tare
 * A repeated command restarts the measurement. The date of the verified configuration (1020h) does
 * not change, because a tare is a measurement.*/

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/objects/generated/axis_objects_drive.h"

enum { TARE_JITTER_CNT = 2 };

typedef struct {
  int32_t start_cnt; /* encoder count in the first tick of the measurement */
  int32_t tare_q8;   /* measured tare, in 1/256 count */
  uint32_t sum;      /* sum of the ADC codes of the tare measurement, below 2^28 */
  /* low: smallest ADC code of the force during the tare measurement; high: largest ADC code during
   * it */
  uint16_t low;
  uint16_t high;
  uint16_t count;    /* number of ADC codes that were added to `sum` */
  uint8_t averaging; /* value of the object tare_averaging at the start of the tare measurement */
  uint8_t running;
  /* 1 if the measurement is complete; the tare tare_q8 becomes active between two ticks */
  uint8_t found;
} tare_t;

/* Starts a tare measurement. */
void tare_begin(tare_t *tare, drive_signals_t *signals);

/* Adds the force code of a tick to the tare measurement. Ends the measurement if it is complete or
 * refused. */
void tare_add_sample(tare_t *tare, const drive_params_t *params, drive_signals_t *signals,
                     const axis_t *axis);
static inline void tare_tick(tare_t *tare, const drive_params_t *params, drive_signals_t *signals,
                             const axis_t *axis) {
  if (tare->running != 0) {
    tare_add_sample(tare, params, signals, axis);
  }
}

/* Ends a tare measurement with the given state. The state is AXIS_TARE_STATE_DONE if the new tare
 * is active. It is refused_enabled if the axis was enabled meanwhile, so that the new tare is not
 * used. */
void tare_done(tare_t *tare, drive_signals_t *signals, uint8_t state);

#endif
