#ifndef FIRMWARE_PORT_STM32F4_BOARD_H_
#define FIRMWARE_PORT_STM32F4_BOARD_H_

/* The parts of this port, one file each. Those that the emulator does not model (all that touch
 * what it lacks) are replaced by emulated/io.c; start-up, serial line, tick and board.c are the
 * same there. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/store.h"
#include "firmware/port/stm32f4/registers.h"

/* Priorities of interrupts; a lower number goes first. The tick may be interrupted by those that
 * only move a byte or a frame. */
enum { PRIORITY_BUS = 0x40, PRIORITY_TICK = 0x80 };

/* Clocks: the core, and what CAN and the serial line are fed with. Without the PLL all of them run
 * from the internal oscillator. */
#define CLOCK_APB1_HZ UINT32_C(42000000)
#define CLOCK_HSI_HZ UINT32_C(16000000)

/* clock.c: 168 MHz. False: the PLL did not come; then the core stays at 16 MHz, the sensors
 * are reported as not valid, and CAN, whose bit timing would be wrong, stays off. */
bool clock_start(void);

/* clock.c, or emulated/io.c: a counter of 32 bits that also runs in sleep and while interrupts are
 * off; half as fast as the core, or as fast without the PLL. Before it is started it stands. */
void clock_counter_start(void);
uint32_t clock_count(void);

/* pins.c */
enum { PIN_INPUT = 0, PIN_OUTPUT = 1, PIN_ALTERNATE = 2, PIN_ANALOG = 3 };
enum { PIN_PULL_NONE = 0, PIN_PULL_UP = 1, PIN_PULL_DOWN = 2 };
void pin_mode(gpio_t *port, uint8_t pin, uint32_t mode, uint32_t pull);
void pin_alternate(gpio_t *port, uint8_t pin, uint32_t function, uint32_t pull);
void pins_init(void); /* outputs low, inputs, straps */
void pins_write(bool amp_enable, bool brake_release);
uint8_t pins_din(void);     /* AXIS_DIN_ bits; index: since the call before */
uint8_t pins_node_id(void); /* 0: no strap is set */

/* dac.c: code -2048..2047, 0 is mid-scale. */
void dac_init(void);
void dac_write(int16_t code);
bool dac_is_zero(void); /* what the converter puts out now is mid-scale */

/* encoder.c */
void encoder_init(void);
int32_t encoder_read(void);

/* adc.c: both channels, started, then read. False: not ready within 5 us. */
void adc_init(void);
void adc_start(void);
bool adc_read(uint16_t codes[2]); /* 12 bits */

/* can.c. Its bit rates for fw_config_t: of 800 kbit/s, place 1, the clock is no multiple. */
#define CAN_RATES (BIT(0) | BIT(2) | BIT(3) | BIT(4) | BIT(6) | BIT(7) | BIT(8))
void can_init(bool clock_is_right);

/* The vectors' handlers: can.c and serial.c; the tick's is in tick.h. */
void can_interrupt(void);
void serial_interrupt(void);

/* serial.c */
void serial_init(uint32_t clock_hz);

/* flash.c: parameter store, and archive of incidents; NULL where there is none. */
const store_memory_t *flash_memory(void);
const store_memory_t *flash_archive(void);

/* watchdog.c */
void watchdog_start(void);
bool watchdog_fired(void); /* it has reset the chip; true once */

/* io.c, or emulated/io.c */
void io_init(void); /* safe outputs, clock, all but the serial line */
bool io_clock_is_right(void);
void io_make_safe(void);  /* outputs off, in any state of the chip */
uint8_t io_node_id(void); /* 0: none */
uint32_t io_serial_number(void);

/* startup.c: outputs off and reset, when the program cannot continue. */
_Noreturn void board_fail(void);

#endif
