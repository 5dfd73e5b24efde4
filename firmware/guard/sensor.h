#ifndef FIRMWARE_GUARD_SENSOR_H_
#define FIRMWARE_GUARD_SENSOR_H_

/* Supervision of the force sensor while its reading guides the axis: in the force modes, guarded
 * moves and homing, their approaches included. Each finding disables the axis in its own tick, as a
 * fault by name; each has an object that switches it on, and all are off by default.
 *
 *   force_railed        the reading was at an end of its range for force_railed_time. The lower end
 *                       of an unsigned reading (force_zero_code 0) is just no force. A hard contact
 *                       may saturate the reading, so the time must exceed that of the worst one.
 *   force_jump          the reading changed by more than force_jump_max from one tick to the next:
 *                       a wire that breaks in contact. The limit must exceed the steepest impact.
 *   force_stuck         in contact the axis moved by more than force_stuck_travel within
 *                       force_stuck_time, and the reading stayed at the same code. The travel must
 *                       exceed the deflection of several codes, and the way of a filter's delay.
 *   force_disconnected  without contact the code had at least the magnitude
 *                       force_disconnected_code for force_disconnected_time, and the axis moved by
 *                       at most force_disconnected_travel: it presses against something that the
 *                       sensor does not show, or an end stop.
 *
 * Times are in ticks of at least that length, the first tick of the condition included; stuck and
 * disconnected are judged in every fourth tick, so up to five ticks later. An axis that was just
 * enabled is supervised from its third tick on at the latest.
 *
 * What it cannot detect: a reading that is stuck or at the code of no force while the axis stands
 * with a small code (a held force has a constant reading); one that is stuck and still flickers; a
 * wrong scale, offset or sign that is within the limits of the others (first_motion.h, tare.h). An
 * axis that is lost without contact and free to move has no force to be seen: the bounds of the
 * approach stop it. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/fx/fx.h"

/* What the window of some ticks is about. */
enum { SENSOR_WINDOW_NONE, SENSOR_WINDOW_STUCK, SENSOR_WINDOW_DISCONNECTED };

typedef struct {
  int32_t start_cnt; /* where the window began */
  uint16_t code;     /* reading of the tick before */
  uint16_t railed_tick;
  uint16_t window_tick; /* ticks since the window began */
  uint8_t window;       /* SENSOR_WINDOW_ */
  uint8_t changed;      /* 1: the code changed since the window was last judged */
  uint8_t enabled;      /* 1: one of the objects is not 0 */
  uint8_t active;       /* 1: it is, and the reading guides the axis */
} sensor_t;

/* The reading is at an end of its range; the lower end of an unsigned one is just no force. */
static inline bool sensor_is_railed(const axis_t *axis) {
  const uint16_t code = axis->signals.force_raw;
  return code >= fx_highest_code(axis->params.adc_bits) ||
         (code == 0 && axis->params.force_zero_code != 0);
}

/* Parameters were written. */
void sensor_derive(sensor_t *sensor, const drive_params_t *params);

/* After every second tick, while one of the objects is not 0: whether the reading guides the axis
 * from now on. */
void sensor_guides(sensor_t *sensor, const axis_t *axis, bool guides);

/* After axis_tick(), before its outputs are put out: judges the tick. A finding takes them back. */
void sensor_judge(sensor_t *sensor, const drive_params_t *params, axis_t *axis,
                  axis_outputs_t *outputs);
static inline void sensor_check(sensor_t *sensor, const drive_params_t *params, axis_t *axis,
                                axis_outputs_t *outputs) {
  if (sensor->active != 0) {
    sensor_judge(sensor, params, axis, outputs);
  }
}

#endif
