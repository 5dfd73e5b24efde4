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
  timers->looked_at = 0;
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
  if (timers->looked_at == 0) {
    if (until(timers, timers->next) > 0) {
      return CANOPEN_TIMERS;
    }
    timers->next = timers->now + FAR; /* and earlier, as they are found or started meanwhile */
  }
  uint32_t next = timers->next;
  int32_t least = until(timers, next);
  for (uint32_t i = timers->looked_at; i < CANOPEN_TIMERS; i++) {
    if (timers->running[i] == 0) {
      continue;
    }
    const int32_t left = until(timers, timers->at[i]);
    if (left <= 0) {
      timers->running[i] = 0;
      timers->looked_at = (uint8_t)(i + 1);
      timers->next = next;
      return (uint8_t)i;
    }
    if (left < least) {
      least = left;
      next = timers->at[i];
    }
  }
  timers->next = next;
  timers->looked_at = 0;
  return CANOPEN_TIMERS;
}
