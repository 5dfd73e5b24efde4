#ifndef FIRMWARE_PORT_LINUX_CAN_LINE_H_
#define FIRMWARE_PORT_LINUX_CAN_LINE_H_

/* One CAN interface of Linux (SocketCAN) for a port: frames with 11-bit identifiers, the state of
 * the bus, and the number of lost frames. No call waits.
 *
 * The bus is off while the controller is bus off, while the interface is down, and while there is
 * no interface. It comes back by itself: after bus off when the driver has restarted the controller
 * (`restart-ms` of `ip link`, or `ip link set can0 type can restart`), which also takes the
 * sequences of recessive bits of CiA 301; otherwise when the interface is up again. An interface
 * whose controller is bus off is up, so that alone is no sign. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/port/linux/can_raw.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  can_raw_t raw;
  uint8_t controller;  /* state of the bus (CAN_BUS_), as the error frames of the controller report
                        * it */
  bool is_down;        /* the interface is down or was removed */
  bool was_removed;    /* the interface was removed, so that the socket belongs to none */
  bool has_no_carrier; /* the controller was seen without carrier since it is bus off */
  bool was_off;        /* the bus was off since the last call of can_line_state() */
  uint8_t calls;       /* number of calls of can_line_receive() until a bus that is off is checked
                        * again */
  uint32_t last_lost;  /* value of raw.dropped at the last call of can_line_lost() */
} can_line_t;

/* Opens an interface such as "can0", which may be down. */
can_raw_result_t can_line_open(can_line_t *line, const char *interface);

/* Returns the text of a failure of can_line_open(). */
const char *can_line_error(can_raw_result_t result);

/* Reads the next received frame. Returns false if there is none. Error frames change the state.
 * Must be called at least in each tick: with the bus off, every 150th call looks whether it is
 * back. */
bool can_line_receive(can_line_t *line, can_frame_t *frame);

/* Returns the state of the bus, CAN_BUS_. If the bus was off since the last call, it is
 * CAN_BUS_OFF once, also when the bus is back. */
uint8_t can_line_state(can_line_t *line);

/* Returns why the bus is off, as a sentence without a full stop, or NULL while it is not. */
const char *can_line_trouble(const can_line_t *line);

/* Returns false if the queue of the interface has no room, and the caller then repeats the call; or
 * if the bus is off. */
bool can_line_send(can_line_t *line, const can_frame_t *frame);

/* Returns the number of frames lost since the last call, at most 65535. */
uint16_t can_line_lost(can_line_t *line);

#ifdef __cplusplus
}
#endif

#endif
