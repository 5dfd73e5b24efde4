/* Code for a board without peripherals. Use it as a template for the code for a new board. The
 * sensors of this axis are not valid, so the amplifier is never enabled. This file compiles for any
 * target; serial.c contains the parts that depend on the chip. ../README.md gives the order in
 * which the functions are written. */

#include <stddef.h>

#include "firmware/port/identity.h"
#include "firmware/port/image.h"
#include "firmware/port/port.h"

static uint8_t recorder_buffer[FW_RECORDER_BYTES];

void port_init(void) {
  /* A real board needs these steps in this order: 1. Set the DAC to mid-scale, switch the amplifier
   * off and the brake on. 2. Start the clocks. 3. Start all other peripherals. */
}

const fw_config_t *port_config(void) {
  static const fw_config_t config = {
      .recorder_buffer = recorder_buffer,
      .recorder_bytes = sizeof(recorder_buffer),
      .memory = NULL, /* A real board uses two sectors of flash here (firmware/storage/store.h). */
      .hardware = "blank",
      .software = identity_software,
      .serial_number = 0,
      .modbus_baud = 0,
      .node_id = 1,
      .buses = 1,
      .dac_bits = 12,
  };
  return &config;
}

_Noreturn void image_failed(void) {
  /* A real board makes the outputs safe and resets the chip. */
  for (;;) {
  }
}

bool port_sample(axis_inputs_t *inputs) {
  *inputs = (axis_inputs_t){.sensor_valid = 0};
  return true;
}

void port_sense(axis_inputs_t *inputs) { (void)inputs; }

void port_act(const axis_outputs_t *outputs) { (void)outputs; }

bool port_can_receive(can_frame_t *frame) {
  (void)frame;
  return false;
}

bool port_can_transmit(const can_frame_t *frame) {
  (void)frame;
  return false;
}

uint8_t port_can_bus(void) { return CAN_BUS_ACTIVE; }

uint16_t port_can_lost(void) { return 0; }

void port_can_rate(uint16_t kbit_s) { (void)kbit_s; }

bool port_overran(uint32_t *missed) {
  /* A real board counts missed ticks with a clock that runs during an erase of the flash. */
  *missed = 0;
  return false;
}

void port_feed_watchdog(void) {}

void port_idle(void) {}
