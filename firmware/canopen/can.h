#ifndef FIRMWARE_CANOPEN_CAN_H_
#define FIRMWARE_CANOPEN_CAN_H_

#include <stdint.h>

/* A classic CAN frame with an 11-bit identifier. CANopen uses only frames of this kind, so the code
 * for a board discards all other frames. */
typedef struct {
  uint16_t id;    /* identifier, 0..2047 */
  uint8_t length; /* number of data bytes, 0..8 */
  uint8_t remote; /* 1: the frame is a remote request without data */
  uint8_t data[8];
} can_frame_t;

/* State of the CAN bus that the code for the board reports. */
enum { CAN_BUS_ACTIVE = 0, CAN_BUS_PASSIVE = 1, CAN_BUS_OFF = 2 };

#endif
