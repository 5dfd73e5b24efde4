/* Memory protection: an access to memory outside its purpose causes a fault. */

#include "firmware/port/image.h"
#include "firmware/port/stm32f4/board.h"

typedef struct {
  uint32_t base;
  uint32_t attributes;
} region_t;

/* Protected regions of the memory. If regions overlap, the region with the higher number has
 * priority. Memory outside all regions is not protected. */
static const region_t regions[] = {
    /* Memory below the flash: no access, because it has no use and null pointers point to it. */
    {0x00000000, MPU_RASR_AP_NONE | MPU_RASR_XN | MPU_RASR_SIZE(27) | MPU_RASR_ENABLE},
    /* Flash: reading and executing only. */
    {0x08000000, MPU_RASR_AP_READ | MPU_RASR_C | MPU_RASR_SIZE(19) | MPU_RASR_ENABLE},
    /* Parameter store in the flash: reading and programming. It is eighths 2 to 5 of the first 64
     * KiB. */
    {0x08000000, MPU_RASR_AP_WRITE | MPU_RASR_XN | MPU_RASR_C | MPU_RASR_SRD(0xC3) |
                     MPU_RASR_SIZE(16) | MPU_RASR_ENABLE},
    /* Archive of incidents in the flash: reading and programming. */
    {0x08010000,
     MPU_RASR_AP_WRITE | MPU_RASR_XN | MPU_RASR_C | MPU_RASR_SIZE(16) | MPU_RASR_ENABLE},
    {0x08060000,
     MPU_RASR_AP_WRITE | MPU_RASR_XN | MPU_RASR_C | MPU_RASR_SIZE(17) | MPU_RASR_ENABLE},
    /* Bottom of the RAM: no access, because a stack that is too large grows into this region. */
    {0x20000000, MPU_RASR_AP_NONE | MPU_RASR_XN | MPU_RASR_SIZE(5) | MPU_RASR_ENABLE},
};

enum { REGIONS = sizeof(regions) / sizeof(regions[0]) };

static void set_region(uint32_t number, uint32_t base, uint32_t attributes) {
  MPU->RNR = number;
  MPU->RBAR = base;
  MPU->RASR = attributes;
}

/* The slot that does not run and the trailer of the running slot may be programmed. */
void protect_start(void) {
  const uint32_t running = (uintptr_t)vectors_begin;
  for (uint32_t i = 0; i < REGIONS; i++) {
    set_region(i, regions[i].base, regions[i].attributes);
  }
  set_region(REGIONS, running ^ BOARD_SLOT_A ^ BOARD_SLOT_B,
             MPU_RASR_AP_WRITE | MPU_RASR_XN | MPU_RASR_C | MPU_RASR_SIZE(17) | MPU_RASR_ENABLE);
  set_region(REGIONS + 1, running + BOARD_SLOT_BYTES - SLOT_TRAILER_BYTES,
             MPU_RASR_AP_WRITE | MPU_RASR_XN | MPU_RASR_C | MPU_RASR_SIZE(6) | MPU_RASR_ENABLE);
  MPU->CTRL = MPU_CTRL_ENABLE | MPU_CTRL_PRIVDEFENA;
  __asm volatile("dsb\nisb" ::: "memory");
}
