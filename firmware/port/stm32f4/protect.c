/* Memory protection: an access to memory outside its purpose causes a fault. */

#include "firmware/port/stm32f4/board.h"

extern uint32_t stack_bottom[];

typedef struct {
  uint32_t base;
  uint32_t attributes;
} region_t;

/* A region with a higher number has priority; memory outside all regions is not protected. */
static const region_t regions[] = {
    /* Below the flash: this memory has no use, and null pointers point to it. */
    {0x00000000, MPU_RASR_AP_NONE | MPU_RASR_XN | MPU_RASR_SIZE(27) | MPU_RASR_ENABLE},
    /* The flash can be read and executed, */
    {0x08000000, MPU_RASR_AP_READ | MPU_RASR_C | MPU_RASR_SIZE(19) | MPU_RASR_ENABLE},
    /* except the parameters, eighths 2 to 5 of the first 64 KiB, which can be programmed, */
    {0x08000000, MPU_RASR_AP_WRITE | MPU_RASR_XN | MPU_RASR_C | MPU_RASR_SRD(0xC3) |
                     MPU_RASR_SIZE(16) | MPU_RASR_ENABLE},
    /* and except the archive of incidents. */
    {0x08040000,
     MPU_RASR_AP_WRITE | MPU_RASR_XN | MPU_RASR_C | MPU_RASR_SIZE(18) | MPU_RASR_ENABLE},
    /* The stack grows towards the bottom of the RAM. */
    {0x20000000, MPU_RASR_AP_NONE | MPU_RASR_XN | MPU_RASR_SIZE(5) | MPU_RASR_ENABLE},
};

void protect_start(void) {
  for (uint32_t i = 0; i < sizeof(regions) / sizeof(regions[0]); i++) {
    MPU->RNR = i;
    MPU->RBAR = regions[i].base;
    MPU->RASR = regions[i].attributes;
  }
  MPU->CTRL = MPU_CTRL_ENABLE | MPU_CTRL_PRIVDEFENA;
  __asm volatile("dsb\nisb" ::: "memory");
}
