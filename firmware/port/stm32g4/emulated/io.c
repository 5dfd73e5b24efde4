/* Functions for this chip in an emulator of another STM32, which has the same processor and the
 * same memories. The emulated board has no CAN and no serial line. ../../stm32/emulated.c replaces
 * the other peripherals. */

#include <stddef.h>

#include "firmware/port/emulated/host_link.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/tick.h"

const store_memory_t *flash_memory(void) { return NULL; }

const store_memory_t *flash_archive(void) { return NULL; }

void flash_nmi(void) { board_fail(); }

void serial_init(uint32_t clock_hz) { (void)clock_hz; }

void serial_interrupt(void) {} /* Does nothing, because this interrupt is never enabled. */

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

/* Discards the frame. On a bus without other nodes, a frame that nobody acknowledges would also be
 * discarded after some time. */
bool port_can_transmit(const can_frame_t *frame) {
  (void)frame;
  return true;
}

/* Waits for the next tick. The instruction wfi is not used: QEMU, which counts instructions,
 * doubles the period of every timer in wfi. */
void port_idle(void) {
  static uint32_t seen;
  while (host_link_is_open() && tick_entries() == seen) {
  }
  seen = tick_entries();
}
