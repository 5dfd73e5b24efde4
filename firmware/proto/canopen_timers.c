#include "firmware/proto/canopen_timers.h"

#include "firmware/fx/fx.h"

/* Nothing is due for this long, then it is looked up again. */
#define FAR UINT32_C(0x40000000)

/* Ticks until a tick, negative if it has passed. */
static int32_t until(const canopen_timers_t *timers, uint32_t tick) {
  return fx_s32_from_u32(tick - timers->now);
}

void canopen_timers_init(canopen_timers_t *timers) {
  timers->now = 0;
  timers->next = FAR;
  for (uint8_t i = 0; i < CANOPEN_TIMERS; i++) {
    timers->at[i] = 0;
    timers->running[i] = 0;
  }
}

void canopen_timer_start(canopen_timers_t *timers, uint8_t timer, uint32_t ticks) {
  timers->running[timer] = (ticks != 0) ? 1 : 0;
  timers->at[timer] = timers->now + ticks;
  if (ticks != 0 && until(timers, timers->at[timer]) < until(timers, timers->next)) {
    timers->next = timers->at[timer];
  }
}

void canopen_timer_stop(canopen_timers_t *timers, uint8_t timer) { timers->running[timer] = 0; }

uint8_t canopen_timer_take(canopen_timers_t *timers) {
  if (until(timers, timers->next) > 0) {
    return CANOPEN_TIMERS;
  }
  uint32_t next = timers->now + FAR;
  for (uint8_t i = 0; i < CANOPEN_TIMERS; i++) {
    if (timers->running[i] == 0) {
      continue;
    }
    if (until(timers, timers->at[i]) <= 0) {
      timers->running[i] = 0;
      return i;
    }
    if (until(timers, timers->at[i]) < until(timers, next)) {
      next = timers->at[i];
    }
  }
  timers->next = next;
  return CANOPEN_TIMERS;
}
