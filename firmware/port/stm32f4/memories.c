/* The regions of the flash that the program may change: for the parameters, for the incidents
 * and for the slots for images. */

#include <stddef.h>

#include "firmware/port/identity.h"
#include "firmware/port/stm32/board.h"

enum { MAY_PROGRAM = MPU_RASR_AP_WRITE | MPU_RASR_XN | MPU_RASR_C | MPU_RASR_ENABLE };

const fw_slots_t *board_slots(void) {
  static fw_slots_t slots;
  slots = (fw_slots_t){
      .memory = flash_slots(),
      .address = {BOARD_SLOT_A, BOARD_SLOT_B},
      .board = identity.board,
      .restart = board_restart,
      .running = ((uintptr_t)vectors_begin == BOARD_SLOT_A) ? 0 : 1,
  };
  return (slots.memory != NULL &&
          slots_trailer(vectors_begin, BOARD_SLOT_BYTES)->magic == SLOT_MAGIC)
             ? &slots
             : NULL;
}

/* Permits programming of some regions of the flash. Of the slots, only the slot whose image does
 * not run and the trailer of the running slot may be programmed. */
void protect_flash(uint32_t first) {
  const uint32_t running = (uintptr_t)vectors_begin;
  /* The sectors of the parameter store are eighths 2 to 5 of the first 64 KiB of the flash. */
  protect_region(first, 0x08000000, MAY_PROGRAM | MPU_RASR_SRD(0xC3) | MPU_RASR_SIZE(16));
  protect_region(first + 1, 0x08010000, MAY_PROGRAM | MPU_RASR_SIZE(16)); /* archive of incidents */
  protect_region(first + 2, 0x08060000, MAY_PROGRAM | MPU_RASR_SIZE(17));
  protect_region(first + 3, running ^ BOARD_SLOT_A ^ BOARD_SLOT_B, MAY_PROGRAM | MPU_RASR_SIZE(17));
  protect_region(first + 4, running + BOARD_SLOT_BYTES - SLOT_TRAILER_BYTES,
                 MAY_PROGRAM | MPU_RASR_SIZE(6));
}
