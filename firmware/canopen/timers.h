#ifndef FIRMWARE_CANOPEN_TIMERS_H_
#define FIRMWARE_CANOPEN_TIMERS_H_

/* Timers of the node, in ticks; pdo.h has the timers of TPDOs. The list of timers has
 * CANOPEN_TIMER_SLOTS slots, and a tick checks only the timers in its slot (tick modulo
 * CANOPEN_TIMER_SLOTS). If the slot of a tick is empty, the check costs one comparison. A timer is
 * in the slot of the tick in which it expires, or in the slot of an earlier tick. Most timers are
 * restarted before they expire: a restarted timer stays in its slot, and moves to a later slot when
 * its slot is checked. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

enum {
  CANOPEN_HEARTBEATS = 4, /* number of heartbeat consumers */
  CANOPEN_PDOS = 4,       /* number of RPDOs, and also number of TPDOs */
  CANOPEN_SDOS = 3        /* number of SDO servers */
};

enum {
  CANOPEN_TIMER_HEARTBEAT = 0, /* timer of the heartbeat producer */
  CANOPEN_TIMER_EMCY = 1,      /* timer of the inhibit time of emergency messages */
  CANOPEN_TIMER_CONSUMER = 2,
  CANOPEN_TIMER_RPDO = CANOPEN_TIMER_CONSUMER + CANOPEN_HEARTBEATS,
  CANOPEN_TIMER_SDO = CANOPEN_TIMER_RPDO + CANOPEN_PDOS,
  CANOPEN_TIMERS = CANOPEN_TIMER_SDO + CANOPEN_SDOS
};

enum { CANOPEN_TIMER_SLOTS = 32 };

/* All timers of a node. A set of timers is a word with one bit for each timer. */
typedef struct {
  /* number of the present tick while a tick is computed, otherwise number of the next tick; the
   * number wraps at 2^32 */
  uint32_t now;
  uint32_t running; /* set of the running timers */
  /* set of the timers in each slot of the timer list. Each running timer is in a slot, and a
   * stopped timer may still be in one */
  uint32_t slots[CANOPEN_TIMER_SLOTS];
  uint32_t at[CANOPEN_TIMERS]; /* number of the tick in which each timer expires */
} canopen_timers_t;

void canopen_timers_init(canopen_timers_t *timers);

static inline bool canopen_timer_runs(const canopen_timers_t *timers, uint32_t timer) {
  return (timers->running & fx_bit(timer)) != 0;
}

/* Returns the slot of the timer list that is checked in the tick `tick`. */
static inline uint32_t *canopen_timer_slot(canopen_timers_t *timers, uint32_t tick) {
  return &timers->slots[tick & (CANOPEN_TIMER_SLOTS - 1)];
}

static inline void canopen_timer_stop(canopen_timers_t *timers, uint32_t timer) {
  timers->running &= ~fx_bit(timer);
}

/* Starts a timer that expires `ticks` (1..2^30) ticks after the tick `timers->now`. If `ticks` is
 * 0, the timer is stopped. */
static inline void canopen_timer_start(canopen_timers_t *timers, uint32_t timer, uint32_t ticks) {
  fx_assert(timer < CANOPEN_TIMERS && ticks <= UINT32_C(1073741824));
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

/* Returns the set of timers that expire in this tick. A timer in this set that is started or
 * stopped before canopen_timer_take() does not expire. Call this function once in each tick,
 * because the timers of a skipped slot would never be checked. */
uint32_t canopen_timers_due(canopen_timers_t *timers);

/* Accounts for `ticks` ticks that did not run. Timers for sending that were due in these ticks
 * expire in the next tick. Timers for receiving (CANOPEN_TIMER_CONSUMER and above) expire `ticks`
 * ticks later. */
void canopen_timers_missed(canopen_timers_t *timers, uint32_t ticks);

/* `ticks` ticks did not run, beginning with the tick `now`. If the time `at` of a timer is after
 * these missed ticks, returns `at`. Otherwise returns the first tick after the missed ticks. */
static inline uint32_t canopen_timer_caught_up(uint32_t at, uint32_t now, uint32_t ticks) {
  return (at - now < ticks) ? now + ticks : at;
}

/* Stops a timer that expires in the present tick. Returns false if the timer was restarted or
 * stopped meanwhile and does not expire. */
static inline bool canopen_timer_take(canopen_timers_t *timers, uint32_t timer) {
  const bool due = canopen_timer_runs(timers, timer) && timers->at[timer] == timers->now;
  if (due) {
    canopen_timer_stop(timers, timer);
  }
  return due;
}

#endif
