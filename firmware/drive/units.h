#ifndef FIRMWARE_DRIVE_UNITS_H_
#define FIRMWARE_DRIVE_UNITS_H_

/* Between the user's units and the axis': position = +-(encoder + origin), modulo 2^32. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"
#include "firmware/drive/trajectory.h"
#include "firmware/fx/fx.h"

enum { CIA402_POLARITY_VELOCITY = 0x40, CIA402_POLARITY_POSITION = 0x80 };

static inline int32_t cia402_signed_by(const cia402_t *drive, int32_t value, uint8_t bit) {
  return ((drive->params.polarity & bit) != 0) ? fx_diff_wrap(0, value) : value;
}

/* The user's position of an encoder count. */
static inline int32_t cia402_user(const cia402_t *drive, int32_t encoder_cnt) {
  const int32_t count = fx_sum_wrap(encoder_cnt, drive->origin_cnt);
  return cia402_signed_by(drive, count, CIA402_POLARITY_POSITION);
}

/* The encoder count of a user's position. */
static inline int32_t cia402_encoder(const cia402_t *drive, int32_t user) {
  const int32_t count = cia402_signed_by(drive, user, CIA402_POLARITY_POSITION);
  return fx_diff_wrap(count, drive->origin_cnt);
}

/* A speed in the trajectory's units, limited to velocity_max. */
static inline int32_t cia402_speed_q16(const cia402_t *drive, uint32_t count_per_s) {
  return (count_per_s < drive->params.velocity_max) ? fx_q16_from_per_s(count_per_s)
                                                    : drive->speed_max;
}

/* Trajectory limits from speed in Q16 and the profile's rates. */
static inline trajectory_limits_t cia402_limits(const cia402_t *drive, int32_t speed_q16) {
  return (trajectory_limits_t){
      .speed = speed_q16, .acceleration = drive->acceleration, .deceleration = drive->deceleration};
}

#endif
