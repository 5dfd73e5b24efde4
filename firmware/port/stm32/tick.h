#ifndef FIRMWARE_PORT_STM32_TICK_H_
#define FIRMWARE_PORT_STM32_TICK_H_

#include <stdbool.h>

#include "firmware/port/tick.h"

/* Number of counts of clock_count() in a tick. It is exactly 84 MHz / 1500 Hz. */
#define TICK_COUNTS UINT32_C(56000)

/* The timer of the tick (tick_timer.c). tick_timer_start() starts the timer. The interrupt of the
 * timer calls tick_timer_take() first, which clears the request of this tick. After that,
 * tick_timer_is_due() returns true if the next tick is already due. */
void tick_timer_start(void);
void tick_timer_take(void);
bool tick_timer_is_due(void);

#endif
