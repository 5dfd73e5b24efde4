#ifndef FIRMWARE_PORT_LINUX_CAN_LINE_H_
#define FIRMWARE_PORT_LINUX_CAN_LINE_H_

/* One CAN interface of Linux (SocketCAN) for a port: frames with 11-bit identifiers, the state of
 * the bus, and the number of lost frames. No call waits. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"

typedef struct {
  int socket;
  uint8_t state;      /* CAN_BUS_ */
  uint32_t dropped;   /* frames that the kernel has dropped since the socket was opened */
  uint32_t last_lost; /* value of `dropped` at the last call of can_line_lost() */
} can_line_t;

/* Opens an interface such as "can0". Returns NULL, or a text with the error. */
const char *can_line_open(can_line_t *line, const char *interface);

/* Takes the next received frame. Returns false if there is none. Error frames change the state. */
bool can_line_receive(can_line_t *line, can_frame_t *frame);

/* Returns false if the queue of the interface has no room; the caller then repeats the call. */
bool can_line_send(can_line_t *line, const can_frame_t *frame);

/* Returns the number of frames lost since the last call, at most 65535. */
uint16_t can_line_lost(can_line_t *line);

#endif
