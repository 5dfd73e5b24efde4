#ifndef FIRMWARE_PORT_LINUX_LOAD_CELL_H_
#define FIRMWARE_PORT_LINUX_LOAD_CELL_H_

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Format of the force of a load cell in a CAN frame. The force is an integer of 1 to 4 bytes, the
 * lowest byte first, which load_cell_code() converts to an ADC code. */
typedef struct {
  uint16_t identifier; /* CAN identifier of the frame, 1..2047; 0: no frame has the force */
  uint8_t byte;        /* number of the lowest byte in the frame, 0..7 */
  uint8_t bytes;       /* 1..4 */
  uint8_t shift;       /* 0..31 */
  bool is_signed;
} load_cell_t;

/* Returns the ADC code of an integer of at most 32 bits: (integer >> shift) + 32768 if it may be
 * negative, and integer >> shift otherwise, both limited to 0..65535; shift 0..31. */
uint16_t load_cell_code(int64_t value, uint8_t shift, bool is_signed);

/* Reads the ADC code from a frame. Returns false if the frame is not that of the load cell, is a
 * remote request, or is too short; *code then stays as it is. */
bool load_cell_take(const load_cell_t *cell, const can_frame_t *frame, uint16_t *code);

#ifdef __cplusplus
}
#endif

#endif
