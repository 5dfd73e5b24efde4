/* Memory protection: only the intended kinds of access are permitted in the protected regions of
 * the memory. Any other access to these regions causes a fault of the core. */

#include "firmware/port/stm32/board.h"

typedef struct {
  uint32_t base;
  uint32_t attributes;
} region_t;

/* Protected regions of the memory. If regions overlap, the region with the higher number has
 * priority. Memory outside all regions is not protected. */
static const region_t regions[] = {
    /* Memory below the flash: no access is permitted, because the memory has no use and null
     * pointers point to it. */
    {0x00000000, MPU_RASR_AP_NONE | MPU_RASR_XN | MPU_RASR_SIZE(27) | MPU_RASR_ENABLE},
    /* Flash: only reading and executing are permitted. */
    {0x08000000, MPU_RASR_AP_READ | MPU_RASR_C | MPU_RASR_SIZE(19) | MPU_RASR_ENABLE},
    /* Bottom of the RAM: no access is permitted, because a stack that is too large grows into this
     * region. */
    {0x20000000, MPU_RASR_AP_NONE | MPU_RASR_XN | MPU_RASR_SIZE(5) | MPU_RASR_ENABLE},
};

enum { REGIONS = sizeof(regions) / sizeof(regions[0]) };

void protect_region(uint32_t number, uint32_t base, uint32_t attributes) {
  MPU->RNR = number;
  MPU->RBAR = base;
  MPU->RASR = attributes;
}

void protect_start(void) {
  for (uint32_t i = 0; i < REGIONS; i++) {
    protect_region(i, regions[i].base, regions[i].attributes);
  }
  protect_flash(REGIONS);
  MPU->CTRL = MPU_CTRL_ENABLE | MPU_CTRL_PRIVDEFENA;
  __asm volatile("dsb\nisb" ::: "memory");
}
