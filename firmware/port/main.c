/* The main program of every board; port.h declares the functions that the code for one board
 * implements. */

#include "firmware/port/port.h"

/* largest number of bytes in one transfer of the serial line. It limits the time for which the tick
 * interrupt is masked */
enum { SERIAL_CHUNK_BYTES = 32 };

static fw_t firmware;
/* true: a tick has run, and fw_between() has not run after it yet */
static volatile bool is_ticked;
static uint8_t bus = CAN_BUS_ACTIVE;

fw_t *port_firmware(void) { return &firmware; }

void port_tick(void) {
  /* port_sample() sets only the fields of inputs that its board has. Most boards have no report of
   * a drive and no ages of values. */
  axis_inputs_t inputs = {0};
  if (port_sample(&inputs)) {
    axis_outputs_t outputs;
    fw_prepare(&firmware);
    port_sense(&inputs);
    fw_control(&firmware, &inputs, &outputs);
    port_act(&outputs);
    if (fw_report(&firmware)) {
      port_feed_watchdog();
    }
    is_ticked = true;
  }
}

static void serial_in(void) {
  uint8_t bytes[SERIAL_CHUNK_BYTES];
  const uint16_t received = port_serial_receive(bytes, sizeof(bytes));
  if (received > 0) {
    fw_modbus_receive(&firmware, bytes, received);
  }
}

/* Passes the received bytes to Modbus before the last tick is completed. Otherwise Modbus would
 * count the time in which these bytes arrived as a silent interval. */
void port_settle(void) {
  if (is_ticked) {
    is_ticked = false;
    serial_in();
    fw_between(&firmware);
  }
}

/* Locks the tick interrupt, so that the main loop may use the firmware until port_unlock(). If
 * fw_between() has not run after the last tick yet, runs it first. */
static void acquire_firmware(void) {
  port_lock();
  port_settle();
}

static void poll_port(void) {
  acquire_firmware();
  port_can_rate(fw_can_kbit_s(&firmware));
  const uint8_t now = port_can_bus();
  if (now != bus) {
    bus = now;
    fw_can_bus(&firmware, now);
  }
  const uint16_t lost = port_can_lost();
  if (lost > 0) {
    fw_can_lost(&firmware, lost);
  }
  uint32_t missed;
  if (port_overran(&missed)) {
    fw_overrun(&firmware, missed);
  }
  port_unlock();
}

/* Passes each received frame separately to the firmware. The frame that takes longest needs 62 us,
 * which is the largest delay of a tick while the axis is enabled. The end of the download of a
 * cycle program takes longer, but it is accepted only while the axis is disabled (programs.h). */
static void can_in(void) {
  can_frame_t frame;
  for (uint8_t i = 0; i < PORT_CAN_AT_ONCE && port_can_receive(&frame); i++) {
    acquire_firmware();
    fw_can_receive(&firmware, &frame);
    port_unlock();
  }
}

static void can_out(void) {
  /* CAN frame that port_can_transmit() has refused; it is sent again later */
  static can_frame_t waiting;
  static bool is_waiting;
  /* Discards a waiting frame while the bus is off, because the frame would be too old when the bus
   * works again. */
  is_waiting = is_waiting && bus != CAN_BUS_OFF;
  for (uint8_t i = 0; i < PORT_CAN_AT_ONCE; i++) {
    if (!is_waiting) {
      acquire_firmware();
      is_waiting = fw_can_transmit(&firmware, &waiting);
      port_unlock();
    }
    if (!is_waiting || !port_can_transmit(&waiting)) {
      return;
    }
    is_waiting = false;
  }
}

/* Passes received bytes of the serial line to Modbus, and sends the bytes of the answer. */
static void serve_serial(void) {
  static uint8_t answer[SERIAL_CHUNK_BYTES];
  static uint16_t count;
  static uint16_t sent;
  acquire_firmware();
  serial_in();
  if (sent == count) {
    count = fw_modbus_transmit(&firmware, answer, sizeof(answer));
    sent = 0;
  }
  port_unlock();
  if (sent < count) {
    sent = (uint16_t)(sent + port_serial_transmit(&answer[sent], (uint16_t)(count - sent)));
  }
}

int main(void) {
  port_init();
  fw_init(&firmware, port_config());
  port_start();
  for (;;) {
    poll_port();
    can_in();
    can_out();
    serve_serial();
    port_idle();
  }
}
