#include "firmware/app/recording.h"

#include "firmware/app/ownership.h"

int recording_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  (void)objects;
  (void)source;
  const bool names_object =
      (object >= AXIS_OBJ_RECORDER_SIGNAL_1 && object <= AXIS_OBJ_RECORDER_SIGNAL_8) ||
      object == AXIS_OBJ_RECORDER_TRIGGER_SOURCE;
  const bool fits =
      !names_object || value == 0 || dictionary_has_value(dictionary_object_at((uint32_t)value));
  return fits ? FW_OK : FW_ERROR_RANGE;
}

recorder_channel_t recording_channel(const fw_t *fw, uint16_t object) {
  return (recorder_channel_t){.offset = dictionary_place(&fw->objects, object),
                              .type = axis_objects[object].type};
}

bool recording_is_without_drive(uint16_t object) {
  const uint8_t block = axis_objects[object].block;
  return object == AXIS_OBJ_FAULT_RESET || object == AXIS_OBJ_RECORDER_ARM ||
         block == AXIS_BLOCK_AXIS_PARAMETER || block == AXIS_BLOCK_AXIS_SIGNAL ||
         block == AXIS_BLOCK_LAW_PARAMETER || block == AXIS_BLOCK_LAW_SIGNAL ||
         block == AXIS_BLOCK_RECORDER_PARAMETER || block == AXIS_BLOCK_RECORDER_SIGNAL;
}

bool recording_needs_drive(const fw_t *fw) {
  const recorder_params_t *params = &fw->recorder.params;
  bool needed = params->recorder_trigger_edge == AXIS_RECORDER_TRIGGER_EDGE_EXCITATION_START;
  for (uint8_t i = 0; i < RECORDER_CHANNELS; i++) {
    const uint16_t object = dictionary_object_at(params->recorder_signal[i]);
    needed = needed || (object != AXIS_OBJ_NONE && !recording_is_without_drive(object));
  }
  return needed;
}

static int arm_recorder(fw_t *fw) {
  const recorder_params_t *params = &fw->recorder.params;
  const uint8_t edge = params->recorder_trigger_edge;
  recorder_channel_t channels[RECORDER_CHANNELS];
  uint8_t count = 0;
  for (uint8_t i = 0; i < RECORDER_CHANNELS; i++) {
    const uint16_t object = dictionary_object_at(params->recorder_signal[i]);
    if (object != AXIS_OBJ_NONE) {
      channels[count] = recording_channel(fw, object);
      count++;
    }
  }
  recorder_channel_t trigger = {.offset = 0, .type = AXIS_TYPE_U8};
  const bool starts = edge == AXIS_RECORDER_TRIGGER_EDGE_EXCITATION_START;
  if (edge != AXIS_RECORDER_TRIGGER_EDGE_IMMEDIATE) {
    const uint16_t source = starts ? (uint16_t)AXIS_OBJ_EXCITATION_STATE
                                   : dictionary_object_at(params->recorder_trigger_source);
    if (source == AXIS_OBJ_NONE) {
      return FW_ERROR_RANGE;
    }
    trigger = recording_channel(fw, source);
  }
  if (recorder_arm(&fw->recorder, channels, count, trigger) != 0) {
    return FW_ERROR_RANGE;
  }
  if (starts) {
    /* An excitation that starts before the recorder has computed its first tick also triggers the
     * recording. */
    recorder_prime(&fw->recorder, fw->drive.signals.excitation_state);
  }
  return FW_OK;
}

int recording_command(fw_t *fw, bool arm) {
  if (arm) {
    const int refusal = arm_recorder(fw);
    if (refusal != FW_OK) {
      return refusal;
    }
  } else {
    recorder_stop(&fw->recorder);
  }
  canopen_domain_replaced(&fw->canopen, DICTIONARY_RECORDING);
  return FW_OK;
}

int32_t recording_size(const fw_t *fw) {
  const recorder_t *recorder = &fw->recorder;
  const bool is_done = recorder->signals.recorder_state == AXIS_RECORDER_STATE_DONE;
  const uint32_t size = recorder->signals.recorder_count * recorder->sample_bytes;
  return (is_done && size != 0) ? (int32_t)size : FW_ERROR_NO_DATA;
}
