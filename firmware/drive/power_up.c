#include <stddef.h>

#include "firmware/drive/drive.h"
#include "firmware/drive/modes.h"
#include "firmware/drive/parameters.h"
#include "firmware/drive/status.h"
#include "firmware/fx/bytes.h"
#include "firmware/objects/access.h"
#include "firmware/objects/value.h"

void cia402_init(cia402_t *drive) {
  fx_clear(drive, sizeof(*drive));
  shaper_clear(&drive->force_shaper);
  shaper_clear(&drive->motion_shaper);
  cycle_select(&drive->cycle, NULL);
  drive->cycle_refusal = AXIS_CYCLE_STATE_IDLE;
  drive->cycle_lock = AXIS_CYCLE_STATE_IDLE;
  drive->tracking = CIA402_TRACKING_NONE;
  drive->leaving_to = AXIS_DRIVE_STATE_SWITCH_ON_DISABLED;
  drive->fault = AXIS_FAULT_NONE;
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
