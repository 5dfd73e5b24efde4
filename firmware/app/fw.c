#include "firmware/app/fw.h"

#include <stdbool.h>
#include <stddef.h>

#include "firmware/core/value.h"

/* Where each block of the object table lies in fw_t. */
static const uint16_t block_offset[AXIS_BLOCK_NONE] = {
    [AXIS_BLOCK_AXIS_PARAMETER] = (uint16_t)offsetof(fw_t, axis.params),
    [AXIS_BLOCK_AXIS_SIGNAL] = (uint16_t)offsetof(fw_t, axis.signals),
    [AXIS_BLOCK_RECORDER_PARAMETER] = (uint16_t)offsetof(fw_t, recorder.params),
    [AXIS_BLOCK_RECORDER_SIGNAL] = (uint16_t)offsetof(fw_t, recorder.signals),
};

static uint16_t object_offset(const axis_object_t *object) {
  return (uint16_t)(block_offset[object->block] + object->offset);
}

static bool object_exists(uint16_t object) {
  return object != AXIS_OBJ_NONE && object < AXIS_OBJ_COUNT;
}

static bool object_readable(int32_t object) {
  return object > AXIS_OBJ_NONE && object < AXIS_OBJ_COUNT &&
         axis_objects[object].access != AXIS_ACCESS_WO;
}

static recorder_channel_t object_channel(uint16_t object) {
  const axis_object_t *entry = &axis_objects[object];
  return (recorder_channel_t){.offset = object_offset(entry), .type = entry->type};
}

void fw_init(fw_t *fw, void *recorder_buffer, uint32_t recorder_bytes) {
  axis_init(&fw->axis);
  recorder_init(&fw->recorder, recorder_buffer, recorder_bytes);
}

void fw_tick(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs) {
  axis_tick(&fw->axis, inputs, outputs);
  recorder_tick(&fw->recorder, fw);
}

int fw_object_read(const fw_t *fw, uint16_t object, int32_t *value) {
  if (!object_exists(object)) {
    return FW_ERROR_NO_OBJECT;
  }
  const axis_object_t *entry = &axis_objects[object];
  if (entry->access == AXIS_ACCESS_WO) {
    return FW_ERROR_WRITE_ONLY;
  }
  *value = value_load(fw, object_offset(entry), entry->type);
  return FW_OK;
}

/* Whether the object's `writable` column allows a write now. */
static bool writable_now(const fw_t *fw, const axis_object_t *entry) {
  const uint8_t recorder = fw->recorder.signals.recorder_state;
  switch (entry->writable) {
    case AXIS_WRITABLE_DISABLED:
      return fw->axis.signals.active_mode == AXIS_MODE_DISABLED;
    case AXIS_WRITABLE_RECORDER_IDLE:
      return recorder == AXIS_RECORDER_STATE_IDLE || recorder == AXIS_RECORDER_STATE_DONE;
    default:
      return true;
  }
}

/* What a range alone cannot say. */
static int check_rules(const fw_t *fw, uint16_t object, int32_t value) {
  const axis_params_t *params = &fw->axis.params;
  bool in_range = true;
  switch (object) {
    case AXIS_OBJ_MODE:
      return (value != AXIS_MODE_DISABLED && fw->axis.signals.fault != AXIS_FAULT_NONE)
                 ? FW_ERROR_STATE
                 : FW_OK;
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
      in_range = value == AXIS_OBJ_NONE || object_readable(value);
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
    if (params->recorder_signal[i] != AXIS_OBJ_NONE) {
      channels[count] = object_channel(params->recorder_signal[i]);
      count++;
    }
  }
  recorder_channel_t trigger = {.offset = 0, .type = AXIS_TYPE_U8};
  if (params->recorder_trigger_edge != AXIS_RECORDER_TRIGGER_EDGE_IMMEDIATE) {
    if (params->recorder_trigger_source == AXIS_OBJ_NONE) {
      return FW_ERROR_RANGE;
    }
    trigger = object_channel(params->recorder_trigger_source);
  }
  return (recorder_arm(&fw->recorder, channels, count, trigger) == 0) ? FW_OK : FW_ERROR_RANGE;
}

static int give_command(fw_t *fw, uint16_t object, int32_t value) {
  if (object == AXIS_OBJ_FAULT_RESET) {
    axis_fault_reset(&fw->axis);
    return FW_OK;
  }
  if (value != 0) {
    return arm_recorder(fw);
  }
  recorder_stop(&fw->recorder);
  return FW_OK;
}

int fw_object_write(fw_t *fw, uint16_t object, int32_t value) {
  if (!object_exists(object)) {
    return FW_ERROR_NO_OBJECT;
  }
  const axis_object_t *entry = &axis_objects[object];
  if (entry->access == AXIS_ACCESS_RO) {
    return FW_ERROR_READ_ONLY;
  }
  if (value < entry->min || value > entry->max) {
    return FW_ERROR_RANGE;
  }
  if (!writable_now(fw, entry)) {
    return FW_ERROR_STATE;
  }
  if (entry->block == AXIS_BLOCK_NONE) {
    return give_command(fw, object, value);
  }
  const int refusal = check_rules(fw, object, value);
  if (refusal != FW_OK) {
    return refusal;
  }
  const uint16_t offset = object_offset(entry);
  const int32_t previous = value_load(fw, offset, entry->type);
  value_store(fw, offset, entry->type, value);
  axis_parameter_written(&fw->axis, object, previous, value);
  return FW_OK;
}

int fw_recorder_read(const fw_t *fw, uint32_t index, int32_t values[RECORDER_CHANNELS]) {
  const int count = recorder_read(&fw->recorder, index, values);
  return (count < 0) ? FW_ERROR_NO_DATA : count;
}
