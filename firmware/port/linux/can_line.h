#ifndef FIRMWARE_PORT_LINUX_CAN_LINE_H_
#define FIRMWARE_PORT_LINUX_CAN_LINE_H_

/* One CAN interface of Linux (SocketCAN) for a port: frames with 11-bit identifiers, the state of
 * the bus, and the number of lost frames. No call waits.
 *
 * The bus is off while the controller is bus off, while the interface is down, and while there is
 * no interface. The bus works again without a call. After bus off, it works when the driver has
 * restarted the controller (`restart-ms` of `ip link`, or `ip link set can0 type can restart`) and
 * the controller has seen the sequences of recessive bits of CiA 301. In the other cases it works
 * when the interface is up again. If the controller is bus off, the interface is still up, so the
 * state of the interface alone does not show that the bus works. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/port/linux/can_raw.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  can_raw_t raw;
  /* state of the bus (CAN_BUS_) that the error frames of the controller have reported */
  uint8_t controller;
  bool is_down;     /* true: the interface is down or was removed */
  bool was_removed; /* true: the interface was removed, so the socket belongs to no interface */
  /* true: while the bus is off, the interface was at least once without carrier */
  bool has_no_carrier;
  /* true: the bus was off at some time since the last call of can_line_state() */
  bool was_off;
  /* number of calls of can_line_receive() since a bus that is off was last checked */
  uint8_t calls;
  /* value of raw.dropped (number of dropped frames) at the last call of can_line_lost() */
  uint32_t last_lost;
} can_line_t;

/* Opens a CAN interface, for example "can0". The interface may be down. */
can_raw_result_t can_line_open(can_line_t *line, const char *interface);

/* Returns a text that describes a failure of can_line_open(). */
const char *can_line_error(can_raw_result_t result);

/* Reads the next received frame. Returns false if there is no frame. Error frames are not returned,
 * but change the state of the bus. Call this function at least once in each tick. While the bus is
 * off, every 150th call checks whether the bus works again. */
bool can_line_receive(can_line_t *line, can_frame_t *frame);

/* Returns the state of the bus (CAN_BUS_). If the bus was off at some time since the last call, the
 * result is CAN_BUS_OFF once, even if the bus works again. */
uint8_t can_line_state(can_line_t *line);

/* Returns the reason why the bus is off, as a sentence without a full stop. Returns NULL while the
 * bus is not off. */
const char *can_line_trouble(const can_line_t *line);

/* Sends a frame. Returns false if the bus is off, or if the queue of the interface has no room. In
 * the second case the caller repeats the call later. */
bool can_line_send(can_line_t *line, const can_frame_t *frame);

/* Returns the number of frames lost since the last call, at most 65535. */
uint16_t can_line_lost(can_line_t *line);

#ifdef __cplusplus
}
#endif

#endif
