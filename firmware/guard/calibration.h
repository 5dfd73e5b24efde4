#ifndef FIRMWARE_GUARD_CALIBRATION_H_
#define FIRMWARE_GUARD_CALIBRATION_H_

/* Calibration of the force sensor with two to eight points. Each point has a measured force and the
 * force that a reference showed. A straight line by least squares through the points gives
 * force_scale. The linearity error is the largest distance of a point from the line, divided by the
 * span of the reference forces. Two points are always on a line. The tare (tare.h) determines the
 * offset of the line.
 *
 * The computation needs some ten thousand instructions of 64-bit arithmetic: call it only between
 * ticks. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

enum { CALIBRATION_POINTS = 8 };

/* Smallest span of the measured forces: an eighth of the range, 32 counts of 8 bits. */
enum { CALIBRATION_SPAN_MIN_Q8 = 32 * 256 };

/* Returns AXIS_CALIBRATION_STATE_DONE, and writes *force_scale and *linearity (in 0.01 per mille).
 * Otherwise it returns why the calibration failed; the first condition that is true decides:
 *   refused_points     calibration_points is less than 2
 *   refused_date       calibration_validity is not 0 but date is 0, so an expiry could not be seen
 *   refused_spread     the measured forces span less than CALIBRATION_SPAN_MIN_Q8, or the
 *                      reference forces have no span
 *   refused_sign       the force does not rise with the measured force; force_sign may be wrong
 *   refused_range      force_scale would be 0 or too large
 *   refused_linearity  the linearity error exceeds calibration_linearity_max; *linearity then has
 *                      this error */
uint8_t calibration_compute(const drive_params_t *params, uint32_t *force_scale,
                            uint16_t *linearity);

/* Whether `date` is after the end of the validity of the calibration. A sensor that was never
 * calibrated counts as expired. Returns false if the date is not known or calibration_validity is
 * 0. */
static inline bool calibration_is_expired(const drive_params_t *params) {
  return params->calibration_validity != 0 &&
         params->date > (uint32_t)params->calibration_date + params->calibration_validity;
}

#endif
