#include "firmware/proto/can_output.h"

#include <stddef.h>

void can_output_clear(can_output_t *output) {
  output->first = 0;
  output->count = 0;
}

can_frame_t *can_output_add(can_output_t *output, uint16_t id, uint8_t length, uint8_t keep) {
  if (output->closed != 0) {
    return NULL;
  }
  if (output->count + keep >= CAN_OUTPUT_FRAMES) {
    output->lost = (uint16_t)(output->lost + ((output->lost < UINT16_MAX) ? 1 : 0));
    return NULL;
  }
  uint8_t at = (uint8_t)(output->first + output->count);
  at = (at < CAN_OUTPUT_FRAMES) ? at : (uint8_t)(at - CAN_OUTPUT_FRAMES);
  output->count = (uint8_t)(output->count + 1);
  can_frame_t *frame = &output->frames[at];
  frame->id = id;
  frame->length = length;
  frame->remote = 0;
  for (uint8_t i = 0; i < 8; i++) {
    frame->data[i] = 0;
  }
  return frame;
}

bool can_output_take(can_output_t *output, can_frame_t *frame) {
  if (output->count == 0) {
    return false;
  }
  *frame = output->frames[output->first];
  output->first = (uint8_t)((output->first + 1 < CAN_OUTPUT_FRAMES) ? output->first + 1 : 0);
  output->count = (uint8_t)(output->count - 1);
  return true;
}
