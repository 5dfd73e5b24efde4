#ifndef FIRMWARE_GUARD_SENSOR_H_
#define FIRMWARE_GUARD_SENSOR_H_

/* Monitors the force sensor while the motion of the axis depends on the measured force: in force
 * modes, guarded moves and homing, including their approaches, and in every phase of a cycle. Each
 * detected error is a fault with its own name and disables the axis in the same tick. Each check
 * has an object that switches it on. By default all checks are off.
 *
 *   force_railed        The force code was at an end of its range for force_railed_time. The lower
 *                       end of an unsigned code (force_zero_code 0) is not checked, because it
 *                       means no force. A hard contact may saturate the code, so force_railed_time
 *                       must exceed the longest such saturation.
 *   force_jump          The measured force changed by more than force_jump_max in one tick, for
 *                       example because a wire breaks during contact. force_jump_max must exceed
 *                       the largest change during an impact.
 *   force_stuck         In contact the axis moved by more than force_stuck_travel within
 *                       force_stuck_time while the force code did not change. force_stuck_travel
 *                       must exceed the deflection of several codes and the travel during the delay
 *                       of a filter.
 *   force_disconnected  Without contact the magnitude of the DAC code, without the output bias, was
 *                       at least force_disconnected_code for force_disconnected_time, and the axis
 *                       moved by at most force_disconnected_travel. Either the axis presses on an
 *                       object without a measured force, or it is at a mechanical end stop.
 *
 * The times are rounded up to ticks and include the first tick of the condition. force_stuck and
 * force_disconnected are checked in every fourth tick, so these faults act up to five ticks later.
 * After enabling, the axis is monitored from its third tick at the latest.
 *
 * The following defects are not detected. At standstill with a small DAC code, a constant force
 * code is not detected, because a controlled force also gives a constant code. A constant measured
 * force with noise is not detected. A wrong scale, offset or sign is not detected within the limits
 * of the other protections (first_motion.h, tare.h). An axis that moves freely without contact
 * produces no force that could be checked; the bounds of the approach stop this axis. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects_drive.h"

/* Conditions that are monitored over a time window. In each time window the firmware monitors one
 * of them. */
enum { SENSOR_WINDOW_NONE, SENSOR_WINDOW_STUCK, SENSOR_WINDOW_DISCONNECTED };

typedef struct {
  /* encoder count at the start of the time window in which the sensor is monitored */
  int32_t start_cnt;
  uint16_t code; /* ADC code of the force in the previous tick */
  uint16_t railed_tick;
  /* number of ticks since the start of the time window in which the sensor is monitored */
  uint16_t window_tick;
  uint8_t window;  /* condition that is monitored in the present time window, SENSOR_WINDOW_ */
  uint8_t changed; /* 1 if the force code has changed since the last check of the time window */
  uint8_t enabled; /* 1 if at least one check of the force sensor is switched on */
  /* 1 if a check is switched on and the motion of the axis now depends on the measured force */
  uint8_t active;
} sensor_t;

/* Returns true if the force code is at an end of its range. At the lower end of an unsigned code
 * the result is false, because this code means that there is no force. */
static inline bool sensor_is_railed(const axis_t *axis) {
  const uint16_t code = axis->signals.force_raw;
  return code >= fx_highest_code(axis->params.adc_bits) ||
         (code == 0 && axis->params.force_zero_code != 0);
}

/* Computes the values of the sensor monitoring that depend on its parameters. Call this function
 * after a write to these parameters. */
void sensor_derive(sensor_t *sensor, const drive_params_t *params);

/* Sets whether the motion of the axis depends on the measured force from the next tick on. Call
 * this function after every second tick while a check is switched on. */
void sensor_guides(sensor_t *sensor, const axis_t *axis, bool guides);

/* Checks the force sensor. Call this function after axis_tick() and before the outputs are written,
 * because a detected error sets the outputs to the safe state. */
void sensor_check_active(sensor_t *sensor, const drive_params_t *params, axis_t *axis,
                         axis_outputs_t *outputs);
static inline void sensor_check(sensor_t *sensor, const drive_params_t *params, axis_t *axis,
                                axis_outputs_t *outputs) {
  if (sensor->active != 0) {
    sensor_check_active(sensor, params, axis, outputs);
  }
}

#endif
