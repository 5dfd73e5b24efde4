#ifndef FIRMWARE_CANOPEN_TIMERS_H_
#define FIRMWARE_CANOPEN_TIMERS_H_

/* Timers of the node, in ticks; those of the TPDOs are in pdo.h. Each is kept in the slot of a
 * tick, modulo CANOPEN_TIMER_SLOTS, not after the one in which it runs out, so a tick checks
 * those of its slot only; none of them costs one comparison. One that is started again before it
 * ran out, as most are, stays in its slot and moves on when that is checked. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

enum {
  CANOPEN_HEARTBEATS = 4, /* consumers */
  CANOPEN_PDOS = 4,       /* of each direction */
  CANOPEN_SDOS = 3        /* servers */
};

enum {
  CANOPEN_TIMER_HEARTBEAT = 0, /* producer */
  CANOPEN_TIMER_EMCY = 1,      /* inhibit time */
  CANOPEN_TIMER_CONSUMER = 2,
  CANOPEN_TIMER_RPDO = CANOPEN_TIMER_CONSUMER + CANOPEN_HEARTBEATS,
  CANOPEN_TIMER_SDO = CANOPEN_TIMER_RPDO + CANOPEN_PDOS,
  CANOPEN_TIMERS = CANOPEN_TIMER_SDO + CANOPEN_SDOS
};

enum { CANOPEN_TIMER_SLOTS = 32 };

/* Sets of timers have one bit each. */
typedef struct {
  uint32_t now;                        /* number of the coming tick, of the present one while it
                                          runs; wraps */
  uint32_t running;                    /* set */
  uint32_t slots[CANOPEN_TIMER_SLOTS]; /* sets, of all that run and some that were stopped */
  uint32_t at[CANOPEN_TIMERS];         /* tick in which it runs out */
} canopen_timers_t;

void canopen_timers_init(canopen_timers_t *timers);

static inline bool canopen_timer_runs(const canopen_timers_t *timers, uint32_t timer) {
  return (timers->running & fx_bit(timer)) != 0;
}

/* Where those of a tick are. */
static inline uint32_t *canopen_timer_slot(canopen_timers_t *timers, uint32_t tick) {
  return &timers->slots[tick & (CANOPEN_TIMER_SLOTS - 1)];
}

static inline void canopen_timer_stop(canopen_timers_t *timers, uint32_t timer) {
  timers->running &= ~fx_bit(timer);
}

/* Runs out `ticks` (1..2^30) ticks after the coming or present one; 0 ticks stop the timer. */
static inline void canopen_timer_start(canopen_timers_t *timers, uint32_t timer, uint32_t ticks) {
  const uint32_t at = timers->now + ticks;
  if (ticks == 0) {
    canopen_timer_stop(timers, timer);
    return;
  }
  if (!canopen_timer_runs(timers, timer) || fx_s32_from_u32(at - timers->at[timer]) < 0) {
    *canopen_timer_slot(timers, at) |= fx_bit(timer);
    timers->running |= fx_bit(timer);
  }
  timers->at[timer] = at;
}

/* The timers that run out in this tick, unless they are started or stopped before they are taken.
 * To be called once in each tick: a slot that was skipped would never be checked. */
uint32_t canopen_timers_due(canopen_timers_t *timers);

/* Accounts for `ticks` ticks that did not run: timers of transmission run out in the coming tick if
 * they were due meanwhile, those of reception (CONSUMER and up) that much later. */
void canopen_timers_missed(canopen_timers_t *timers, uint32_t ticks);

/* A time to come, or the present one if it passes within `ticks` ticks that were missed. */
static inline uint32_t canopen_timer_caught_up(uint32_t at, uint32_t now, uint32_t ticks) {
  return (at - now < ticks) ? now + ticks : at;
}

/* Whether one of them still runs out; if so, it is stopped by this. */
static inline bool canopen_timer_take(canopen_timers_t *timers, uint32_t timer) {
  const bool due = canopen_timer_runs(timers, timer) && timers->at[timer] == timers->now;
  if (due) {
    canopen_timer_stop(timers, timer);
  }
  return due;
}

#endif
