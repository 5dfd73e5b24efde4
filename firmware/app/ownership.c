#include "firmware/app/ownership.h"

#include "firmware/drive/drive.h"
#include "firmware/drive/state.h"

/* Returns true if the drive has power. The function reads the drive state and not the signal
 * active_mode, because active_mode belongs to the last tick. A firmware on no bus does not run the
 * drive. */
static bool will_be_active(const fw_t *fw) {
  return fw->live != 0 && cia402_is_powered(fw->drive.signals.drive_state);
}

static bool may_command(const fw_t *fw, uint8_t source) {
  return source == FW_SOURCE_LOCAL || source == fw->device.command_source;
}

/* Returns true if a write of a bus to command_source acquires the axis from another owner. The bus
 * must write its own number, and the axis must be disabled. */
static bool may_acquire(const fw_t *fw, uint8_t source, int32_t value) {
  return value == source && !will_be_active(fw) &&
         fw->axis.signals.active_mode == AXIS_MODE_DISABLED;
}

/* Returns true if the firmware would detect that the owner of the axis no longer responds. */
static bool is_watched(const fw_t *fw) {
  return fw->device.command_source != AXIS_COMMAND_SOURCE_CANOPEN ||
         canopen_is_watched(&fw->canopen);
}

static bool is_held(const fw_t *fw) {
  return fw->drive.signals.stopped_by != AXIS_STOPPED_BY_NOBODY;
}

/* Returns true if the axis must not be enabled, because a loss of the owner would not be detected.
 * Also returns true if the owner is behind a gateway and this gateway is already lost. */
static bool is_enabling_unsafe(const fw_t *fw) {
  if (fw->device.command_source == AXIS_COMMAND_SOURCE_CANOPEN) {
    return fw->device.unsupervised_owner == AXIS_UNSUPERVISED_OWNER_REFUSED && !is_watched(fw);
  }
  return fw->owner_on_can != 0 && fw->canopen.heartbeats_lost != 0;
}

/* Checks whether a command source may enable the axis with this controlword. FW_SOURCE_LOCAL may
 * always enable the axis. */
static int may_enable(const fw_t *fw, uint8_t source, uint16_t controlword) {
  if (source == FW_SOURCE_LOCAL || !cia402_enables(controlword)) {
    return FW_OK;
  }
  const bool is_halted = (controlword & AXIS_CONTROLWORD_HALT) != 0;
  const bool is_refused = (is_held(fw) && !is_halted) ||
                          (is_enabling_unsafe(fw) && cia402_would_enable(&fw->drive, controlword));
  return is_refused ? FW_ERROR_STATE : FW_OK;
}

/* Returns true if the column `writable` of the object table permits a write to this object in the
 * present state. */
static bool is_writable(const fw_t *fw, const axis_object_t *entry) {
  const uint8_t recorder = fw->recorder.signals.recorder_state;
  switch (entry->writable) {
    case AXIS_WRITABLE_DISABLED:
      return fw->axis.signals.active_mode == AXIS_MODE_DISABLED && !will_be_active(fw);
    case AXIS_WRITABLE_RECORDER_IDLE:
      return recorder == AXIS_RECORDER_STATE_IDLE || recorder == AXIS_RECORDER_STATE_DONE;
    default:
      return true;
  }
}

/* Returns true if a write of `value` to `object` would start the axis. Programming the flash can
 * stall the processor, so the axis must not start while the parameter store is working or an update
 * is written. */
static bool starts_axis(const fw_t *fw, uint16_t object, int32_t value) {
  return !cia402_is_powered(fw->drive.signals.drive_state) &&
         ((object == AXIS_OBJ_CONTROLWORD && cia402_enables((uint16_t)value)) ||
          (object == AXIS_OBJ_MODE && value != AXIS_MODE_DISABLED));
}

/* Returns true if a write of `value` to `object` would change a value that must not change while a
 * cycle runs. A command has no value, so a command is always treated as a change. */
static bool is_fixed(const fw_t *fw, uint16_t object, int32_t value) {
  int32_t present = 0;
  return axis_objects[object].in_cycle == AXIS_IN_CYCLE_REFUSED &&
         cycle_is_running(&fw->drive.cycle) &&
         (!dictionary_has_value(object) ||
          dictionary_read(&fw->objects, object, &present) != FW_OK || present != value);
}

/* Returns true if a write to this object is forbidden now, because parameters are being saved or
 * the firmware is being updated. A saved parameter set must contain the values that all parameters
 * had at the same moment, so stored parameters cannot change during a save. */
static bool is_prevented(const fw_t *fw, const axis_object_t *entry, bool starts) {
  return (store_is_busy(&fw->store) && (entry->stored != 0 || starts)) ||
         (update_is_busy(&fw->update, fw->axis.signals.tick_count) && starts);
}

int ownership_permit(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  const fw_t *fw = fw_of_const(objects);
  const axis_object_t *entry = &axis_objects[object];
  if (!may_command(fw, source)) {
    const bool permitted = (object == AXIS_OBJ_COMMAND_SOURCE) ? may_acquire(fw, source, value)
                                                               : cia402_is_stop(object, value);
    return (permitted || dictionary_is_open(object)) ? FW_OK : FW_ERROR_LOCKED;
  }
  if (!is_writable(fw, entry) || is_fixed(fw, object, value)) {
    return FW_ERROR_STATE;
  }
  const int refusal =
      (object == AXIS_OBJ_CONTROLWORD) ? may_enable(fw, source, (uint16_t)value) : FW_OK;
  if (refusal != FW_OK) {
    return refusal;
  }
  return is_prevented(fw, entry, starts_axis(fw, object, value)) ? FW_ERROR_BUSY : FW_OK;
}

/* The value of stopped_by is 1 more than the number of the command source that stopped the axis. 0
 * means that no source stopped it. */
_Static_assert(AXIS_STOPPED_BY_CANOPEN == FW_SOURCE_CANOPEN + 1 &&
                   AXIS_STOPPED_BY_MODBUS == FW_SOURCE_MODBUS + 1 &&
                   AXIS_STOPPED_BY_LCM == FW_SOURCE_LCM + 1 &&
                   AXIS_STOPPED_BY_PORT == FW_SOURCE_LOCAL + 1,
               "one more than FW_SOURCE_");

static void hold(fw_t *fw, uint8_t source) {
  if (cia402_hold(&fw->drive, &fw->axis, (uint8_t)(source + 1))) {
    canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_STOPPED, fw->drive.signals.stopped_by);
  }
}

static void warn(fw_t *fw) {
  if (fw->drive.unsupervised == 0) {
    cia402_warn_unsupervised(&fw->drive, &fw->axis, true);
    canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_OWNER_UNSUPERVISED, fw->device.command_source);
  }
}

/* Executes a controlword that the owner of the axis or FW_SOURCE_LOCAL has written. */
static void obey(fw_t *fw, uint8_t source, uint16_t previous, uint16_t controlword) {
  const bool is_local = source == FW_SOURCE_LOCAL;
  const bool enables = !is_local && cia402_would_enable(&fw->drive, controlword);
  const bool stops =
      is_local && fw->config.buses != 0 && cia402_would_stop(&fw->drive, controlword, previous);
  cia402_written(&fw->drive, &fw->axis, AXIS_OBJ_CONTROLWORD, previous, controlword);
  if (stops) {
    hold(fw, source);
  }
  if (enables) {
    /* A Modbus client on the serial line and a Modbus client behind a gateway have the same source
     * number. So a Modbus client that enables the axis over CAN is marked as an owner on CAN, which
     * loses the axis if CAN fails. */
    fw->owner_on_can |= (uint8_t)(fw->on_serial == 0);
    if (!is_watched(fw)) {
      warn(fw);
    }
  }
}

void ownership_check_watch(fw_t *fw) {
  if (fw->drive.signals.drive_state != AXIS_DRIVE_STATE_OPERATION_ENABLED || is_watched(fw)) {
    return;
  }
  if (fw->device.unsupervised_owner == AXIS_UNSUPERVISED_OWNER_REFUSED) {
    (void)cia402_owner_lost(&fw->drive, &fw->axis, AXIS_FAULT_SOURCE_LOST);
  } else {
    warn(fw);
  }
}

void ownership_watch_warning(fw_t *fw) {
  if (fw->drive.unsupervised != 0 && is_watched(fw)) {
    cia402_warn_unsupervised(&fw->drive, &fw->axis, false);
  }
}

void ownership_command(fw_t *fw, uint8_t source, uint16_t previous, uint16_t controlword) {
  const bool may_only_stop =
      !may_command(fw, source) ||
      (source != FW_SOURCE_LOCAL && is_held(fw) && cia402_enables(controlword));
  if (!may_only_stop) {
    obey(fw, source, previous, controlword);
    return;
  }
  /* A controlword that may only stop the axis must not change the object controlword, so its value
   * is restored. */
  fw->drive.params.controlword = previous;
  if (cia402_stop(&fw->drive, &fw->axis, controlword)) {
    hold(fw, source);
  }
}

void ownership_disabled(fw_t *fw, uint8_t source) {
  const bool holds = (source == FW_SOURCE_LOCAL) ? fw->config.buses != 0 : !may_command(fw, source);
  if (holds && cia402_stop(&fw->drive, &fw->axis, 0)) {
    hold(fw, source);
  }
}

void ownership_stopped(fw_t *fw, uint8_t fault) {
  if (cia402_is_powered(fw->drive.signals.drive_state) &&
      cia402_owner_lost(&fw->drive, &fw->axis, fault)) {
    hold(fw, FW_SOURCE_CANOPEN);
  }
}

static void release_to_canopen(fw_t *fw) {
  fw->device.command_source = AXIS_COMMAND_SOURCE_CANOPEN;
  fw->owner_on_can = 1;
  canopen_owns(&fw->canopen);
}

/* Checks the CANopen master after the axis was released to canopen. If this master is lost, or if
 * its loss would never be detected, the drive reacts as after the loss of the owner. */
static void check_canopen(fw_t *fw) {
  uint8_t fault = canopen_lost_for(&fw->canopen);
  if (fault == AXIS_FAULT_NONE && !canopen_is_watched(&fw->canopen)) {
    fault = AXIS_FAULT_SOURCE_LOST;
  }
  if (fault != AXIS_FAULT_NONE) {
    (void)cia402_owner_lost(&fw->drive, &fw->axis, fault);
  }
}

/* After a write to command_source, stores in owner_on_can whether the owner reaches the axis over
 * CAN. An owner that enabled the axis over CAN stays an owner on CAN, even if the same number is
 * written again over the serial line. */
static void note_connection(fw_t *fw, bool is_new, uint8_t owner) {
  const bool on_can = owner != AXIS_COMMAND_SOURCE_MODBUS || fw->on_serial == 0;
  if (on_can || is_new || !will_be_active(fw)) {
    fw->owner_on_can = on_can ? 1 : 0;
  }
}

void ownership_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                       int32_t value) {
  fw_t *fw = fw_of(objects);
  if (object == AXIS_OBJ_UNSUPERVISED_OWNER) {
    ownership_check_watch(fw);
  }
  if (object == AXIS_OBJ_COMMAND_SOURCE) {
    note_connection(fw, value != previous, (uint8_t)value);
  }
  if (object != AXIS_OBJ_COMMAND_SOURCE || value == previous) {
    return;
  }
  fw->source_silence = 0; /* The watchdog of the new owner starts again. */
  if (!will_be_active(fw)) {
    cia402_forget_targets(&fw->drive); /* The new owner of the axis must write its own targets. */
  }
  if (value == AXIS_COMMAND_SOURCE_CANOPEN) {
    release_to_canopen(fw);
    /* A CANopen master that has just acquired the axis by its own write is certainly present. */
    if (source != FW_SOURCE_CANOPEN) {
      check_canopen(fw);
    }
  }
}

bool ownership_ends(const fw_t *fw, uint8_t lost) {
  return fw->owner_on_can != 0 && (lost & fx_bit(fw->device.command_source)) != 0;
}

/* If the axis was enabled after the loss of a heartbeat, treats the owner as lost. This is needed,
 * because the CANopen node reports the loss of a heartbeat only once. */
void ownership_watch_canopen(fw_t *fw) {
  if (fw->drive.signals.drive_state == AXIS_DRIVE_STATE_OPERATION_ENABLED) {
    (void)cia402_owner_lost(&fw->drive, &fw->axis, AXIS_FAULT_HEARTBEAT_LOST);
  }
}

void ownership_time_out(fw_t *fw) {
  const uint8_t owner = fw->device.command_source;
  release_to_canopen(fw);
  (void)cia402_owner_lost(&fw->drive, &fw->axis, AXIS_FAULT_SOURCE_LOST);
  /* If the drive has an error code, the emergency message of this code already reports the
   * fault. */
  if (fw->axis.signals.active_mode != AXIS_MODE_DISABLED && fw->drive.signals.error_code == 0) {
    canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_SOURCE_LOST, owner);
  }
}

void ownership_lost(fw_t *fw, uint8_t fault) {
  if (fw->device.command_source != AXIS_COMMAND_SOURCE_CANOPEN) {
    release_to_canopen(fw);
  }
  (void)cia402_owner_lost(&fw->drive, &fw->axis, fault);
}
