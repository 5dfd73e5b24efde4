#ifndef FIRMWARE_CANOPEN_OUTPUT_H_
#define FIRMWARE_CANOPEN_OUTPUT_H_

/* The queue of CAN frames to send, first in, first out. Frames of low priority are refused before
 * the queue is full, so that many requests still leave room for emergency messages and
 * heartbeats. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/fx/bytes.h"

enum { CAN_OUTPUT_FRAMES = 16 };

/* Number of free slots that a frame of each kind must leave in the queue. */
enum {
  CAN_OUTPUT_KEEP_NMT = 0,
  CAN_OUTPUT_KEEP_EMCY = 1,
  CAN_OUTPUT_KEEP_PDO = 2,
  CAN_OUTPUT_KEEP_SDO = 6
};

typedef struct {
  can_frame_t frames[CAN_OUTPUT_FRAMES];
  /* number of frames that the full queue refused, until the owner reads and clears it */
  uint16_t lost;
  uint8_t first;
  uint8_t count;
  uint8_t closed; /* 1: the bus is off; frames are discarded and not counted */
} can_output_t;

void can_output_clear(can_output_t *output);

/* Adds an empty frame with this identifier and length; the caller fills it in. If the queue has no
 * room, the frame is counted as lost and the function returns NULL. The pointer is valid until the
 * next call. */
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

/* Removes and returns the oldest frame; false: the queue is empty. */
bool can_output_take(can_output_t *output, can_frame_t *frame);

#endif
