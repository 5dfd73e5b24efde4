#include "firmware/port/stm32/tick.h"

#include "firmware/fx/fx.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32/barrier.h"
#include "firmware/port/stm32/board.h"

/* Duration in us of one count of clock_count(), in Q16: 1/84 us, or 1/16 us if the core runs at 16
 * MHz. */
enum { US_Q16 = 781, US_INTERNAL_Q16 = 4096 };

static volatile uint32_t entries;
static int32_t us_q16;
/* duration of the longest tick, in counts of clock_count(); `latest`: greatest delay of the begin
 * of a tick, in the same unit */
static uint32_t longest;
static uint32_t latest;
/* count of clock_count() at which the present tick was due; it may be slightly too small */
static uint32_t due;
static uint32_t missed;
static bool is_late;

void tick_start(void) {
  us_q16 = io_clock_is_right() ? US_Q16 : US_INTERNAL_Q16;
  due = clock_count();
  tick_timer_start();
}

uint32_t tick_entries(void) { return entries; }

/* Adds the ticks that did not run to `missed`. If the interrupt is delayed, it occurs only once,
 * even if several ticks have passed. */
static void count_missed(uint32_t now) {
  due += TICK_COUNTS;
  const uint32_t behind = now - due;
  if (behind >= TICK_COUNTS && behind <= INT32_MAX) {
    const uint32_t ticks = behind / TICK_COUNTS;
    missed += ticks;
    due += ticks * TICK_COUNTS;
  }
}

/* Converts a time of at most one tick from counts of clock_count() to us. */
static uint16_t us_of(uint32_t counts) {
  const uint32_t most = (counts < TICK_COUNTS) ? counts : TICK_COUNTS;
  return (uint16_t)fx_round_q16((int32_t)most * us_q16);
}

/* Computes a tick. If the timer is due again at the end of this tick, the next tick is late. */
void tick_interrupt(void) {
  entries++;
  tick_timer_take();
  const uint32_t begin = clock_count();
  count_missed(begin);
  latest = (begin - due > latest) ? begin - due : latest;
  port_tick();
  const uint32_t length = clock_count() - begin;
  longest = (length > longest) ? length : longest;
  if (tick_timer_is_due()) {
    is_late = true;
  }
  HANDLER_END();
}

bool port_overran(uint32_t *ticks) {
  fw_tick_times(port_firmware(), us_of(longest), us_of(latest));
  const bool result = is_late || missed != 0;
  *ticks = missed;
  missed = 0;
  is_late = false;
  return result;
}

void port_lock(void) { __asm volatile("msr basepri, %0" ::"r"(PRIORITY_TICK) : "memory"); }

void port_unlock(void) { __asm volatile("msr basepri, %0" ::"r"(0) : "memory"); }
