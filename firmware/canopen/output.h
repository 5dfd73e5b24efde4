#ifndef FIRMWARE_CANOPEN_OUTPUT_H_
#define FIRMWARE_CANOPEN_OUTPUT_H_

/* The queue of frames to be sent, first in first out. Less important frames are refused earlier, so
 * that a flood of requests leaves places for emergencies and heartbeats. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/fx/bytes.h"

enum { CAN_OUTPUT_FRAMES = 16 };

/* Places that a frame of each kind must leave free. */
enum {
  CAN_OUTPUT_KEEP_NMT = 0,
  CAN_OUTPUT_KEEP_EMCY = 1,
  CAN_OUTPUT_KEEP_PDO = 2,
  CAN_OUTPUT_KEEP_SDO = 6
};

typedef struct {
  can_frame_t frames[CAN_OUTPUT_FRAMES];
  uint16_t lost; /* frames that found no place, until the owner reads and clears the number */
  uint8_t first;
  uint8_t count;
  uint8_t closed; /* 1: the bus is off, frames are dropped and not counted */
} can_output_t;

void can_output_clear(can_output_t *output);

/* An empty frame with this identifier and length, to be filled in; one that is refused is counted
 * as lost and returned as NULL. Valid until the next call. */
static inline can_frame_t *can_output_add(can_output_t *output, uint16_t id, uint8_t length,
                                          uint8_t keep) {
  const uint32_t count = output->count;
  if (output->closed != 0) {
    return NULL;
  }
  if (count + keep >= CAN_OUTPUT_FRAMES) {
    output->lost = (uint16_t)(output->lost + ((output->lost < UINT16_MAX) ? 1 : 0));
    return NULL;
  }
  const uint32_t at = output->first + count;
  output->count = (uint8_t)(count + 1);
  can_frame_t *frame = &output->frames[(at < CAN_OUTPUT_FRAMES) ? at : at - CAN_OUTPUT_FRAMES];
  frame->id = id;
  frame->length = length;
  frame->remote = 0;
  fx_store_le(frame->data, 0, 4);
  fx_store_le(frame->data + 4, 0, 4);
  return frame;
}

/* The oldest frame; false: none. */
bool can_output_take(can_output_t *output, can_frame_t *frame);

#endif
