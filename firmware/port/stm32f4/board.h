#ifndef FIRMWARE_PORT_STM32F4_BOARD_H_
#define FIRMWARE_PORT_STM32F4_BOARD_H_

/* The parts of this port, one file each. Those that the emulator does not model (all that touch
 * what it lacks) are replaced by emulated/io.c; start-up, serial line, tick and board.c are the
 * same there. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"
#include "firmware/port/stm32f4/registers.h"
#include "firmware/storage/store.h"

/* Priorities of interrupts; a lower number goes first. The tick may be interrupted by those that
 * only move a byte or a frame, and all by the one that switches off because the supply falls. */
enum { PRIORITY_SUPPLY = 0x00, PRIORITY_BUS = 0x40, PRIORITY_TICK = 0x80 };

/* Clocks: the core, and what CAN and the serial line are fed with. Without the PLL all of them run
 * from the internal oscillator. */
#define CLOCK_APB1_HZ UINT32_C(42000000)
#define CLOCK_HSI_HZ UINT32_C(16000000)

/* clock.c: 168 MHz, of the ST-Link's 8 MHz or else of the internal oscillator. False: the PLL did
 * not come; then the core stays at 16 MHz, the sensors are reported as not valid, and CAN, whose
 * bit timing would be wrong, stays off. */
bool clock_start(void);
bool clock_is_external(void);

/* clock.c, or emulated/io.c: a counter of 32 bits that also runs in sleep and while interrupts are
 * off; half as fast as the core, or as fast without the PLL. Before it is started it stands. */
void clock_counter_start(void);
uint32_t clock_count(void);

/* pins.c */
enum { PIN_INPUT = 0, PIN_OUTPUT = 1, PIN_ALTERNATE = 2, PIN_ANALOG = 3 };
enum { PIN_PULL_NONE = 0, PIN_PULL_UP = 1, PIN_PULL_DOWN = 2 };
void pin_mode(gpio_t *port, uint8_t pin, uint32_t mode, uint32_t pull);
enum { PIN_SPEED_LOW = 0, PIN_SPEED_MEDIUM = 1 };
void pin_speed(gpio_t *port, uint8_t pin, uint32_t speed); /* of its edges */
void pin_alternate(gpio_t *port, uint8_t pin, uint32_t function, uint32_t pull);
void pins_init(void); /* outputs low, inputs, straps */
void pins_read_options(void);
void pins_write(bool amp_enable, bool brake_release); /* once a tick */
bool pins_enable_is_right(void); /* amp_enable has the level that was put out */
void index_interrupt(void);
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

/* Between two ticks: one conversion of PA4, or of the internal reference. */
void adc_start_one(bool of_reference);
bool adc_read_one(uint16_t *code); /* before adc_start(); false: not done */

/* monitor.c: PA4 and the reference, measured in turn after each tick; FW_BOARD_ bits. `code`: the
 * DAC's from now on. */
void monitor_init(void);
void monitor_start(int16_t code);
void monitor_look(void);
uint16_t monitor_state(void);

/* second_clock.c: length of the tick beside the watchdog's oscillator. Started before clock_start()
 * and after clock_counter_start(). */
void second_clock_start(void);
void second_clock_tick(void);
int16_t second_clock_permille(void); /* 1/1000 that a tick is too long */
uint16_t second_clock_state(void);   /* FW_BOARD_ bits */

/* supply.c */
void supply_init(void);
void supply_interrupt(void);
void supply_look(void);
bool supply_is_low(void);
bool supply_resets_in_time(void); /* the brown-out reset stands at its level */

/* memory_check.c: the CRC of the image; patterns in each word of the RAM in use. */
bool image_is_whole(void);
bool ram_is_right(void);

/* protect.c: regions of memory that fault when they are touched. */
void protect_start(void);

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
void watchdog_start(void); /* with its longest time */
void watchdog_arm(void);   /* from now on 20 ms */
uint8_t reset_cause(void); /* FW_RESET_ set; once */

/* io.c, or emulated/io.c */
void io_init(void); /* safe outputs, clock, all but the serial line */
bool io_clock_is_right(void);
void io_make_safe(void);  /* outputs off, in any state of the chip */
uint8_t io_node_id(void); /* 0: none */
uint32_t io_serial_number(void);

/* fault.c: outputs off and reset, when the program cannot continue; handler of the core's faults.
 * What was kept of one before the reset, or NULL; once. */
void board_fail(void);
const fw_core_fault_t *board_fault_before(uint8_t reset_cause);

#endif
