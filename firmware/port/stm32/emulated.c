/* Replaces the peripherals that an emulator of another STM32 does not have: clocks, flash, encoder,
 * ADC, DAC, pins, watchdog. The inputs and outputs are in the records of
 * ../emulated/host_link.c. */

#include <stddef.h>

#include "firmware/port/emulated/host_link.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/tick.h"

void io_init(void) { host_link_open(); }

void io_start(void) {} /* the emulated board has no drive on a bus and no converter */

bool io_clock_is_right(void) { return true; }

/* Returns a count that contains no missed ticks, because the emulator never misses a tick. */
uint32_t clock_count(void) { return tick_entries() * TICK_COUNTS; }

/* Starts the tick with the timer of the core, because timer 4 of the emulator has another clock. */
void tick_timer_start(void) {
  SYSTICK->RVR = 2 * TICK_COUNTS - 1;
  SYSTICK->CVR = 0;
  SCB->SHPR3 = FIELD(24, 8, PRIORITY_TICK);
  SYSTICK->CSR = SYSTICK_CSR_CLKSOURCE | SYSTICK_CSR_TICKINT | SYSTICK_CSR_ENABLE;
}

/* Clears the interrupt request of the tick. Reading the register CSR clears its flag. */
void tick_timer_take(void) { (void)SYSTICK->CSR; }

bool tick_timer_is_due(void) { return (SYSTICK->CSR & SYSTICK_CSR_COUNTFLAG) != 0; }

void io_make_safe(void) {}

uint8_t io_node_id(void) { return 1; }

uint32_t io_serial_number(void) { return 0; }

void watchdog_arm(void) {}

uint8_t reset_cause(void) { return 0; }

void supply_interrupt(void) {} /* Does nothing, because this interrupt is never enabled. */

void port_feed_watchdog(void) {}

void can_interrupt(void) {} /* Does nothing, because this interrupt is never enabled. */

void drive_bus_interrupt(void) {} /* Does nothing, because this interrupt is never enabled. */

void drive_bus_sent_interrupt(void) {} /* Does nothing, because this interrupt is never enabled. */

uint8_t port_can_bus(void) { return CAN_BUS_ACTIVE; }

uint16_t port_can_lost(void) { return 0; }

void port_can_rate(uint16_t kbit_s) { (void)kbit_s; }
