#ifndef FIRMWARE_PORT_LINUX_LOAD_CELL_H_
#define FIRMWARE_PORT_LINUX_LOAD_CELL_H_

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Format of the force of a load cell in a CAN frame. The force is an integer of 1 to 4 bytes, the
 * lowest byte first. load_cell_code() converts this integer to an ADC code. */
typedef struct {
  /* CAN identifier of the frame with the force, 1..2047; 0: there is no load cell */
  uint16_t identifier;
  uint8_t byte;  /* index of the lowest byte of the integer in the frame, 0..7 */
  uint8_t bytes; /* number of bytes of the integer, 1..4 */
  uint8_t shift; /* number of low bits of the integer that are cut off, 0..31 */
  bool is_signed;
} load_cell_t;

/* Returns the ADC code for the integer `value` of at most 32 bits. The code is (value >> shift) +
 * 32768 if the integer is signed, and value >> shift otherwise. It is limited to 0..65535. `shift`
 * is 0..31. */
uint16_t load_cell_code(int64_t value, uint8_t shift, bool is_signed);

/* Reads the ADC code of the force from a frame. If the frame is not from the load cell, is a remote
 * request or is too short, returns false and does not change *code. */
bool load_cell_take(const load_cell_t *cell, const can_frame_t *frame, uint16_t *code);

#ifdef __cplusplus
}
#endif

#endif
