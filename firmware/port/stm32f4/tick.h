#ifndef FIRMWARE_PORT_STM32F4_TICK_H_
#define FIRMWARE_PORT_STM32F4_TICK_H_

#include "firmware/port/tick.h"

/* Number of processor cycles in a tick: exactly 168 MHz / 1500 Hz. */
#define TICK_CYCLES UINT32_C(112000)

#endif
