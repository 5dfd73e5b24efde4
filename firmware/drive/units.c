#include "firmware/drive/units.h"

/* Largest speed of the trajectory, in Q16 counts per tick: 3,072,000 count/s. */
#define SPEED_MAX_Q16 INT32_C(134217728)

enum { RATIO_BITS_MAX = 20 };

bool units_depend_on(uint16_t object) {
  return object == AXIS_OBJ_ENCODER_INCREMENTS || object == AXIS_OBJ_ENCODER_REVOLUTIONS ||
         object == AXIS_OBJ_GEAR_MOTOR_REVOLUTIONS || object == AXIS_OBJ_GEAR_SHAFT_REVOLUTIONS ||
         object == AXIS_OBJ_FEED || object == AXIS_OBJ_FEED_SHAFT_REVOLUTIONS;
}

/* Value that the parameter OBJECT has after the write: `value` if OBJECT is the object that is
 * written, otherwise the stored value of OBJECT. */
#define VALUE_OF(OBJECT, stored) ((object == (OBJECT)) ? (uint32_t)value : (stored))

static bool ratio_of(const drive_params_t *params, uint16_t object, int32_t value,
                     fx_fraction_t *ratio) {
  const uint32_t over[3] = {
      VALUE_OF(AXIS_OBJ_FEED, params->feed),
      VALUE_OF(AXIS_OBJ_ENCODER_REVOLUTIONS, params->encoder_revolutions),
      VALUE_OF(AXIS_OBJ_GEAR_SHAFT_REVOLUTIONS, params->gear_shaft_revolutions)};
  const uint32_t under[3] = {
      VALUE_OF(AXIS_OBJ_FEED_SHAFT_REVOLUTIONS, params->feed_shaft_revolutions),
      VALUE_OF(AXIS_OBJ_ENCODER_INCREMENTS, params->encoder_increments),
      VALUE_OF(AXIS_OBJ_GEAR_MOTOR_REVOLUTIONS, params->gear_motor_revolutions)};
  return fx_fraction(over, under, ratio) && fx_ratio_is_moderate(ratio->ratio, RATIO_BITS_MAX);
}

bool units_fit(const drive_params_t *params, uint16_t object, int32_t value) {
  const uint32_t feed = VALUE_OF(AXIS_OBJ_FEED, params->feed);
  fx_fraction_t ratio;
  return feed == 0 || ratio_of(params, object, value, &ratio);
}

void units_derive(cia402_t *drive) {
  cia402_units_t *units = &drive->units;
  const drive_params_t *params = &drive->params;
  const bool scaled = params->feed != 0 && ratio_of(params, AXIS_OBJ_NONE, 0, &units->user_of_cnt);
  units->scaled = scaled ? 1 : 0;
  if (scaled) {
    /* The division by 1500 converts from seconds to ticks. The results have 16 fractional bits. */
    units->speed_of_user = fx_ratio_divided(units->user_of_cnt.inverse, 1500, -16);
    units->rate_of_user = fx_ratio_divided(units->user_of_cnt.inverse, UINT32_C(2250000), -16);
  }
}

int32_t units_speed_q16(const cia402_t *drive, uint32_t per_s) {
  if (drive->units.scaled == 0) {
    return fx_q16_from_per_s(per_s);
  }
  const int32_t speed = fx_ratio_apply((int32_t)per_s, drive->units.speed_of_user, 0);
  return fx_clamp(speed, (per_s == 0) ? 0 : 1, SPEED_MAX_Q16);
}

int32_t units_rate_q16(const cia402_t *drive, uint32_t per_s2) {
  if (drive->units.scaled == 0) {
    return fx_q16_from_per_s2(per_s2);
  }
  return fx_clamp(fx_ratio_apply((int32_t)per_s2, drive->units.rate_of_user, 0), 1,
                  TRAJECTORY_RATE_MAX);
}
