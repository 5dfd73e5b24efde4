/* A CAN line: its functions join the bus, leave the state bus off, and buffer the received frames.
 * can.h declares the functions of its CAN controller. The folder of the board implements them. */

#include "firmware/port/stm32/can.h"

#include <stddef.h>

#include "firmware/port/port.h"
#include "firmware/port/stm32/barrier.h"
#include "firmware/port/stm32/board.h"

/* Longest time in ticks in which the CAN controller must join the bus. After this time the
 * initialisation is repeated. The time is 1500 ticks (one second) plus 27 ticks at 1 Mbit/s, and
 * more at lower bit rates. A node joins the bus after 11 recessive bits. After bus off the
 * controller waits for 128 sequences of 11 recessive bits (FDCAN: 129). It counts them only outside
 * initialisation (RM0090 32.7.6, RM0440 FDCAN_PSR). On an idle bus this takes 2.2 ticks at 1
 * Mbit/s. On a full bus each frame of at most 135 bits has only one such sequence, so 128 sequences
 * take 26 ticks at 1 Mbit/s. */
#define PATIENCE_TICKS UINT32_C(1500)
#define PATIENCE_TICKS_KBIT_S UINT32_C(27000)

/* Number of ticks (100 ms) after which a waiting frame is too old, because the node is error
 * passive and could not send it. Three of the longest frames take 41 ms at 10 kbit/s. */
enum { STALE_TICKS = 150 };

static can_line_t bus;

static void enter_initialisation(can_line_t *line) {
  can_controller_enter(line);
  line->state = CAN_LINE_ENTERING;
  line->waited_ticks = 0;
}

void can_line_start(can_line_t *line, can_controller_t *registers, bool reports_sent,
                    uint16_t kbit_s) {
  line->registers = registers;
  line->reports_sent = reports_sent;
  line->kbit_s = kbit_s;
  enter_initialisation(line);
}

void can_init(bool clock_is_right) {
  if (!clock_is_right) {
    bus.reported = CAN_BUS_OFF;
    return;
  }
  can_controller_connect_axis();
  can_line_start(&bus, CAN_OF_AXIS, false, 1000);
}

void can_line_give_up(can_line_t *line) {
  if (!can_controller_abort(line)) {
    enter_initialisation(line);
  }
}

/* Discards frames that are too old. If no other node acknowledges the frames of an error passive
 * node, the frames stay in the controller and are discarded after STALE_TICKS. Until the controller
 * is empty, can_line_send() accepts more frames, and these frames are also lost. */
static void give_up_stale(can_line_t *line) {
  if (line->reported != CAN_BUS_PASSIVE || can_controller_is_empty(line)) {
    line->stalled_ticks = 0;
  } else if (line->stalled_ticks < STALE_TICKS) {
    line->stalled_ticks++;
  } else {
    can_line_give_up(line);
  }
}

static uint32_t patience_of(const can_line_t *line) {
  return PATIENCE_TICKS + PATIENCE_TICKS_KBIT_S / line->kbit_s;
}

uint8_t can_line_bus(can_line_t *line) {
  switch (line->state) {
    case CAN_LINE_RUNNING: {
      const uint8_t now = can_controller_bus(line);
      line->reported = (now == CAN_BUS_ACTIVE) ? CAN_BUS_ACTIVE : CAN_BUS_PASSIVE;
      if (now == CAN_BUS_OFF) {
        line->reported = CAN_BUS_OFF;
        (void)can_controller_abort(line);
        enter_initialisation(line);
      } else {
        give_up_stale(line);
      }
      break;
    }
    case CAN_LINE_ENTERING:
      if (can_controller_has_entered(line)) {
        can_controller_join(line);
        line->state = CAN_LINE_JOINING;
        line->waited_ticks = 0;
      } else {
        line->waited_ticks++;
      }
      break;
    case CAN_LINE_JOINING:
      if (can_controller_has_joined(line)) {
        line->state = CAN_LINE_RUNNING;
      } else {
        line->waited_ticks++;
      }
      break;
    default:
      break;
  }
  if (line->state != CAN_LINE_RUNNING && line->state != CAN_LINE_STOPPED &&
      line->waited_ticks >= patience_of(line)) {
    line->reported = CAN_BUS_OFF;
    enter_initialisation(line);
  }
  return line->reported;
}

void can_line_rate(can_line_t *line, uint16_t kbit_s) {
  if (line->state == CAN_LINE_STOPPED || kbit_s == line->kbit_s) {
    return;
  }
  line->kbit_s = kbit_s;
  (void)can_controller_abort(line);
  enter_initialisation(line);
}

uint16_t can_line_lost(can_line_t *line) {
  if (line->state == CAN_LINE_STOPPED) {
    return 0;
  }
  uint16_t lost = (uint16_t)(line->dropped - line->dropped_reported);
  line->dropped_reported = (uint16_t)(line->dropped_reported + lost);
  /* Only one lost frame is counted, because the controller does not report how many frames were
   * lost. */
  if (can_controller_lost(line)) {
    lost++;
  }
  return lost;
}

bool can_line_receive(can_line_t *line, can_frame_t *frame) {
  if (line->ring_out == line->ring_in) {
    return false;
  }
  BARRIER();
  *frame = line->ring[line->ring_out % CAN_LINE_RING];
  BARRIER();
  line->ring_out++;
  return true;
}

/* Reads one received frame from the controller. Returns false if the controller has no received
 * frame. */
static bool take_one(can_line_t *line) {
  const bool has_room = (uint8_t)(line->ring_in - line->ring_out) < CAN_LINE_RING;
  can_frame_t *frame = has_room ? &line->ring[line->ring_in % CAN_LINE_RING] : NULL;
  if (!can_controller_take(line, frame)) {
    return false;
  }
  if (has_room) {
    BARRIER();
    line->ring_in++;
  } else {
    line->dropped++;
  }
  return true;
}

void can_line_take(can_line_t *line) {
  while (take_one(line)) {
  }
}

bool can_line_send(can_line_t *line, const can_frame_t *frame) {
  if (line->state != CAN_LINE_RUNNING) {
    return false;
  }
  return can_controller_send(line, frame) || line->stalled_ticks >= STALE_TICKS;
}

uint8_t port_can_bus(void) { return can_line_bus(&bus); }

void port_can_rate(uint16_t kbit_s) { can_line_rate(&bus, kbit_s); }

uint16_t port_can_lost(void) { return can_line_lost(&bus); }

bool port_can_receive(can_frame_t *frame) { return can_line_receive(&bus, frame); }

bool port_can_transmit(const can_frame_t *frame) { return can_line_send(&bus, frame); }

void can_interrupt(void) {
  can_line_take(&bus);
  HANDLER_END();
}
