#ifndef FIRMWARE_PORT_LINUX_LOAD_CELL_H_
#define FIRMWARE_PORT_LINUX_LOAD_CELL_H_

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The force of a load cell in a CAN frame: an integer of 1 to 4 bytes, the lowest byte first. The
 * ADC code is (integer >> shift) + 32768 for a signed integer, and integer >> shift otherwise, both
 * limited to 0..65535. */
typedef struct {
  uint16_t identifier; /* of the frame, 1..2047 */
  uint8_t byte;        /* number of the lowest byte in the frame, 0..7 */
  uint8_t bytes;       /* 1..4 */
  uint8_t shift;       /* 0..31 */
  bool is_signed;
} load_cell_t;

/* Takes the ADC code of a frame. Returns false if the frame is not that of the load cell, is a
 * remote request, or is too short; *code then stays as it is. */
bool load_cell_take(const load_cell_t *cell, const can_frame_t *frame, uint16_t *code);

#ifdef __cplusplus
}
#endif

#endif
