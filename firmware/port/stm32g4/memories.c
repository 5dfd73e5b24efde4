/* Start-up of the RAM, and the region of the flash that the program may change: bank 2 with
 * parameters and incidents. This board has no slots for images. */

#include <stddef.h>

#include "firmware/port/stm32/board.h"

/* The reset handler. After a reset, the first write to each of the four RAM areas may be lost
 * (ES0430 2.2.7). A push is also such a write. So one word of each area is read first. This does
 * not change an incident that the RAM has kept. */
__attribute__((naked)) void touch_memories(void) {
  __asm volatile(
      "mov r0, #0x20000000\n"
      "ldr r1, [r0]\n"
      "add r0, #0x8000\n"
      "ldr r1, [r0]\n"
      "add r0, #0x8000\n"
      "ldr r1, [r0]\n"
      "add r0, #0x4000\n"
      "ldr r1, [r0]\n"
      "b reset\n");
}

const fw_slots_t *board_slots(void) { return NULL; }

void protect_flash(uint32_t first) {
  protect_region(
      first, 0x08040000,
      MPU_RASR_AP_WRITE | MPU_RASR_XN | MPU_RASR_C | MPU_RASR_SIZE(18) | MPU_RASR_ENABLE);
}
