#include "firmware/canopen/timers.h"

#include "firmware/fx/bytes.h"

void canopen_timers_init(canopen_timers_t *timers) {
  timers->now = 0;
  timers->running = 0;
  for (uint8_t i = 0; i < CANOPEN_TIMERS; i++) {
    timers->at[i] = 0;
  }
  for (uint8_t i = 0; i < CANOPEN_TIMER_SLOTS; i++) {
    timers->slots[i] = 0;
  }
}

/* Asserts that every running timer of the node is in a slot of the timer list. */
static inline void assert_timers(const canopen_timers_t *timers) {
  uint32_t listed = 0;
  for (uint8_t i = 0; i < CANOPEN_TIMER_SLOTS; i++) {
    listed |= timers->slots[i];
  }
  fx_assert((timers->running & ~listed) == 0);
}

uint32_t canopen_timers_due(canopen_timers_t *timers) {
  assert_timers(timers);
  uint32_t *slot = canopen_timer_slot(timers, timers->now);
  uint32_t remaining = *slot & timers->running;
  uint32_t due = 0;
  *slot = 0;
  while (remaining != 0) {
    const uint8_t timer = fx_lowest_bit(remaining);
    const uint32_t bit = remaining & ((uint32_t)0 - remaining);
    const uint32_t at = timers->at[timer];
    remaining -= bit;
    if (at == timers->now) {
      due |= bit;
    } else {
      /* The timer does not expire yet, so it stays in the timer list: in this slot, if the
       * remaining time is a multiple of the number of slots. */
      *canopen_timer_slot(timers, at) |= bit;
    }
  }
  return due;
}

void canopen_timers_missed(canopen_timers_t *timers, uint32_t ticks) {
  for (uint8_t i = 0; i < CANOPEN_TIMER_SLOTS; i++) {
    timers->slots[i] = 0;
  }
  for (uint32_t running = timers->running; running != 0; running &= running - 1) {
    const uint8_t timer = fx_lowest_bit(running);
    uint32_t *at = &timers->at[timer];
    *at = (timer >= CANOPEN_TIMER_CONSUMER) ? *at + ticks
                                            : canopen_timer_caught_up(*at, timers->now, ticks);
    *canopen_timer_slot(timers, *at) |= fx_bit(timer);
  }
  timers->now += ticks;
}
