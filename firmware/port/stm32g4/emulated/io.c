/* This chip in an emulator of another STM32 with the same processor and the same memories: buses
 * are missing, and ../../stm32/emulated.c replaces the other peripherals. */

#include <stddef.h>

#include "firmware/port/emulated/host_link.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/tick.h"

const store_memory_t *flash_memory(void) { return NULL; }

const store_memory_t *flash_archive(void) { return NULL; }

void flash_nmi(void) { board_fail(); }

void serial_init(uint32_t clock_hz) { (void)clock_hz; }

void serial_interrupt(void) {} /* never enabled */

uint16_t port_serial_receive(uint8_t *bytes, uint16_t room) {
  (void)bytes;
  (void)room;
  return 0;
}

uint16_t port_serial_transmit(const uint8_t *bytes, uint16_t count) {
  (void)bytes;
  return count;
}

bool port_can_receive(can_frame_t *frame) {
  (void)frame;
  return false;
}

/* Discards the frame, as a bus without other nodes would not keep it for ever. */
bool port_can_transmit(const can_frame_t *frame) {
  (void)frame;
  return true;
}

/* Waits for the next tick without wfi, because in wfi QEMU, which counts instructions, doubles the
 * period of every timer. */
void port_idle(void) {
  static uint32_t seen;
  while (host_link_is_open() && tick_entries() == seen) {
  }
  seen = tick_entries();
}
