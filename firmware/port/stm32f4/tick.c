#include "firmware/port/stm32f4/tick.h"

#include "firmware/port/port.h"
#include "firmware/port/stm32f4/board.h"

static volatile uint32_t entries;
static bool overran;

void tick_start(void) {
  SYSTICK->RVR = TICK_CYCLES - 1;
  SYSTICK->CVR = 0;
  SCB->SHPR3 = FIELD(24, 8, PRIORITY_TICK);
  SYSTICK->CSR = SYSTICK_CSR_CLKSOURCE | SYSTICK_CSR_TICKINT | SYSTICK_CSR_ENABLE;
}

uint32_t tick_entries(void) { return entries; }

/* Reading the flag clears it: set again at the end, the time of the next tick came and went. */
void tick_interrupt(void) {
  entries++;
  (void)SYSTICK->CSR;
  port_tick();
  overran = overran || (SYSTICK->CSR & SYSTICK_CSR_COUNTFLAG) != 0;
}

bool port_overran(void) {
  const bool result = overran;
  overran = false;
  return result;
}

void port_lock(void) { __asm volatile("msr basepri, %0" ::"r"(PRIORITY_TICK) : "memory"); }

void port_unlock(void) { __asm volatile("msr basepri, %0" ::"r"(0) : "memory"); }
