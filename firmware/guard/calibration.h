#ifndef FIRMWARE_GUARD_CALIBRATION_H_
#define FIRMWARE_GUARD_CALIBRATION_H_

/* Calibration of the force sensor with two to eight points. Each point consists of a measured force
 * and the force that a reference sensor showed. The slope of a straight line that is fitted to the
 * points by least squares gives force_scale. The linearity error is the largest deviation of a
 * point from this line, divided by the span of the reference forces. With two points the linearity
 * error is 0. The calibration does not use the offset of the line, because the tare (tare.h)
 * determines the offset.
 *
 * The calibration needs some ten thousand instructions of 64-bit arithmetic, so compute it only
 * between ticks. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/objects/generated/axis_objects_drive.h"

enum { CALIBRATION_POINTS = 8 };

/* Smallest permitted span of the measured forces, in 1/256 count. It is 32 counts, an eighth of the
 * range of the measured force. */
enum { CALIBRATION_SPAN_MIN_Q8 = 32 * 256 };

/* Computes the calibration. Returns AXIS_CALIBRATION_STATE_DONE and writes *force_scale and
 * *linearity (in 0.01 per mille), or returns the reason of the failure. The first condition that is
 * true determines the reason:
 *   refused_points     calibration_points is less than 2
 *   refused_date       calibration_validity is not 0 but date is 0, so the firmware could not
 *                      detect the end of the validity
 *   refused_spread     the span of the measured forces is less than CALIBRATION_SPAN_MIN_Q8, or the
 *                      span of the reference forces is 0
 *   refused_sign       the reference force does not rise with the measured force; force_sign may be
 *                      wrong
 *   refused_range      the computed force_scale is 0 or too large
 *   refused_linearity  the linearity error exceeds calibration_linearity_max; this error is written
 *                      to *linearity */
uint8_t calibration_compute(const drive_params_t *params, uint32_t *force_scale,
                            uint16_t *linearity);

/* Returns true if `date` is later than the end of the validity of the calibration. A sensor that
 * was never calibrated is also expired. Returns false if `date` is unknown or calibration_validity
 * is 0. */
static inline bool calibration_is_expired(const drive_params_t *params) {
  return params->calibration_validity != 0 &&
         params->date > (uint32_t)params->calibration_date + params->calibration_validity;
}

#endif
