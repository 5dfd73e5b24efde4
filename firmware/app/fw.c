#include "firmware/app/fw.h"

#include <stddef.h>

#include "firmware/drive/state.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/value.h"

_Static_assert(sizeof(fw_t) < 65536, "offsets of objects have 16 bits");
/* TPDOs gather their bytes from where the values lie. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the lowest byte comes first");
/* Codes of the protocols are enumerators above 32767; fx, core and objects make do with less. */
_Static_assert(sizeof(int) >= sizeof(int32_t), "app and proto need an int of 32 bits");

/* Where each block of the object table lies in fw_t. */
static const uint16_t block_offset[AXIS_BLOCK_NONE] = {
    [AXIS_BLOCK_AXIS_PARAMETER] = (uint16_t)offsetof(fw_t, axis.params),
    [AXIS_BLOCK_AXIS_SIGNAL] = (uint16_t)offsetof(fw_t, axis.signals),
    [AXIS_BLOCK_RECORDER_PARAMETER] = (uint16_t)offsetof(fw_t, recorder.params),
    [AXIS_BLOCK_RECORDER_SIGNAL] = (uint16_t)offsetof(fw_t, recorder.signals),
    [AXIS_BLOCK_DRIVE_PARAMETER] = (uint16_t)offsetof(fw_t, drive.params),
    [AXIS_BLOCK_DRIVE_SIGNAL] = (uint16_t)offsetof(fw_t, drive.signals),
    [AXIS_BLOCK_CANOPEN_PARAMETER] = (uint16_t)offsetof(fw_t, canopen.params),
    [AXIS_BLOCK_CANOPEN_SIGNAL] = (uint16_t)offsetof(fw_t, canopen.signals),
    [AXIS_BLOCK_DEVICE_PARAMETER] = (uint16_t)offsetof(fw_t, device),
    [AXIS_BLOCK_DEVICE_SIGNAL] = (uint16_t)offsetof(fw_t, device_signals),
};

static uint16_t object_offset(const axis_object_t *object) {
  return (uint16_t)(block_offset[object->block] + object->offset);
}

static bool object_exists(uint16_t object) {
  return object != AXIS_OBJ_NONE && object < AXIS_OBJ_COUNT;
}

/* Whether it has a value that can be read in any tick. */
static bool object_readable(uint16_t object) {
  return object_exists(object) && axis_objects[object].block != AXIS_BLOCK_NONE;
}

static recorder_channel_t object_channel(uint16_t object) {
  const axis_object_t *entry = &axis_objects[object];
  return (recorder_channel_t){.offset = object_offset(entry), .type = entry->type};
}

/* Blocks that matter only to a firmware on a bus. */
static bool is_of_axis(const axis_object_t *entry) {
  return entry->block == AXIS_BLOCK_AXIS_PARAMETER || entry->block == AXIS_BLOCK_AXIS_SIGNAL ||
         entry->block == AXIS_BLOCK_RECORDER_PARAMETER ||
         entry->block == AXIS_BLOCK_RECORDER_SIGNAL;
}

static bool in_axis_or_recorder(uint16_t object) {
  return object == AXIS_OBJ_FAULT_RESET || object == AXIS_OBJ_RECORDER_ARM ||
         is_of_axis(&axis_objects[object]);
}

static void wake(fw_t *fw) {
  if (fw->live == 0) {
    fw->live = 1;
    cia402_wake(&fw->drive, &fw->axis);
  }
}

/* --- emergencies that are no faults ----------------------------------------------------------- */

/* What a contact that comes and goes, or a late port, could repeat every tick. */
static void tell_held(fw_t *fw, uint16_t code) {
  const uint8_t i = (uint8_t)(code - FW_HELD_FIRST);
  const uint32_t now = fw->axis.signals.tick_count;
  if (fw->told[i] != 0 && now - fw->told_tick[i] < FW_HOLD_TICKS) {
    return;
  }
  fw->told[i] = 1;
  fw->told_tick[i] = now;
  canopen_emergency(&fw->canopen, code, 0);
}

enum { SEEN_CONTACT = 1, SEEN_SATURATED = 2, SEEN_LIMIT_CYCLE = 4 };

/* What the drive watches, SEEN_ bits. */
static uint8_t watched_contact(const fw_t *fw) {
  const drive_signals_t *signals = &fw->drive.signals;
  /* Each of them is 0 or 1. */
  return (uint8_t)(signals->contact * SEEN_CONTACT + signals->force_saturated * SEEN_SATURATED +
                   signals->limit_cycle * SEEN_LIMIT_CYCLE);
}

/* Edges of it. A contact is lost only while force is controlled. */
static void watch_contact(fw_t *fw) {
  const uint8_t before = fw->contact_seen;
  const uint8_t now = watched_contact(fw);
  if (now == before) {
    return;
  }
  fw->contact_seen = now;
  const uint8_t risen = (uint8_t)(now & ~(uint32_t)before);
  const uint8_t fallen = (uint8_t)(before & ~(uint32_t)now);
  if ((fallen & SEEN_CONTACT) != 0 && fw->drive.controlled != 0) {
    tell_held(fw, AXIS_ERROR_CODE_CONTACT_LOST);
  }
  if ((risen & SEEN_SATURATED) != 0) {
    tell_held(fw, AXIS_ERROR_CODE_FORCE_SATURATED);
  }
  if ((risen & SEEN_LIMIT_CYCLE) != 0) {
    tell_held(fw, AXIS_ERROR_CODE_LIMIT_CYCLE);
  }
}

/* --- power-up and resets ---------------------------------------------------------------------- */

/* Every parameter and signal at its power-up value, but for what counts losses; what was stored
 * replaces the defaults. */
static void power_up(fw_t *fw) {
  const uint8_t node_id = (fw->config.node_id == 0) ? 1 : fw->config.node_id;
  axis_init(&fw->axis);
  recorder_init(&fw->recorder, fw->config.recorder_buffer, fw->config.recorder_bytes);
  cia402_init(&fw->drive);
  canopen_init(&fw->canopen, node_id);
  modbus_init(&fw->modbus, node_id, fw->config.modbus_baud);
  value_store_defaults(&fw->device, AXIS_BLOCK_DEVICE_PARAMETER);
  fw->device_signals.object_table_hash = AXIS_OBJECTS_HASH32;
  fw->device_signals.node_id = node_id;
  fw->canopen.signals.serial_number = fw->config.serial_number;
  fw->source_silence = 0;
  for (uint8_t i = 0; i < FW_HELD; i++) {
    fw->told[i] = 0;
  }
  fw->ticks_alone = 0;
  fw->contact_seen = 0;
  fw->device_signals.store_state = store_load(&fw->store, fw);
  fw->device_signals.store_change_count = fw->store.change_count;
  for (uint8_t i = 0; i < STORE_CHANGES; i++) {
    fw->device_signals.store_change[i] = fw->store.changes[i];
  }
}

/* Emergency store_failed: store_state, the address of the first change and how many there are. */
static void report_store(fw_t *fw) {
  const device_signals_t *signals = &fw->device_signals;
  const uint32_t change = signals->store_change[0];
  const uint32_t count =
      (signals->store_change_count < UINT8_MAX) ? signals->store_change_count : UINT8_MAX;
  canopen_emergency_detailed(
      &fw->canopen, AXIS_ERROR_CODE_STORE_FAILED, signals->store_state,
      fx_field(change, 8, 16) + fx_field(change, 0, 8) * 65536 + count * 16777216);
}

/* The node boots up; whatever is not in force as it was stored is reported. */
static void boot(fw_t *fw) {
  canopen_start(&fw->canopen);
  const uint8_t state = fw->device_signals.store_state;
  if (state != AXIS_STORE_STATE_EMPTY && state != AXIS_STORE_STATE_LOADED) {
    report_store(fw);
  }
}

void fw_init(fw_t *fw, const fw_config_t *config) {
  fw->config = *config;
  fw->live = 0;
  fw->zero = 0;
  value_store_defaults(&fw->device_signals, AXIS_BLOCK_DEVICE_SIGNAL);
  store_init(&fw->store, config->memory);
  power_up(fw);
  if (config->buses != 0) {
    wake(fw);
    boot(fw);
    if (config->watchdog_fired != 0) {
      canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_WATCHDOG_RESET, 0);
    }
  }
}

static void carry_out_reset(fw_t *fw) {
  if (fw->canopen.reset == CANOPEN_RESET_NONE) {
    return;
  }
  /* Who saves and resets at once means the reset to find what was saved. */
  if (store_is_busy(&fw->store) && fw->axis.signals.active_mode == AXIS_MODE_DISABLED) {
    return;
  }
  /* Loading takes longer than a tick on a chip: nothing may stand at the output meanwhile. */
  if (fw->canopen.reset == CANOPEN_RESET_NODE &&
      fw->axis.signals.active_mode != AXIS_MODE_DISABLED) {
    cia402_native_mode(&fw->drive, &fw->axis, AXIS_MODE_DISABLED);
    return;
  }
  const uint8_t reset = canopen_take_reset(&fw->canopen);
  const uint8_t bus = fw->canopen.bus;
  if (reset == CANOPEN_RESET_NODE) {
    const uint32_t ticks = fw->axis.signals.tick_count;
    power_up(fw);
    fw->axis.signals.tick_count = ticks;
    cia402_wake(&fw->drive, &fw->axis);
    boot(fw);
  } else {
    canopen_init(&fw->canopen, fw->device_signals.node_id);
    fw->canopen.signals.serial_number = fw->config.serial_number;
    const bool loaded = store_load_block(&fw->store, fw, AXIS_BLOCK_CANOPEN_PARAMETER);
    canopen_start(&fw->canopen);
    if (!loaded) {
      fw->device_signals.store_state = AXIS_STORE_STATE_FAILED;
      canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_STORE_FAILED, AXIS_STORE_STATE_FAILED);
    }
  }
  /* A port tells changes only. */
  canopen_bus(&fw->canopen, fw, bus);
}

/* --- the lock --------------------------------------------------------------------------------- */

/* canopen owns the axis from now on, and is watched from now on. */
static void give_to_canopen(fw_t *fw) {
  fw->device.command_source = AXIS_COMMAND_SOURCE_CANOPEN;
  canopen_owns(&fw->canopen);
}

/* Whoever gives the axis away while it is enabled may find nobody there to take it, or nobody whose
 * end would ever be noticed. */
static void look_for_canopen(fw_t *fw) {
  uint8_t fault = canopen_lost_for(&fw->canopen);
  if (fault == AXIS_FAULT_NONE && !canopen_is_watched(&fw->canopen)) {
    fault = AXIS_FAULT_SOURCE_LOST;
  }
  if (fault != AXIS_FAULT_NONE) {
    cia402_owner_lost(&fw->drive, &fw->axis, fault);
  }
}

/* A foreign owner that is silent for too long loses the axis to canopen. Canopen itself is watched
 * by its node; but whoever enables the axis while a heartbeat is still away would not be missed. */
static void watch_source(fw_t *fw) {
  if (fw->device.command_source == AXIS_COMMAND_SOURCE_CANOPEN) {
    if (fw->canopen.heartbeats_lost != 0 &&
        fw->drive.signals.drive_state == AXIS_DRIVE_STATE_OPERATION_ENABLED) {
      cia402_owner_lost(&fw->drive, &fw->axis, AXIS_FAULT_HEARTBEAT_LOST);
    }
    return;
  }
  fw->source_silence += 1;
  if (fw->source_silence > fx_ticks_from_ms(fw->device.watchdog)) {
    const uint8_t owner = fw->device.command_source;
    give_to_canopen(fw);
    cia402_owner_lost(&fw->drive, &fw->axis, AXIS_FAULT_SOURCE_LOST);
    /* A fault is told by its error code. */
    if (fw->axis.signals.active_mode != AXIS_MODE_DISABLED && fw->drive.signals.error_code == 0) {
      canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_SOURCE_LOST, owner);
    }
  }
}

static void serve_store(fw_t *fw) {
  const uint8_t state = store_tick(&fw->store, fw);
  if (state != AXIS_STORE_STATE_COUNT) {
    if (state == AXIS_STORE_STATE_FAILED && fw->device_signals.store_state != state) {
      canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_STORE_FAILED, state);
    }
    fw->device_signals.store_state = state;
  }
}

static void serve_node(fw_t *fw) {
  watch_contact(fw);
  canopen_tick_end(&fw->canopen, fw);
}

void fw_prepare(fw_t *fw) {
  if (fw->live == 0) {
    return;
  }
  watch_source(fw);
  cia402_before(&fw->drive, &fw->axis);
  fw->ticks_alone += 1;
  if (fw->ticks_alone > FW_BETWEEN_TICKS_MAX) {
    axis_fault(&fw->axis, AXIS_FAULT_MAIN_LOOP_LOST);
  }
}

void fw_control(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs) {
  axis_tick(&fw->axis, inputs, outputs);
}

bool fw_report(fw_t *fw) {
  if (fw->live == 0) {
    recorder_tick(&fw->recorder, fw);
    return true;
  }
  cia402_after(&fw->drive, &fw->axis);
  recorder_tick(&fw->recorder, fw);
  if (fw->config.buses != 0) {
    canopen_tick_begin(&fw->canopen, fw, watched_contact(fw) != fw->contact_seen);
  }
  return fw->ticks_alone <= FW_BETWEEN_TICKS_MAX;
}

void fw_between(fw_t *fw) {
  fw->ticks_alone = 0;
  if (fw->live == 0) {
    return;
  }
  if (fw->config.buses != 0) {
    serve_node(fw);
    modbus_tick(&fw->modbus, fw);
    carry_out_reset(fw);
  }
  serve_store(fw);
}

void fw_tick(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs) {
  fw_prepare(fw);
  fw_control(fw, inputs, outputs);
  (void)fw_report(fw);
  fw_between(fw);
}

void fw_can_receive(fw_t *fw, const can_frame_t *frame) {
  canopen_receive(&fw->canopen, fw, frame);
}

bool fw_can_transmit(fw_t *fw, can_frame_t *frame) { return canopen_transmit(&fw->canopen, frame); }

void fw_can_lost(fw_t *fw, uint16_t frames) { canopen_lost(&fw->canopen, fw, frames); }

void fw_can_bus(fw_t *fw, uint8_t state) { canopen_bus(&fw->canopen, fw, state); }

void fw_modbus_receive(fw_t *fw, const uint8_t *bytes, uint16_t count) {
  modbus_receive(&fw->modbus, fw, bytes, count);
}

uint16_t fw_modbus_transmit(fw_t *fw, uint8_t *bytes, uint16_t room) {
  return modbus_transmit(&fw->modbus, bytes, room);
}

/* More by a number, up to the largest it can hold. */
static void count_up(uint16_t *counter, uint16_t by) {
  *counter = (by > UINT16_MAX - *counter) ? UINT16_MAX : (uint16_t)(*counter + by);
}

void fw_overrun(fw_t *fw, uint32_t missed) {
  const uint32_t count = (missed == 0) ? 1 : missed;
  count_up(&fw->device_signals.overruns, (count > UINT16_MAX) ? UINT16_MAX : (uint16_t)count);
  fw->axis.signals.tick_count += missed;
  if (fw->config.buses != 0) {
    if (missed != 0) {
      canopen_missed(&fw->canopen, missed);
    }
    tell_held(fw, AXIS_ERROR_CODE_OVERRUN);
  }
}

void fw_source_lost(fw_t *fw, uint8_t source, uint8_t fault) {
  if (source == fw->device.command_source) {
    if (source != FW_SOURCE_CANOPEN) {
      give_to_canopen(fw);
    }
    cia402_owner_lost(&fw->drive, &fw->axis, fault);
  }
}

uint8_t fw_fault(const fw_t *fw) {
  const uint8_t latched = fw->axis.signals.fault;
  return (latched != AXIS_FAULT_NONE) ? latched : fw->drive.fault;
}

const axis_address_t *fw_address(uint16_t index, uint8_t sub) {
  uint16_t low = 0;
  uint16_t high = AXIS_ADDRESSES_COUNT;
  while (low < high) {
    const uint16_t middle = fx_half(low + high);
    const axis_address_t *address = &axis_addresses[middle];
    if (address->index == index && address->sub == sub) {
      return address;
    }
    if (address->index < index || (address->index == index && address->sub < sub)) {
      low = (uint16_t)(middle + 1);
    } else {
      high = middle;
    }
  }
  return NULL;
}

/* The number of the object at index times 256 plus sub-index, or AXIS_OBJ_NONE. */
static uint16_t object_at(int32_t address) {
  const uint32_t bits = (uint32_t)address;
  const axis_address_t *found = fw_address((uint16_t)fx_field(bits, 8, 16), (uint8_t)bits);
  return (found != NULL && found->what == AXIS_ADDRESS_OBJECT) ? found->value : AXIS_OBJ_NONE;
}

uint32_t fw_recording_bytes(const fw_t *fw, uint32_t offset, uint8_t *bytes, uint32_t count) {
  return recorder_bytes(&fw->recorder, offset, bytes, count);
}

uint32_t fw_recording_size(const fw_t *fw) {
  const recorder_t *recorder = &fw->recorder;
  const bool is_done = recorder->signals.recorder_state == AXIS_RECORDER_STATE_DONE;
  return is_done ? recorder->signals.recorder_count * recorder->sample_bytes : 0;
}

void fw_can_count_lost(fw_t *fw, uint16_t frames) {
  count_up(&fw->device_signals.can_lost, frames);
}

const char *fw_text(const fw_t *fw, uint16_t index) {
  switch (index) {
    case 0x1008:
      return "forceaxis";
    case 0x1009:
      return (fw->config.hardware == NULL) ? "none" : fw->config.hardware;
    default:
      return (fw->config.software == NULL) ? FW_VERSION " " AXIS_OBJECTS_HASH_TEXT
                                           : fw->config.software;
  }
}

uint16_t fw_object_place(uint16_t object) {
  return (object == AXIS_OBJ_NONE) ? (uint16_t)offsetof(fw_t, zero)
                                   : object_offset(&axis_objects[object]);
}

uint16_t fw_error_code(const fw_t *fw) { return fw->drive.signals.error_code; }

bool fw_is_active(const fw_t *fw) { return fw->axis.signals.active_mode != AXIS_MODE_DISABLED; }

int fw_object_read(const fw_t *fw, uint16_t object, int32_t *value) {
  if (!object_exists(object)) {
    return FW_ERROR_NO_OBJECT;
  }
  const axis_object_t *entry = &axis_objects[object];
  if (entry->access == AXIS_ACCESS_WO) {
    return FW_ERROR_WRITE_ONLY;
  }
  /* A command has no value of its own. */
  *value = (entry->block == AXIS_BLOCK_NONE) ? entry->initial
                                             : value_load(fw, object_offset(entry), entry->type);
  return FW_OK;
}

/* The drive is ahead of active_mode, which is of the last tick. Off the buses there is no drive. */
static bool will_be_active(const fw_t *fw) {
  return fw->live != 0 && cia402_is_powered(fw->drive.signals.drive_state);
}

/* Whether the object's `writable` column allows a write now. */
static bool writable_now(const fw_t *fw, const axis_object_t *entry) {
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

static bool in_range(const axis_object_t *entry, int32_t value) {
  if (entry->type == AXIS_TYPE_U32) {
    return (uint32_t)value >= (uint32_t)entry->min && (uint32_t)value <= (uint32_t)entry->max;
  }
  return value >= entry->min && value <= entry->max;
}

/* Only the owner writes; a bus takes the lock by writing its own number, the owner canopen's. */
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

/* A native mode over a bus would go round the state machine of the drive. */
static int check_mode(const fw_t *fw, uint8_t source, int32_t value) {
  const bool refused = source != FW_SOURCE_LOCAL || fw_fault(fw) != AXIS_FAULT_NONE;
  return (value != AXIS_MODE_DISABLED && refused) ? FW_ERROR_STATE : FW_OK;
}

/* What a range alone cannot say. */
static int check_rules(const fw_t *fw, uint8_t source, uint16_t object, int32_t value) {
  const axis_params_t *params = &fw->axis.params;
  bool in_range = true;
  switch (axis_objects[object].block) {
    case AXIS_BLOCK_DRIVE_PARAMETER:
      return cia402_check(&fw->drive, object, value);
    case AXIS_BLOCK_CANOPEN_PARAMETER:
      return canopen_check(&fw->canopen, object, value);
    default:
      break;
  }
  switch (object) {
    case AXIS_OBJ_MODE:
      return check_mode(fw, source, value);
    case AXIS_OBJ_FORCE_SIGN:
      in_range = value != 0;
      break;
    case AXIS_OBJ_POSITION_MIN:
      in_range = value <= params->position_max;
      break;
    case AXIS_OBJ_POSITION_MAX:
      in_range = value >= params->position_min;
      break;
    case AXIS_OBJ_RECORDER_SIGNAL_1:
    case AXIS_OBJ_RECORDER_SIGNAL_2:
    case AXIS_OBJ_RECORDER_SIGNAL_3:
    case AXIS_OBJ_RECORDER_SIGNAL_4:
    case AXIS_OBJ_RECORDER_SIGNAL_5:
    case AXIS_OBJ_RECORDER_SIGNAL_6:
    case AXIS_OBJ_RECORDER_SIGNAL_7:
    case AXIS_OBJ_RECORDER_SIGNAL_8:
    case AXIS_OBJ_RECORDER_TRIGGER_SOURCE:
      in_range = value == 0 || object_readable(object_at(value));
      break;
    default:
      break;
  }
  return in_range ? FW_OK : FW_ERROR_RANGE;
}

static int arm_recorder(fw_t *fw) {
  const recorder_params_t *params = &fw->recorder.params;
  recorder_channel_t channels[RECORDER_CHANNELS];
  uint8_t count = 0;
  for (uint8_t i = 0; i < RECORDER_CHANNELS; i++) {
    const uint16_t object = object_at((int32_t)params->recorder_signal[i]);
    if (object != AXIS_OBJ_NONE) {
      channels[count] = object_channel(object);
      count++;
      if (!in_axis_or_recorder(object)) {
        wake(fw);
      }
    }
  }
  recorder_channel_t trigger = {.offset = 0, .type = AXIS_TYPE_U8};
  if (params->recorder_trigger_edge != AXIS_RECORDER_TRIGGER_EDGE_IMMEDIATE) {
    const uint16_t source = object_at((int32_t)params->recorder_trigger_source);
    if (source == AXIS_OBJ_NONE) {
      return FW_ERROR_RANGE;
    }
    trigger = object_channel(source);
  }
  return (recorder_arm(&fw->recorder, channels, count, trigger) == 0) ? FW_OK : FW_ERROR_RANGE;
}

/* Who asks from now on sees that the store is at work. */
static int begin_store(fw_t *fw, int refusal) {
  if (refusal == FW_OK) {
    fw->device_signals.store_state = AXIS_STORE_STATE_SAVING;
  }
  return refusal;
}

static int give_command(fw_t *fw, uint16_t object, int32_t value) {
  switch (object) {
    case AXIS_OBJ_FAULT_RESET:
      axis_fault_reset(&fw->axis);
      cia402_fault_reset(&fw->drive, &fw->axis);
      return FW_OK;
    case AXIS_OBJ_STORE_PARAMETERS:
    case AXIS_OBJ_STORE_ALL:
      return begin_store(fw, store_save(&fw->store));
    case AXIS_OBJ_RESTORE_DEFAULTS:
    case AXIS_OBJ_RESTORE_ALL:
      return begin_store(fw, store_forget(&fw->store));
    default:
      break;
  }
  if (value == 0) {
    recorder_stop(&fw->recorder);
  }
  const int refusal = (value != 0) ? arm_recorder(fw) : FW_OK;
  if (refusal == FW_OK) {
    canopen_recording_replaced(&fw->canopen);
  }
  return refusal;
}

/* The lock or its watchdog was written. */
static void announce_device(fw_t *fw, uint8_t source, uint16_t object, int32_t previous,
                            int32_t value) {
  fw->source_silence = 0;
  if (object == AXIS_OBJ_COMMAND_SOURCE && value != previous && !will_be_active(fw)) {
    cia402_forget_targets(&fw->drive); /* the new owner asks for its own */
  }
  if (object == AXIS_OBJ_COMMAND_SOURCE && value != previous &&
      value == AXIS_COMMAND_SOURCE_CANOPEN) {
    give_to_canopen(fw);
    /* If it took the axis itself it is there. */
    if (source != FW_SOURCE_CANOPEN) {
      look_for_canopen(fw);
    }
  }
}

/* Whoever depends on a parameter is told. */
static void announce(fw_t *fw, uint8_t source, uint16_t object, int32_t previous, int32_t value) {
  switch (axis_objects[object].block) {
    case AXIS_BLOCK_AXIS_PARAMETER:
      axis_parameter_written(&fw->axis, object, previous, value);
      if (object == AXIS_OBJ_MODE) {
        cia402_native_mode(&fw->drive, &fw->axis, (uint8_t)value);
      }
      break;
    case AXIS_BLOCK_DRIVE_PARAMETER:
      cia402_written(&fw->drive, &fw->axis, object, previous, value);
      break;
    case AXIS_BLOCK_CANOPEN_PARAMETER:
      canopen_written(&fw->canopen, object, previous, value);
      break;
    case AXIS_BLOCK_DEVICE_PARAMETER:
      announce_device(fw, source, object, previous, value);
      break;
    default:
      break;
  }
}

/* Flash at work can hold up the processor: no motion until it is done. */
static bool starts_axis(const fw_t *fw, uint16_t object, int32_t value) {
  return !cia402_is_powered(fw->drive.signals.drive_state) &&
         ((object == AXIS_OBJ_CONTROLWORD && cia402_enables((uint16_t)value)) ||
          (object == AXIS_OBJ_MODE && value != AXIS_MODE_DISABLED));
}

/* What the table, the lock and the state say; the rest is check_rules(). */
static int check_entry(const fw_t *fw, uint8_t source, uint16_t object, int32_t value) {
  if (!object_exists(object)) {
    return FW_ERROR_NO_OBJECT;
  }
  const axis_object_t *entry = &axis_objects[object];
  if (entry->access == AXIS_ACCESS_RO) {
    return FW_ERROR_READ_ONLY;
  }
  if (!in_range(entry, value)) {
    return FW_ERROR_RANGE;
  }
  if (is_locked(fw, source, object, value)) {
    return FW_ERROR_LOCKED;
  }
  if (!writable_now(fw, entry)) {
    return FW_ERROR_STATE;
  }
  /* A set of parameters is kept as it was at one moment. */
  if ((entry->stored != 0 || starts_axis(fw, object, value)) && store_is_busy(&fw->store)) {
    return FW_ERROR_BUSY;
  }
  return FW_OK;
}

int fw_object_check(const fw_t *fw, uint8_t source, uint16_t object, int32_t value) {
  const int refusal = check_entry(fw, source, object, value);
  if (refusal != FW_OK) {
    return refusal;
  }
  return (axis_objects[object].block == AXIS_BLOCK_NONE) ? FW_OK
                                                         : check_rules(fw, source, object, value);
}

static int write_object(fw_t *fw, uint8_t source, uint16_t object, int32_t value) {
  int refusal = check_entry(fw, source, object, value);
  if (refusal != FW_OK) {
    return refusal;
  }
  const axis_object_t *entry = &axis_objects[object];
  if (!in_axis_or_recorder(object)) {
    wake(fw);
  }
  if (entry->block == AXIS_BLOCK_NONE) {
    return give_command(fw, object, value);
  }
  refusal = check_rules(fw, source, object, value);
  if (refusal != FW_OK) {
    return refusal;
  }
  const uint16_t offset = object_offset(entry);
  const int32_t previous = value_load(fw, offset, entry->type);
  value_store(fw, offset, entry->type, value);
  announce(fw, source, object, previous, value);
  return FW_OK;
}

int fw_object_write(fw_t *fw, uint8_t source, uint16_t object, int32_t value) {
  const int refusal = write_object(fw, source, object, value);
  if (refusal == FW_OK && source == fw->device.command_source) {
    fw->source_silence = 0;
  }
  return refusal;
}

bool fw_object_restorable(uint16_t object, int32_t value) {
  return object_exists(object) && axis_objects[object].stored != 0 &&
         in_range(&axis_objects[object], value) && (object != AXIS_OBJ_FORCE_SIGN || value != 0);
}

void fw_object_restore(fw_t *fw, uint16_t object, int32_t value) {
  const axis_object_t *entry = &axis_objects[object];
  value_store(fw, object_offset(entry), entry->type, value);
}

int fw_recorder_read(const fw_t *fw, uint32_t index, int32_t values[RECORDER_CHANNELS]) {
  const int count = recorder_read(&fw->recorder, index, values);
  return (count < 0) ? FW_ERROR_NO_DATA : count;
}
