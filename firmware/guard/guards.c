#include "firmware/guard/guards.h"

#include "firmware/fx/bytes.h"
#include "firmware/guard/calibration.h"

void guards_init(guards_t *guards, drive_signals_t *signals) {
  fx_clear(guards, sizeof(*guards));
  contact_guard_start(&guards->contact_guard);
  first_motion_forget(&guards->first_motion, signals);
}

void guards_derive(guards_t *guards, const drive_params_t *params, drive_signals_t *signals) {
  contact_guard_derive(&guards->contact_guard, params);
  sensor_derive(&guards->sensor, params);
  signals->calibration_expired = calibration_is_expired(params) ? 1 : 0;
}

void guards_written(guards_t *guards, drive_signals_t *signals, uint16_t object) {
  if (first_motion_depends_on(object)) {
    first_motion_forget(&guards->first_motion, signals);
  }
}

bool guards_freeze(const guards_t *guards, uint16_t object) {
  return first_motion_is_running(&guards->first_motion) && first_motion_is_bounded_by(object);
}

void guards_start(guards_t *guards, drive_signals_t *signals) {
  contact_start(&guards->contact, signals);
  contact_guard_start(&guards->contact_guard);
}

uint8_t guards_answer(guards_t *guards, const drive_params_t *params, drive_signals_t *signals,
                      axis_t *axis) {
  return contact_guard_answer(&guards->contact_guard, &guards->contact, params, signals, axis);
}
