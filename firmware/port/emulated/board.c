/* Functions of port.h that are the same on every emulated board without CAN and serial line. The
 * linker script of the board defines the sizes of the memories. */

#include "firmware/port/emulated/host_link.h"
#include "firmware/port/emulated/semihosting.h"
#include "firmware/port/identity.h"
#include "firmware/port/image.h"
#include "firmware/port/port.h"
#include "firmware/port/tick.h"

extern const identity_t identity;

static blackbox_t blackbox;
static fw_config_t config;

void port_init(void) { host_link_open(); }

const fw_config_t *port_config(void) {
  config.recorder_buffer = recorder_begin;
  config.recorder_bytes = image_bytes(recorder_begin, recorder_end);
  config.blackbox = &blackbox;
  config.hardware = identity.board;
  config.software = identity_software;
  config.node_id = 1;
  config.dac_bits = 12;
  config.buses = 1;
  config.program_memory = programs_begin;
  config.program_bytes = image_bytes(programs_begin, programs_end);
  config.result_memory = results_begin;
  config.result_bytes = image_bytes(results_begin, results_end);
  config.curve_memory = curve_begin;
  config.curve_bytes = image_bytes(curve_begin, curve_end);
  return &config;
}

void port_start(void) { tick_start(); }

_Noreturn void image_failed(void) { semihosting_fail(); }

/* Waits for the next tick. No instruction that waits for interrupts is used: QEMU, which counts
 * instructions, doubles the period of every timer in such an instruction. */
void port_idle(void) {
  static uint32_t seen;
  while (tick_entries() == seen) {
  }
  seen = tick_entries();
}

/* Returns false: no tick is late, because the time of the emulator stops while a tick waits for the
 * host. */
bool port_overran(uint32_t *missed) {
  *missed = 0;
  return false;
}

void port_feed_watchdog(void) {}

bool port_can_receive(can_frame_t *frame) {
  (void)frame;
  return false;
}

/* Discards the frame. On a bus without other nodes, a frame that nobody acknowledges would also be
 * discarded after some time. */
bool port_can_transmit(const can_frame_t *frame) {
  (void)frame;
  return true;
}

uint8_t port_can_bus(void) { return CAN_BUS_ACTIVE; }

uint16_t port_can_lost(void) { return 0; }

void port_can_rate(uint16_t kbit_s) { (void)kbit_s; }

uint16_t port_serial_receive(uint8_t *bytes, uint16_t room) {
  (void)bytes;
  (void)room;
  return 0;
}

uint16_t port_serial_transmit(const uint8_t *bytes, uint16_t count) {
  (void)bytes;
  return count;
}
