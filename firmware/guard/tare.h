#ifndef FIRMWARE_GUARD_TARE_H_
#define FIRMWARE_GUARD_TARE_H_

/* Taking the tare: force_tare becomes the mean of 2^tare_averaging readings, without the tare of
 * before, half up. Begun by the command `tare`, which is refused while the axis is enabled; from
 * the next tick on it ends, with force_tare as it was, at the first of
 *   refused_enabled  the axis is enabled
 *   refused_sensor   the sensors are not valid, or the reading is at an end of its range
 *   refused_moving   the encoder is more than TARE_JITTER_CNT from where it was at the first tick
 *   refused_noisy    two readings differ by more than tare_noise, unless that is 0
 *   refused_band     the mean is beyond tare_band, or with tare_band 0 beyond the range of
 *                    force_tare
 * The command again begins anew. The date of the verified configuration (1020h) stays: a tare is a
 * measurement. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

enum { TARE_JITTER_CNT = 2 };

typedef struct {
  int32_t start_cnt; /* position at the first tick */
  int32_t tare_q8;   /* found, 1/256 count */
  uint32_t sum;      /* of the codes, below 2^28 */
  uint16_t low;      /* of the codes */
  uint16_t high;
  uint16_t count;    /* codes in the sum */
  uint8_t averaging; /* tare_averaging of the first tick */
  uint8_t running;
  uint8_t found; /* 1: tare_q8 is to be put in force between two ticks */
} tare_t;

/* The command. */
void tare_begin(tare_t *tare, drive_signals_t *signals);

/* After a tick. */
void tare_judge(tare_t *tare, const drive_params_t *params, drive_signals_t *signals,
                const axis_t *axis);
static inline void tare_tick(tare_t *tare, const drive_params_t *params, drive_signals_t *signals,
                             const axis_t *axis) {
  if (tare->running != 0) {
    tare_judge(tare, params, signals, axis);
  }
}

/* The tare that was found is in force (AXIS_TARE_STATE_DONE), or is not put in force:
 * refused_enabled, of an axis that was enabled meanwhile. */
void tare_done(tare_t *tare, drive_signals_t *signals, uint8_t state);

#endif
