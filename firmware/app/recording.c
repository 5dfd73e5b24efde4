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

uint32_t recording_size(const dictionary_t *objects) {
  const recorder_t *recorder = &fw_of_const(objects)->recorder;
  const bool is_done = recorder->signals.recorder_state == AXIS_RECORDER_STATE_DONE;
  return is_done ? recorder->signals.recorder_count * recorder->sample_bytes : 0;
}

uint32_t recording_read(const dictionary_t *objects, uint32_t offset, uint8_t *bytes,
                        uint32_t count) {
  return recorder_bytes(&fw_of_const(objects)->recorder, offset, bytes, count);
}
