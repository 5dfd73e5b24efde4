#ifndef FIRMWARE_GUARD_SENSOR_H_
#define FIRMWARE_GUARD_SENSOR_H_

/* Monitoring of the force sensor while the measured force guides the axis: in the force modes,
 * guarded moves and homing, including their approaches. Each finding disables the axis in the same
 * tick as a fault with its own name. Each check has an object that switches it on, and all checks
 * are off by default.
 *
 *   force_railed        The force code was at an end of its range for force_railed_time. The lower
 *                       end of an unsigned code (force_zero_code 0) only means no force. A hard
 *                       contact may saturate the code, so the time must exceed the longest such
 *                       saturation.
 *   force_jump          The measured force changed by more than force_jump_max in one tick, as with
 *                       a wire that breaks during contact. The limit must exceed the steepest
 * change of an impact. force_stuck         In contact the axis moved by more than
 * force_stuck_travel within force_stuck_time while the force code did not change. The travel must
 * exceed the deflection of several codes, and the travel during the delay of a filter.
 *   force_disconnected  Without contact the magnitude of the DAC code was at least
 *                       force_disconnected_code for force_disconnected_time, and the axis moved by
 *                       at most force_disconnected_travel: it presses on an object without a
 *                       measured force, or is at a mechanical end stop.
 *
 * The times are rounded up to ticks and include the first tick of the condition. force_stuck and
 * force_disconnected are checked in every fourth tick, so they act up to five ticks later. After
 * enabling, the axis is monitored from its third tick at the latest.
 *
 * These faults are not detected: a constant force code while the axis is at standstill with a small
 * DAC code (a controlled force also has a constant code); a constant code with noise; a wrong
 * scale, offset or sign within the limits of the other protections (first_motion.h, tare.h). An
 * axis that moves freely without contact produces no force that could be checked; the bounds of the
 * approach stop it. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/fx/fx.h"

/* Condition that the present time window checks. */
enum { SENSOR_WINDOW_NONE, SENSOR_WINDOW_STUCK, SENSOR_WINDOW_DISCONNECTED };

typedef struct {
  int32_t start_cnt; /* encoder count at the start of the window */
  uint16_t code;     /* force code of the previous tick */
  uint16_t railed_tick;
  uint16_t window_tick; /* ticks since the window began */
  uint8_t window;       /* SENSOR_WINDOW_ */
  uint8_t changed;      /* 1: the force code changed since the last check of the window */
  uint8_t enabled;      /* 1: one of the objects that switch the checks on is not 0 */
  uint8_t active;       /* 1: a check is switched on, and the measured force guides the axis */
} sensor_t;

/* Whether the force code is at an end of its range. The lower end of an unsigned code does not
 * count, because it means no force. */
static inline bool sensor_is_railed(const axis_t *axis) {
  const uint16_t code = axis->signals.force_raw;
  return code >= fx_highest_code(axis->params.adc_bits) ||
         (code == 0 && axis->params.force_zero_code != 0);
}

/* Derives the values of the sensor monitoring after a write to its parameters. */
void sensor_derive(sensor_t *sensor, const drive_params_t *params);

/* Sets whether the measured force guides the axis from now on. Call it after every second tick
 * while a check is switched on. */
void sensor_guides(sensor_t *sensor, const axis_t *axis, bool guides);

/* Checks the force sensor after axis_tick() and before the outputs are written. A finding sets the
 * outputs to the safe state. */
void sensor_check_active(sensor_t *sensor, const drive_params_t *params, axis_t *axis,
                         axis_outputs_t *outputs);
static inline void sensor_check(sensor_t *sensor, const drive_params_t *params, axis_t *axis,
                                axis_outputs_t *outputs) {
  if (sensor->active != 0) {
    sensor_check_active(sensor, params, axis, outputs);
  }
}

#endif
