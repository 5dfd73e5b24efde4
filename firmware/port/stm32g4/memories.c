/* What of the flash the program may change: bank 2 with parameters and incidents. There are no
 * slots for images. */

#include <stddef.h>

#include "firmware/port/stm32/board.h"

const fw_slots_t *board_slots(void) { return NULL; }

void protect_flash(uint32_t first) {
  protect_region(
      first, 0x08040000,
      MPU_RASR_AP_WRITE | MPU_RASR_XN | MPU_RASR_C | MPU_RASR_SIZE(18) | MPU_RASR_ENABLE);
}
