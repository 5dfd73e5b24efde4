/* The program of every board; port.h is what a board is. */

#include "firmware/port/port.h"

enum { SERIAL_CHUNK_BYTES = 32 }; /* bounds how long the tick is kept away */

static fw_t firmware;
static can_frame_t waiting; /* a frame that the port had no room for */
static bool is_waiting;
static uint8_t bus = CAN_BUS_ACTIVE;

fw_t *port_firmware(void) { return &firmware; }

static void can_in(void) {
  const uint8_t now = port_can_bus();
  if (now != bus) {
    bus = now;
    fw_can_bus(&firmware, now);
    /* What was to be sent before the bus failed is out of date when it is back. */
    is_waiting = is_waiting && now != CAN_BUS_OFF;
  }
  can_frame_t frame;
  for (uint8_t i = 0; i < PORT_CAN_PER_TICK && port_can_receive(&frame); i++) {
    fw_can_receive(&firmware, &frame);
  }
  const uint16_t lost = port_can_lost();
  if (lost > 0) {
    fw_can_lost(&firmware, lost);
  }
}

static void can_out(void) {
  for (uint8_t i = 0; i < PORT_CAN_PER_TICK; i++) {
    is_waiting = is_waiting || fw_can_transmit(&firmware, &waiting);
    if (!is_waiting || !port_can_transmit(&waiting)) {
      return;
    }
    is_waiting = false;
  }
}

void port_tick(void) {
  axis_inputs_t inputs;
  if (port_sense(&inputs)) {
    can_in();
    if (port_overran()) {
      fw_overrun(&firmware);
    }
    axis_outputs_t outputs;
    fw_tick(&firmware, &inputs, &outputs);
    port_act(&outputs);
    can_out();
  }
  port_feed_watchdog();
}

/* Bytes of the serial line, and the answer to them. */
static void serve_serial(void) {
  static uint8_t answer[SERIAL_CHUNK_BYTES];
  static uint16_t count;
  static uint16_t sent;
  uint8_t bytes[SERIAL_CHUNK_BYTES];
  const uint16_t received = port_serial_receive(bytes, sizeof(bytes));
  port_lock();
  if (received > 0) {
    fw_modbus_receive(&firmware, bytes, received);
  }
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
    serve_serial();
    port_idle();
  }
}
