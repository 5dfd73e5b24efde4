#include "firmware/app/ownership.h"

#include "firmware/drive/state.h"

/* The drive state is ahead of active_mode, which is of the last tick. Off the buses the drive does
 * not run. */
static bool will_be_active(const fw_t *fw) {
  return fw->live != 0 && cia402_is_powered(fw->drive.signals.drive_state);
}

static bool is_locked(const fw_t *fw, uint8_t source, uint16_t object, int32_t value) {
  const uint8_t owner = fw->device.command_source;
  if (source == FW_SOURCE_LOCAL) {
    return false;
  }
  if (object == AXIS_OBJ_COMMAND_SOURCE) {
    return value != source && !(source == owner && value == AXIS_COMMAND_SOURCE_CANOPEN);
  }
  return source != owner;
}

/* Whether the object's `writable` column allows a write now. */
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

/* Programming flash can hold up the processor: no motion until it is done. */
static bool starts_axis(const fw_t *fw, uint16_t object, int32_t value) {
  return !cia402_is_powered(fw->drive.signals.drive_state) &&
         ((object == AXIS_OBJ_CONTROLWORD && cia402_enables((uint16_t)value)) ||
          (object == AXIS_OBJ_MODE && value != AXIS_MODE_DISABLED));
}

int ownership_permit(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  const fw_t *fw = fw_of_const(objects);
  const axis_object_t *entry = &axis_objects[object];
  if (is_locked(fw, source, object, value)) {
    return FW_ERROR_LOCKED;
  }
  if (!is_writable(fw, entry)) {
    return FW_ERROR_STATE;
  }
  /* A set of parameters is stored as it was at one moment. */
  if (store_is_busy(&fw->store) && (entry->stored != 0 || starts_axis(fw, object, value))) {
    return FW_ERROR_BUSY;
  }
  return FW_OK;
}

static void release_to_canopen(fw_t *fw) {
  fw->device.command_source = AXIS_COMMAND_SOURCE_CANOPEN;
  canopen_owns(&fw->canopen);
}

/* An enabled axis must not be released to a CANopen whose master is lost, or whose loss would never
 * be noticed. */
static void check_canopen(fw_t *fw) {
  uint8_t fault = canopen_lost_for(&fw->canopen);
  if (fault == AXIS_FAULT_NONE && !canopen_is_watched(&fw->canopen)) {
    fault = AXIS_FAULT_SOURCE_LOST;
  }
  if (fault != AXIS_FAULT_NONE) {
    cia402_owner_lost(&fw->drive, &fw->axis, fault);
  }
}

void ownership_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                       int32_t value) {
  fw_t *fw = fw_of(objects);
  fw->source_silence = 0;
  if (object != AXIS_OBJ_COMMAND_SOURCE || value == previous) {
    return;
  }
  if (!will_be_active(fw)) {
    cia402_forget_targets(&fw->drive); /* the new owner writes its own */
  }
  if (value == AXIS_COMMAND_SOURCE_CANOPEN) {
    release_to_canopen(fw);
    /* A CANopen that acquired the axis itself is there. */
    if (source != FW_SOURCE_CANOPEN) {
      check_canopen(fw);
    }
  }
}

/* CANopen is watched by its node; but an axis that is enabled while a heartbeat is still lost would
 * not be missed. */
void ownership_watch_canopen(fw_t *fw) {
  if (fw->drive.signals.drive_state == AXIS_DRIVE_STATE_OPERATION_ENABLED) {
    cia402_owner_lost(&fw->drive, &fw->axis, AXIS_FAULT_HEARTBEAT_LOST);
  }
}

void ownership_time_out(fw_t *fw) {
  const uint8_t owner = fw->device.command_source;
  release_to_canopen(fw);
  cia402_owner_lost(&fw->drive, &fw->axis, AXIS_FAULT_SOURCE_LOST);
  /* A fault is reported by its error code. */
  if (fw->axis.signals.active_mode != AXIS_MODE_DISABLED && fw->drive.signals.error_code == 0) {
    canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_SOURCE_LOST, owner);
  }
}

void ownership_lost(fw_t *fw, uint8_t fault) {
  if (fw->device.command_source != AXIS_COMMAND_SOURCE_CANOPEN) {
    release_to_canopen(fw);
  }
  cia402_owner_lost(&fw->drive, &fw->axis, fault);
}
