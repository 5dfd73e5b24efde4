#ifndef FIRMWARE_PORT_STM32F4_BOARD_H_
#define FIRMWARE_PORT_STM32F4_BOARD_H_

/* The parts of this port, one file each. emulated/io.c replaces the parts whose peripherals the
 * emulator does not model; start-up, serial line, tick and board.c are the same in the emulator. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"
#include "firmware/port/stm32f4/registers.h"
#include "firmware/storage/store.h"

/* Priorities of interrupts; a lower number has priority. The interrupts that only move a byte or a
 * frame may interrupt the tick. The interrupt that switches the outputs off when the supply falls
 * may interrupt all others. */
enum { PRIORITY_SUPPLY = 0x00, PRIORITY_BUS = 0x40, PRIORITY_TICK = 0x80 };

/* Clocks of the core and of the peripherals CAN and serial line. Without the PLL all of them run
 * from the internal oscillator. */
#define CLOCK_APB1_HZ UINT32_C(42000000)
#define CLOCK_HSI_HZ UINT32_C(16000000)

/* clock.c: sets 168 MHz from the 8 MHz of the ST-Link, or else from the internal oscillator.
 * Returns false if the PLL did not start: then the core remains at 16 MHz, the sensors are reported
 * as not valid, and CAN, whose bit timing would be wrong, remains off. */
bool clock_start(void);
bool clock_is_external(void);

/* clock.c or emulated/io.c: a counter of 32 bits that also runs during sleep and while interrupts
 * are off. Its rate is half that of the core, or equal to it without the PLL. It does not count
 * before it is started. */
void clock_counter_start(void);
uint32_t clock_count(void);

/* pins.c */
enum { PIN_INPUT = 0, PIN_OUTPUT = 1, PIN_ALTERNATE = 2, PIN_ANALOG = 3 };
enum { PIN_PULL_NONE = 0, PIN_PULL_UP = 1, PIN_PULL_DOWN = 2 };
void pin_mode(gpio_t *port, uint8_t pin, uint32_t mode, uint32_t pull);
enum { PIN_SPEED_LOW = 0, PIN_SPEED_MEDIUM = 1 };
void pin_speed(gpio_t *port, uint8_t pin, uint32_t speed); /* speed of the edges of the pin */
void pin_alternate(gpio_t *port, uint8_t pin, uint32_t function, uint32_t pull);
void pins_init(void); /* sets outputs low, and configures inputs and straps */
void pins_read_options(void);
void pins_write(bool amp_enable, bool brake_release); /* call it once in each tick */
bool pins_enable_is_right(void); /* whether the pin amp_enable has the level that was output */
void index_interrupt(void);
uint8_t pins_din(void);     /* AXIS_DIN_ bits; index: a pulse since the last call */
uint8_t pins_node_id(void); /* node id of the straps; 0: no strap is set */

/* dac.c: outputs a code -2048..2047; code 0 is mid-scale. */
void dac_init(void);
void dac_write(int16_t code);
bool dac_is_zero(void); /* whether the present output of the converter is mid-scale */

/* encoder.c */
void encoder_init(void);
int32_t encoder_read(void);

/* adc.c: both channels are started, then read. Returns false if they are not ready within 5 us. */
void adc_init(void);
void adc_start(void);
bool adc_read(uint16_t codes[2]); /* codes of 12 bits */

/* Call it between two ticks: starts one conversion of pin PA4, or of the internal reference. */
void adc_start_one(bool of_reference);
/* call it before adc_start(); false: the conversion has not finished */
bool adc_read_one(uint16_t *code);

/* monitor.c: measures pin PA4 and the internal reference alternately after each tick; errors are
 * FW_BOARD_ bits. `code` is the DAC code from now on. */
void monitor_init(void);
void monitor_start(int16_t code);
void monitor_look(void);
uint16_t monitor_state(void);

/* second_clock.c: compares the length of the tick with the oscillator of the watchdog. Start it
 * before clock_start() and after clock_counter_start(). */
void second_clock_start(void);
void second_clock_tick(void);
int16_t second_clock_permille(void); /* excess of the tick length in 1/1000 */
uint16_t second_clock_state(void);   /* FW_BOARD_ bits */

/* supply.c */
void supply_init(void);
void supply_interrupt(void);
void supply_look(void);
bool supply_is_low(void);
/* whether the option bytes set the brown-out reset to the required level */
bool supply_resets_in_time(void);

/* memory_check.c: checks the CRC of the image, and each used word of the RAM with patterns. */
bool image_is_whole(void);
bool ram_is_right(void);

/* protect.c: regions of memory whose access causes a fault. */
void protect_start(void);

/* can.c: bit rates for fw_config_t. The rate 800 kbit/s, index 1, is missing, because the clock is
 * no multiple of it. */
#define CAN_RATES (BIT(0) | BIT(2) | BIT(3) | BIT(4) | BIT(6) | BIT(7) | BIT(8))
void can_init(bool clock_is_right);

/* Interrupt handlers of can.c and serial.c; tick.h has that of the tick. */
void can_interrupt(void);
void serial_interrupt(void);

/* serial.c */
void serial_init(uint32_t clock_hz);

/* flash.c: memory of the parameter store and of the archive of incidents; NULL if there is none. */
const store_memory_t *flash_memory(void);
const store_memory_t *flash_archive(void);

/* watchdog.c */
void watchdog_start(void); /* starts it with its longest time */
void watchdog_arm(void);   /* sets the time to 20 ms */
uint8_t reset_cause(void); /* FW_RESET_ set; call it once */

/* io.c, or emulated/io.c */
/* sets safe outputs and starts the clock and all peripherals except the serial line */
void io_init(void);
bool io_clock_is_right(void);
void io_make_safe(void);  /* switches the outputs off in any state of the chip */
uint8_t io_node_id(void); /* node id; 0: none */
uint32_t io_serial_number(void);

/* fault.c: switches the outputs off and resets the chip when the program cannot continue; it also
 * handles the faults of the core. The last function returns the data that was kept of a fault
 * before the reset, or NULL; call it once. */
void board_fail(void);
const fw_core_fault_t *board_fault_before(uint8_t reset_cause);

#endif
