#include "firmware/canopen/output.h"

void can_output_clear(can_output_t *output) {
  output->first = 0;
  output->count = 0;
}

bool can_output_take(can_output_t *output, can_frame_t *frame) {
  fx_assert(output->first < CAN_OUTPUT_FRAMES && output->count <= CAN_OUTPUT_FRAMES);
  if (output->count == 0) {
    return false;
  }
  *frame = output->frames[output->first];
  output->first = (uint8_t)((output->first + 1 < CAN_OUTPUT_FRAMES) ? output->first + 1 : 0);
  output->count = (uint8_t)(output->count - 1);
  return true;
}
