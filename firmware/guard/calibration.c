#include "firmware/guard/calibration.h"

#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects_drive.h"

/* Deviations of the calibration points from the mean of all points. The deviations are multiplied
 * by the number of points, so that nothing is rounded. |x| <= 2^21, |y| <= 2^34, and sums of
 * products are below 2^58. */
typedef struct {
  /* for each point, deviation of the measured force from its mean, in 1/256 count, times the number
   * of points */
  int32_t x[CALIBRATION_POINTS];
  /* for each point, deviation of the reference force from its mean, in mN, times the number of
   * points */
  int64_t y[CALIBRATION_POINTS];
  int64_t xx; /* sum of x^2 over all calibration points */
  int64_t xy; /* sum of x y over all calibration points */
  int64_t x_span;
  int64_t y_span;
  uint8_t count;
} points_t;

typedef struct {
  int64_t low;
  int64_t high;
  int64_t sum;
} range_t;

static range_t range_of(const int32_t *values, uint8_t count) {
  range_t range = {.low = values[0], .high = values[0], .sum = 0};
  for (uint8_t i = 0; i < count; i++) {
    range.low = (values[i] < range.low) ? values[i] : range.low;
    range.high = (values[i] > range.high) ? values[i] : range.high;
    range.sum += values[i];
  }
  return range;
}

static void gather(const drive_params_t *params, points_t *points) {
  const uint8_t count = params->calibration_points;
  const range_t x = range_of(params->calibration_reading, count);
  const range_t y = range_of(params->calibration_force, count);
  points->count = count;
  points->xx = 0;
  points->xy = 0;
  for (uint8_t i = 0; i < count; i++) {
    points->x[i] = (int32_t)((int64_t)params->calibration_reading[i] * count - x.sum);
    points->y[i] = (int64_t)params->calibration_force[i] * count - y.sum;
    points->xx += fx_mul(points->x[i], points->x[i]);
    points->xy += points->x[i] * points->y[i];
  }
  points->x_span = (x.high - x.low) * count;
  points->y_span = (y.high - y.low) * count;
}

/* Returns y * 2^e. */
static int32_t scaled(int64_t y, int8_t e) {
  /* The value is shifted bit by bit, because on some processors a 64-bit shift by a variable calls
   * a library function. */
  for (; e < 0; e++) {
    y = fx_floor_shift_wide(y, 1);
  }
  return (int32_t)(y * fx_scale(1, (uint32_t)e));
}

/* Returns the linearity error: the largest |y - slope x| divided by the span of y, in 0.01 per
 * mille. The reference forces are scaled so that their span is 2^28 to 2^29. Rounding errors are
 * then negligible. */
static uint16_t linearity_of(const points_t *points) {
  int8_t e = 0;
  int64_t span = points->y_span;
  for (; span >= INT64_C(536870912); span = fx_floor_shift_wide(span, 1)) {
    e = (int8_t)(e - 1);
  }
  for (; span < INT64_C(268435456); span *= 2) {
    e = (int8_t)(e + 1);
  }
  const fx_ratio_t slope = fx_ratio_wide((uint64_t)points->xy, (uint64_t)points->xx, e);
  uint32_t worst = 0;
  for (uint8_t i = 0; i < points->count; i++) {
    const int32_t line = fx_ratio_apply(points->x[i], slope, 0);
    const uint32_t error = fx_magnitude(fx_diff_wrap(scaled(points->y[i], e), line));
    worst = (error > worst) ? error : worst;
  }
  if (worst == 0) {
    return 0;
  }
  const fx_ratio_t share = fx_ratio(worst, (uint32_t)span, 0);
  return (uint16_t)fx_clamp(fx_ratio_apply(100000, share, 0), 0, UINT16_MAX);
}

uint8_t calibration_compute(const drive_params_t *params, uint32_t *force_scale,
                            uint16_t *linearity) {
  if (params->calibration_points < 2) {
    return AXIS_CALIBRATION_STATE_REFUSED_POINTS;
  }
  if (params->calibration_validity != 0 && params->date == 0) {
    return AXIS_CALIBRATION_STATE_REFUSED_DATE;
  }
  points_t points;
  gather(params, &points);
  if (points.x_span < (int64_t)CALIBRATION_SPAN_MIN_Q8 * points.count || points.y_span == 0) {
    return AXIS_CALIBRATION_STATE_REFUSED_SPREAD;
  }
  if (points.xy <= 0) {
    return AXIS_CALIBRATION_STATE_REFUSED_SIGN;
  }
  /* A slope of 1 mN per 1/256 count is 256000 uN per count. */
  const fx_ratio_t slope = fx_ratio_wide((uint64_t)points.xy, (uint64_t)points.xx, 0);
  const int32_t scale = fx_ratio_apply(256000, slope, 0);
  if (scale == 0 || scale == INT32_MAX) {
    return AXIS_CALIBRATION_STATE_REFUSED_RANGE;
  }
  *linearity = linearity_of(&points);
  if (*linearity > params->calibration_linearity_max) {
    return AXIS_CALIBRATION_STATE_REFUSED_LINEARITY;
  }
  *force_scale = (uint32_t)scale;
  return AXIS_CALIBRATION_STATE_DONE;
}
