#include <stddef.h>

#include "firmware/drive/drive.h"
#include "firmware/drive/modes.h"
#include "firmware/drive/parameters.h"
#include "firmware/drive/status.h"
#include "firmware/objects/access.h"
#include "firmware/objects/value.h"

void cia402_init(cia402_t *drive) {
  /* Each field is set separately, because for the complete structure the compiler would call
   * memset. */
  drive->origin_cnt = 0;
  drive->setpoint = (cia402_setpoint_t){0};
  drive->buffered = (cia402_setpoint_t){0};
  drive->outside_tick = 0;
  drive->velocity_sum = 0;
  for (uint8_t i = 0; i < CIA402_MEAN_TICKS; i++) {
    drive->velocities[i] = 0;
  }
  drive->velocity_next = 0;
  shaper_clear(&drive->force_shaper);
  shaper_clear(&drive->motion_shaper);
  drive->homing = (cia402_homing_t){0};
  drive->homed = 0;
  cycle_select(&drive->cycle, NULL);
  drive->program = NULL;
  drive->cycle_refusal = AXIS_CYCLE_STATE_IDLE;
  drive->cycle_bank_crc = 0;
  drive->cycle_offset_q8 = 0;
  drive->lead_cnt = 0;
  drive->pressed = 0;
  drive->slowing = 0;
  drive->overridden = (cia402_overridden_t){0};
  drive->tracking = CIA402_TRACKING_NONE;
  drive->settling_tick = 0;
  drive->stopping_tick = 0;
  drive->leaving = 0;
  drive->leaving_to = AXIS_DRIVE_STATE_SWITCH_ON_DISABLED;
  drive->fault = AXIS_FAULT_NONE;
  drive->controlled = 0;
  drive->limited = 0;
  drive->restricted = 0;
  drive->unsupervised = 0;
  drive->position_written = 0;
  drive->velocity_written = 0;
  drive->force_written = 0;
  value_store_defaults(&drive->params, AXIS_BLOCK_DRIVE_PARAMETER);
  value_store_defaults(&drive->signals, AXIS_BLOCK_DRIVE_SIGNAL);
  profile_set(&drive->trajectory, drive->signals.position_actual);
  cia402_set_mode(drive, drive->signals.modes_of_operation_display);
  cia402_leave_mode(drive);
  guards_init(&drive->guards, &drive->signals);
  cia402_release_law(drive);
  parameters_derive(drive);
}

void cia402_wake(cia402_t *drive, const axis_t *axis) {
  parameters_derive(drive);
  cia402_set_mode(drive, drive->params.modes_of_operation);
  drive->signals.drive_state = AXIS_DRIVE_STATE_SWITCH_ON_DISABLED;
  if (axis->signals.fault != AXIS_FAULT_NONE) {
    drive->signals.drive_state = AXIS_DRIVE_STATE_FAULT;
  } else if (axis->params.mode != AXIS_MODE_DISABLED) {
    drive->signals.drive_state = AXIS_DRIVE_STATE_OPERATION_ENABLED;
    drive->params.modes_of_operation = cia402_operation_of(axis->params.mode);
    cia402_set_mode(drive, drive->params.modes_of_operation);
  }
  cia402_show(drive, axis);
}
