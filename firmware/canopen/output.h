#ifndef FIRMWARE_CANOPEN_OUTPUT_H_
#define FIRMWARE_CANOPEN_OUTPUT_H_

/* The output queue of CAN frames. The frame that was added first is sent first. The queue refuses
 * frames of low priority before it is full, so emergency messages and heartbeats can still be added
 * while many requests are answered. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/fx/bytes.h"

enum { CAN_OUTPUT_FRAMES = 16 };

/* Number of free places that must remain in the output queue after a frame of this kind was
 * added. */
enum {
  CAN_OUTPUT_KEEP_NMT = 0,
  CAN_OUTPUT_KEEP_EMCY = 1,
  CAN_OUTPUT_KEEP_PDO = 2,
  CAN_OUTPUT_KEEP_SDO = 6
};

typedef struct {
  can_frame_t frames[CAN_OUTPUT_FRAMES];
  /* number of frames that the queue refused because it was full, since this number was last set to
   * 0 */
  uint16_t lost;
  uint8_t first;
  uint8_t count;
  uint8_t closed; /* 1: the bus is off; new frames are discarded and not counted in `lost` */
} can_output_t;

void can_output_clear(can_output_t *output);

/* Adds an empty frame with identifier `id` and length `length`; the caller writes the data of the
 * frame. If the queue has no room for the frame, the frame is counted in `lost` and the function
 * returns NULL. The pointer is valid until the next call. */
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
  fx_assert(output->first < CAN_OUTPUT_FRAMES && length <= 8 && id <= 0x7FF);
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

/* Removes the oldest frame from the output queue and stores it in *frame. Returns false if the
 * queue is empty. */
bool can_output_take(can_output_t *output, can_frame_t *frame);

#endif
