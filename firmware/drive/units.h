#ifndef FIRMWARE_DRIVE_UNITS_H_
#define FIRMWARE_DRIVE_UNITS_H_

/* Between the user's units and the axis'.
 *
 * Without a feed (6092h:1 = 0) the user's unit is the encoder count: position = +-(encoder +
 * origin), modulo 2^32. With one, position = R(+-(encoder + origin) n / d), where R rounds half up
 * and n / d = feed * encoder revolutions * gear shaft revolutions / (feed shaft revolutions *
 * encoder increments * gear motor revolutions) in lowest terms. Each position is converted exactly
 * from the whole count, never from a change of it, so no rounding accumulates. Positions then have
 * two ends instead of wrapping, where count or user's unit leaves 32 bits: they saturate there, and
 * no mode moves across. Of the drive, only objects of CiA 402 are in user's units; those at 2000h,
 * 6063h and 6069h are in counts. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"
#include "firmware/drive/trajectory.h"
#include "firmware/fx/fx.h"

enum { CIA402_POLARITY_VELOCITY = 0x40, CIA402_POLARITY_POSITION = 0x80 };

/* Whether the ratio depends on this parameter (AXIS_OBJ_). */
bool units_depend_on(uint16_t object);

/* Whether the parameters, of which `object` is about to be `value`, give a ratio: n and d below
 * 2^31, n / d from 2^-20 to 2^21. */
bool units_fit(const drive_params_t *params, uint16_t object, int32_t value);

/* Adopts the parameters; ones that give no ratio count as without a feed. */
void units_derive(cia402_t *drive);

static inline int32_t cia402_signed_by(const cia402_t *drive, int32_t value, uint8_t bit) {
  return ((drive->params.polarity & bit) != 0) ? fx_diff_wrap(0, value) : value;
}

/* The user's position of an encoder count. */
static inline int32_t cia402_user(const cia402_t *drive, int32_t encoder_cnt) {
  const int32_t count = cia402_signed_by(drive, fx_sum_wrap(encoder_cnt, drive->origin_cnt),
                                         CIA402_POLARITY_POSITION);
  return (drive->units.scaled == 0) ? count : fx_fraction_apply(count, &drive->units.user_of_cnt);
}

/* The count of a user's position from the origin. */
static inline int32_t cia402_count(const cia402_t *drive, int32_t user) {
  const int32_t count =
      (drive->units.scaled == 0) ? user : fx_fraction_invert(user, &drive->units.user_of_cnt);
  return cia402_signed_by(drive, count, CIA402_POLARITY_POSITION);
}

/* The encoder count of a user's position. */
static inline int32_t cia402_encoder(const cia402_t *drive, int32_t user) {
  return fx_diff_wrap(cia402_count(drive, user), drive->origin_cnt);
}

/* A speed of the user's, at most 2^31-1, and a rate, in the trajectory's units; what is not 0 is 1
 * at least. */
int32_t units_speed_q16(const cia402_t *drive, uint32_t per_s);
int32_t units_rate_q16(const cia402_t *drive, uint32_t per_s2);

/* A speed in count/s in the user's units, in the direction of the user. */
static inline int32_t units_user_speed(const cia402_t *drive, int32_t count_per_s) {
  const int32_t speed = cia402_signed_by(drive, count_per_s, CIA402_POLARITY_VELOCITY);
  return (drive->units.scaled == 0) ? speed
                                    : fx_ratio_apply(speed, drive->units.user_of_cnt.ratio, 0);
}

/* A speed in the trajectory's units, limited to velocity_max: of the user's, and in count/s. */
static inline int32_t cia402_speed_q16(const cia402_t *drive, uint32_t per_s) {
  return (per_s < drive->params.velocity_max) ? units_speed_q16(drive, per_s) : drive->speed_max;
}
static inline int32_t units_speed_of_cnt(const cia402_t *drive, uint32_t count_per_s) {
  const int32_t speed = fx_q16_from_per_s(count_per_s);
  return (speed < drive->speed_max) ? speed : drive->speed_max;
}

/* Trajectory limits from speed in Q16 and the profile's rates. */
static inline trajectory_limits_t cia402_limits(const cia402_t *drive, int32_t speed_q16) {
  return (trajectory_limits_t){
      .speed = speed_q16, .acceleration = drive->acceleration, .deceleration = drive->deceleration};
}

#endif
