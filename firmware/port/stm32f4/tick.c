#include "firmware/port/stm32f4/tick.h"

#include "firmware/port/port.h"
#include "firmware/port/stm32f4/board.h"

static volatile uint32_t entries;
static uint32_t period; /* length of a tick in counts of clock_count() */
static uint32_t due;    /* count at which the present tick was due, or a slightly smaller count */
static uint32_t missed;
static bool is_late;

void tick_start(void) {
  period = io_clock_is_right() ? TICK_CYCLES / 2 : TICK_CYCLES;
  SYSTICK->RVR = TICK_CYCLES - 1;
  SYSTICK->CVR = 0;
  SCB->SHPR3 = FIELD(24, 8, PRIORITY_TICK);
  due = clock_count();
  SYSTICK->CSR = SYSTICK_CSR_CLKSOURCE | SYSTICK_CSR_TICKINT | SYSTICK_CSR_ENABLE;
}

uint32_t tick_entries(void) { return entries; }

/* Adds the ticks that did not run to `missed`. A delayed interrupt occurs only once, even if
 * several ticks have passed. */
static void count_missed(void) {
  due += period;
  const uint32_t behind = clock_count() - due;
  if (behind >= period && behind <= INT32_MAX) {
    const uint32_t ticks = behind / period;
    missed += ticks;
    due += ticks * period;
  }
}

/* Runs a tick. Reading CSR clears the flag: if the flag is set again at the end of the tick, the
 * next tick is late. */
void tick_interrupt(void) {
  entries++;
  (void)SYSTICK->CSR;
  count_missed();
  port_tick();
  if ((SYSTICK->CSR & SYSTICK_CSR_COUNTFLAG) != 0) {
    is_late = true;
  }
}

bool port_overran(uint32_t *ticks) {
  const bool result = is_late || missed != 0;
  *ticks = missed;
  missed = 0;
  is_late = false;
  return result;
}

void port_lock(void) { __asm volatile("msr basepri, %0" ::"r"(PRIORITY_TICK) : "memory"); }

void port_unlock(void) { __asm volatile("msr basepri, %0" ::"r"(0) : "memory"); }
