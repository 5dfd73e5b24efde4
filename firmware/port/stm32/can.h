#ifndef FIRMWARE_PORT_STM32_CAN_H_
#define FIRMWARE_PORT_STM32_CAN_H_

/* One of the two CAN controllers of the chip with its buffer of received frames. The bus of the
 * axis is in can.c, and the bus of a drive is in drive_bus.c. */

#include <stdbool.h>
#include <stdint.h>

#include "chip.h"
#include "firmware/canopen/can.h"

/* Number of frames for which the ring buffer has room; it must be a power of 2. Between two ticks
 * at most 14 frames can arrive, if they are the shortest frames at 1 Mbit/s. */
enum { CAN_LINE_RING = 32 };

typedef struct {
  can_controller_t *registers;
  bool reports_sent; /* true: a frame that was sent causes an interrupt */
  can_frame_t ring[CAN_LINE_RING];
  /* index in `ring` of the next frame to store; only the interrupt writes it */
  volatile uint8_t ring_in;
  /* index in `ring` of the next frame to read; only the reader writes it */
  volatile uint8_t ring_out;
  /* number of frames for which the ring buffer had no room; written by the interrupt */
  volatile uint16_t dropped;
  uint16_t dropped_reported;
  enum { CAN_LINE_STOPPED, CAN_LINE_ENTERING, CAN_LINE_JOINING, CAN_LINE_RUNNING } state;
  uint32_t waited_ticks;
  /* number of ticks in which the node was error passive and could send no frame */
  uint16_t stalled_ticks;
  uint16_t kbit_s;
  uint8_t reported; /* state of the bus (CAN_BUS_) that was last reported */
} can_line_t;

/* Requests the initialisation of a connected CAN controller. can_line_bus() continues the
 * initialisation in each tick. A line that was not started neither sends nor receives. If
 * `reports_sent` is true, each frame that was sent causes an interrupt. */
void can_line_start(can_line_t *line, can_controller_t *registers, bool reports_sent,
                    uint16_t kbit_s);

/* Returns the state of the bus (CAN_BUS_). Call this function once in each tick. */
uint8_t can_line_bus(can_line_t *line);

/* Sets the bit rate. If the bit rate changes, the waiting frames are aborted, and the node joins
 * the bus again. */
void can_line_rate(can_line_t *line, uint16_t kbit_s);

/* Discards all frames that wait in the controller to be sent. */
void can_line_give_up(can_line_t *line);

/* Returns the number of frames lost since the last call. */
uint16_t can_line_lost(can_line_t *line);

/* Moves all received frames from the controller to the ring buffer. The interrupt of a received
 * frame calls this function. */
void can_line_take(can_line_t *line);
bool can_line_receive(can_line_t *line, can_frame_t *frame);

/* Passes a frame to the controller. Returns false if the controller has no room. If no node has
 * acknowledged a frame for 100 ms, the frame is discarded, and the result is true. */
bool can_line_send(can_line_t *line, const can_frame_t *frame);

/* The functions of a CAN controller. bxcan.c or fdcan.c in the folder of the board implements them.
 *
 * can_controller_connect_axis() and can_controller_connect_drive() each start the clock of a
 * controller and connect its pins and interrupts. can_controller_connect_axis() also sets both
 * controllers to accept every frame with an 11-bit identifier. */
void can_controller_connect_axis(void);
void can_controller_connect_drive(void);

/* Functions for joining the bus. can_controller_enter() requests the initialisation. In the
 * initialisation, can_controller_join() sets the bit timing and the interrupts, and requests the
 * end of the initialisation. The controller has joined the bus when it is neither in initialisation
 * nor bus off. */
void can_controller_enter(can_line_t *line);
bool can_controller_has_entered(const can_line_t *line);
void can_controller_join(can_line_t *line);
bool can_controller_has_joined(const can_line_t *line);

/* Returns the state of the bus (CAN_BUS_) according to the error counters of the controller. */
uint8_t can_controller_bus(const can_line_t *line);

/* Functions for frames that wait to be sent. can_controller_is_empty() returns true if no frame
 * waits. can_controller_abort() discards all waiting frames. It returns false if the controller can
 * discard frames only in an initialisation. can_controller_send() returns false if there is no room
 * for another frame. */
bool can_controller_is_empty(const can_line_t *line);
bool can_controller_abort(can_line_t *line);
bool can_controller_send(can_line_t *line, const can_frame_t *frame);

/* Removes the oldest received frame from the controller, and writes it to *frame unless `frame` is
 * NULL. Returns false if there is no received frame. The next received frame then causes the
 * interrupt again. */
bool can_controller_take(can_line_t *line, can_frame_t *frame);

/* Returns true if the controller has lost a received frame since the last call. */
bool can_controller_lost(can_line_t *line);

/* Clears the interrupt request that a sent frame has caused. */
void can_controller_note_sent(can_line_t *line);

#endif
