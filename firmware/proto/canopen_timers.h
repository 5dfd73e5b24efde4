#ifndef FIRMWARE_PROTO_CANOPEN_TIMERS_H_
#define FIRMWARE_PROTO_CANOPEN_TIMERS_H_

/* Timers of the node, in ticks. `next` is never later than the first of them, so a tick in which
 * none runs out costs one comparison. */

#include <stdbool.h>
#include <stdint.h>

enum {
  CANOPEN_HEARTBEATS = 4, /* consumers */
  CANOPEN_PDOS = 4,       /* of each direction */
  CANOPEN_SDOS = 3        /* servers */
};

enum {
  CANOPEN_TIMER_HEARTBEAT = 0, /* producer */
  CANOPEN_TIMER_EMCY = 1,      /* inhibit time */
  CANOPEN_TIMER_CONSUMER = 2,
  CANOPEN_TIMER_TPDO_EVENT = CANOPEN_TIMER_CONSUMER + CANOPEN_HEARTBEATS,
  CANOPEN_TIMER_TPDO_INHIBIT = CANOPEN_TIMER_TPDO_EVENT + CANOPEN_PDOS,
  CANOPEN_TIMER_RPDO = CANOPEN_TIMER_TPDO_INHIBIT + CANOPEN_PDOS,
  CANOPEN_TIMER_SDO = CANOPEN_TIMER_RPDO + CANOPEN_PDOS,
  CANOPEN_TIMERS = CANOPEN_TIMER_SDO + CANOPEN_SDOS
};

typedef struct {
  uint32_t now; /* number of the coming tick, of the present one while it runs; wraps */
  uint32_t next;
  uint32_t at[CANOPEN_TIMERS]; /* tick in which it runs out */
  uint8_t running[CANOPEN_TIMERS];
} canopen_timers_t;

void canopen_timers_init(canopen_timers_t *timers);

/* Runs out `ticks` (1..2^30) ticks after the coming or present one; 0 ticks stop the timer. */
void canopen_timer_start(canopen_timers_t *timers, uint8_t timer, uint32_t ticks);
void canopen_timer_stop(canopen_timers_t *timers, uint8_t timer);

/* A timer that has run out, and is stopped by this; CANOPEN_TIMERS: none. */
uint8_t canopen_timer_take(canopen_timers_t *timers);

#endif
