#ifndef FIRMWARE_PORT_STM32F4_CAN_H_
#define FIRMWARE_PORT_STM32F4_CAN_H_

/* One of the two CAN controllers of the chip with its buffer of received frames. can.c has the bus
 * of the axis (CAN1), drive_bus.c the bus of a drive (CAN2). */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/port/stm32f4/registers.h"

/* Number of frames in the ring buffer, a power of 2. At most 14 frames arrive between two ticks:
 * the shortest frames at 1 Mbit/s. */
enum { CAN_LINE_RING = 32 };

typedef struct {
  can_t *registers;
  uint32_t interrupts; /* value of CAN_IER */
  can_frame_t ring[CAN_LINE_RING];
  volatile uint8_t ring_in;  /* index in `ring` that only the interrupt writes */
  volatile uint8_t ring_out; /* index in `ring` that only the reader writes */
  /* number of frames for which the ring buffer had no room; written by the interrupt */
  volatile uint16_t dropped;
  uint16_t dropped_reported;
  enum { CAN_LINE_STOPPED, CAN_LINE_ENTERING, CAN_LINE_JOINING, CAN_LINE_RUNNING } state;
  uint32_t waited_ticks;
  /* number of ticks in which the node was error passive and could send no frame */
  uint16_t stalled_ticks;
  uint32_t prescaler;
  uint8_t reported; /* CAN_BUS_ */
} can_line_t;

/* Requests the initialisation of a controller whose clock runs, with CAN_IER_ bits of its
 * interrupts; can_line_bus() continues the initialisation in each tick. A line that was not started
 * neither sends nor receives. */
void can_line_start(can_line_t *line, can_t *registers, uint32_t interrupts, uint16_t kbit_s);

/* Returns the state of the bus (CAN_BUS_). Call this function once in each tick. */
uint8_t can_line_bus(can_line_t *line);

/* Sets the bit rate; a new bit rate aborts waiting frames, and the node joins the bus again. */
void can_line_rate(can_line_t *line, uint16_t kbit_s);

/* Returns the number of frames lost since the last call. */
uint16_t can_line_lost(can_line_t *line);

/* Moves a received frame to the ring buffer; the interrupt of FIFO 0 calls it. */
void can_line_take(can_line_t *line);
bool can_line_receive(can_line_t *line, can_frame_t *frame);

/* Writes a frame into an empty mailbox. Returns false if there is none; true also for a frame that
 * is given up because nobody has acknowledged a frame for 100 ms. */
bool can_line_send(can_line_t *line, const can_frame_t *frame);

/* Aborts the frames that wait in the mailboxes. */
void can_line_abort(can_line_t *line);

#endif
