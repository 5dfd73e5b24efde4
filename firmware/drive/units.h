#ifndef FIRMWARE_DRIVE_UNITS_H_
#define FIRMWARE_DRIVE_UNITS_H_

/* Conversion between user units and the units of the axis.
 *
 * Without a feed (6092h:1 = 0) the user unit is the encoder count: position = +-(encoder + origin),
 * modulo 2^32. With a feed, position = R(+-(encoder + origin) n / d). R rounds half up, and n / d =
 * feed * encoder revolutions * gear shaft revolutions / (feed shaft revolutions * encoder
 * increments * gear motor revolutions) in lowest terms. Each position is converted exactly from the
 * complete count, never from a difference of counts, so rounding errors do not accumulate.
 *
 * With a feed, positions do not wrap. A position saturates if the count or the position in user
 * units would exceed 32 bits. No mode moves the axis across the two ends of this range. Only the
 * CiA 402 objects of the drive are in user units. The objects from 2000h on, 6063h and 6069h are in
 * counts. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive_state.h"
#include "firmware/drive/trajectory.h"
#include "firmware/fx/fx.h"

/* Returns true if the ratio of user units to counts depends on the parameter `object`
 * (AXIS_OBJ_). */
bool units_depend_on(uint16_t object);

/* Returns true if the ratio of user units to counts would be valid after a write of `value` to
 * `object`. A ratio is valid if n and d are below 2^31, and n / d is from 2^-20 to 2^21. */
bool units_fit(const drive_params_t *params, uint16_t object, int32_t value);

/* Computes the user units from the parameters. If the parameters give no valid ratio, the user unit
 * is the encoder count, as if there were no feed. */
void units_derive(cia402_t *drive);

static inline int32_t cia402_signed_by(const cia402_t *drive, int32_t value, uint8_t bit) {
  return ((drive->params.polarity & bit) != 0) ? fx_diff_wrap(0, value) : value;
}

/* Converts an encoder count to a position in user units. */
static inline int32_t cia402_user(const cia402_t *drive, int32_t encoder_cnt) {
  const int32_t count =
      cia402_signed_by(drive, fx_sum_wrap(encoder_cnt, drive->origin_cnt), AXIS_POLARITY_POSITION);
  return (drive->units.scaled == 0) ? count : fx_fraction_apply(count, &drive->units.user_of_cnt);
}

/* Converts a position in user units to the number of counts from the origin. */
static inline int32_t cia402_count(const cia402_t *drive, int32_t user) {
  const int32_t count =
      (drive->units.scaled == 0) ? user : fx_fraction_invert(user, &drive->units.user_of_cnt);
  return cia402_signed_by(drive, count, AXIS_POLARITY_POSITION);
}

/* Converts a position in user units to an encoder count. */
static inline int32_t cia402_encoder(const cia402_t *drive, int32_t user) {
  return fx_diff_wrap(cia402_count(drive, user), drive->origin_cnt);
}

/* units_speed_q16() converts a speed of at most 2^31-1 user units per second to the unit of the
 * trajectory, and units_rate_q16() converts an acceleration. If the value is not 0, the result is
 * at least 1. */
int32_t units_speed_q16(const cia402_t *drive, uint32_t per_s);
int32_t units_rate_q16(const cia402_t *drive, uint32_t per_s2);

/* Converts a speed in count/s to user units per second, in the direction of the user positions. */
static inline int32_t units_user_speed(const cia402_t *drive, int32_t count_per_s) {
  const int32_t speed = cia402_signed_by(drive, count_per_s, AXIS_POLARITY_VELOCITY);
  return (drive->units.scaled == 0) ? speed
                                    : fx_ratio_apply(speed, drive->units.user_of_cnt.ratio, 0);
}

/* Converts a speed to the units of the trajectory and limits the result to velocity_max. The speed
 * is in user units per second for cia402_speed_q16() and in count/s for units_speed_of_cnt(). */
static inline int32_t cia402_speed_q16(const cia402_t *drive, uint32_t per_s) {
  return (per_s < drive->params.velocity_max) ? units_speed_q16(drive, per_s) : drive->speed_max;
}
static inline int32_t units_speed_of_cnt(const cia402_t *drive, uint32_t count_per_s) {
  const int32_t speed = fx_q16_from_per_s(count_per_s);
  return (speed < drive->speed_max) ? speed : drive->speed_max;
}

/* Returns the limits of a trajectory: the given speed in Q16 counts per tick, the profile
 * acceleration and the profile deceleration. */
static inline trajectory_limits_t cia402_limits(const cia402_t *drive, int32_t speed_q16) {
  return (trajectory_limits_t){
      .speed = speed_q16, .acceleration = drive->acceleration, .deceleration = drive->deceleration};
}

#endif
