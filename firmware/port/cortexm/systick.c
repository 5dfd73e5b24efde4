/* The tick of a board whose timer is SysTick, the timer in the core of most Cortex-M. The linker
 * script of the board defines core_hz, the clock frequency of the core in Hz. */

#include "firmware/port/port.h"
#include "firmware/port/tick.h"

typedef volatile uint32_t reg_t;

typedef struct {
  reg_t CSR;
  reg_t RVR;
  reg_t CVR;
} systick_t;
#define SYSTICK ((systick_t *)0xE000E010)
enum { SYSTICK_CLOCKED_BY_CORE_WITH_INTERRUPT = 7 };

/* The address of this symbol is the clock frequency of the core in Hz. */
extern const uint8_t core_hz[];

static volatile uint32_t entries;
/* fraction of a count, in 1/1500 count, that is carried over to the next tick */
static uint32_t fraction;

/* Sets the length of the next tick. A new reload value of SysTick acts from the next reload on
 * (ARMv7-M Architecture Reference Manual, B3.3). */
static void set_next(void) {
  SYSTICK->RVR = tick_counts((uint32_t)(uintptr_t)core_hz, &fraction) - 1;
}

void tick_start(void) {
  set_next();
  SYSTICK->CVR = 0;
  SYSTICK->CSR = SYSTICK_CLOCKED_BY_CORE_WITH_INTERRUPT;
}

void tick_interrupt(void) {
  entries++;
  set_next();
  port_tick();
}

uint32_t tick_entries(void) { return entries; }
