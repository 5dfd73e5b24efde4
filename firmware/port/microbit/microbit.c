/* The tick of the micro:bit. Its nRF51822 has no SysTick, so the tick is a compare event of TIMER0.
 * Registers: nRF51 Series Reference Manual 3.0, TIMER. */

#include "firmware/port/port.h"
#include "firmware/port/tick.h"

typedef volatile uint32_t reg_t;

typedef struct {
  reg_t TASKS_START;
  reg_t reserved_1[15];
  reg_t TASKS_CAPTURE[4];
  reg_t reserved_2[60];
  reg_t EVENTS_COMPARE[4];
  reg_t reserved_3[109];
  reg_t INTENSET;
  reg_t reserved_4[127];
  reg_t MODE;
  reg_t BITMODE;
  reg_t reserved_5;
  reg_t PRESCALER;
  reg_t reserved_6[11];
  reg_t CC[4];
} nrf_timer_t;
_Static_assert(sizeof(nrf_timer_t) == 0x550, "CC[3] is at 54Ch");

#define TIMER0 ((nrf_timer_t *)0x40008000)
#define NVIC_ISER (*(reg_t *)0xE000E100)

enum { TIMER0_IRQ = 8 };
enum { MODE_TIMER = 0, BITMODE_32_BITS = 3, INTENSET_COMPARE0 = 1 << 16 };

#define TIMER_HZ UINT32_C(16000000)
enum { COUNTS_AHEAD = 16 };

static volatile uint32_t entries;
/* fraction of a count, in 1/1500 count, that is carried over to the next tick */
static uint32_t fraction;

/* Sets the compare value of the next tick. The value is at least 1 us ahead of the counter, because
 * the counter would reach a passed value only after 268 s. Ticks that were due before this value
 * are missed. */
static void set_next(void) {
  do {
    TIMER0->CC[0] += tick_counts(TIMER_HZ, &fraction);
    TIMER0->TASKS_CAPTURE[1] = 1;
  } while ((int32_t)(TIMER0->CC[0] - TIMER0->CC[1]) < COUNTS_AHEAD);
}

void tick_start(void) {
  TIMER0->MODE = MODE_TIMER;
  TIMER0->BITMODE = BITMODE_32_BITS;
  TIMER0->PRESCALER = 0;
  TIMER0->CC[0] = 0;
  set_next();
  TIMER0->INTENSET = INTENSET_COMPARE0;
  NVIC_ISER = 1u << TIMER0_IRQ;
  TIMER0->TASKS_START = 1;
}

void tick_interrupt(void) {
  entries++;
  /* The compare value is set before the event is cleared. If the event were cleared while the
   * counter still equals the compare value, QEMU would set the event again. The chip accepts either
   * order. */
  set_next();
  TIMER0->EVENTS_COMPARE[0] = 0;
  port_tick();
}

uint32_t tick_entries(void) { return entries; }

__attribute__((section(".vectors.interrupts"), used)) static void (*const interrupts[])(void) = {
    [TIMER0_IRQ] = tick_interrupt,
};
