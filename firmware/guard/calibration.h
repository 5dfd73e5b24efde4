#ifndef FIRMWARE_GUARD_CALIBRATION_H_
#define FIRMWARE_GUARD_CALIBRATION_H_

/* Calibration of the force sensor at two to eight points: readings beside the forces that a
 * reference showed. The straight line through them, by least squares, gives force_scale; the
 * largest distance of a point from it, over the span of the reference forces, is the linearity
 * error. Two points are always on a line. The offset of the line is the tare's business (tare.h).
 *
 * Some ten thousand instructions of 64-bit arithmetic: between ticks only. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

enum { CALIBRATION_POINTS = 8 };

/* The readings must span at least an eighth of the range, 32 counts of 8 bits. */
enum { CALIBRATION_SPAN_MIN_Q8 = 32 * 256 };

/* AXIS_CALIBRATION_STATE_DONE, *force_scale and *linearity (0.01 per mille); or why there is none,
 * the first that applies of
 *   refused_points     calibration_points is less than 2
 *   refused_date       calibration_validity is not 0 and date is: nobody would see it expire
 *   refused_spread     the readings span less than CALIBRATION_SPAN_MIN_Q8, or the forces nothing
 *   refused_sign       the force does not rise with the reading; force_sign may be the other one
 *   refused_range      force_scale would be 0 or too large
 *   refused_linearity  the linearity error, which *linearity then is, exceeds
 *                      calibration_linearity_max */
uint8_t calibration_compute(const drive_params_t *params, uint32_t *force_scale,
                            uint16_t *linearity);

/* Whether `date` is beyond the validity of the calibration; false where the date is not known, or
 * calibration_validity is 0. A sensor that was never calibrated has expired. */
static inline bool calibration_is_expired(const drive_params_t *params) {
  return params->calibration_validity != 0 &&
         params->date > (uint32_t)params->calibration_date + params->calibration_validity;
}

#endif
