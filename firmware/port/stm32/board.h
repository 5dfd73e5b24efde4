#ifndef FIRMWARE_PORT_STM32_BOARD_H_
#define FIRMWARE_PORT_STM32_BOARD_H_

/* The modules of the code for a board with an STM32. Each module is one source file. Modules that
 * are the same for all chips are in this folder. The other modules are in the folder of the board,
 * together with chip.h, which names the registers that differ between chips. In the emulator,
 * emulated/io.c of the STM32F4 replaces the modules whose peripherals are not emulated. The
 * start-up, the serial line, the tick and board.c are the same as on the board. */

#include <stdbool.h>
#include <stdint.h>

#include "chip.h"
#include "firmware/app/fw.h"
#include "firmware/storage/store.h"

/* Priorities of interrupts; a lower number is a higher priority. Interrupts that only move a byte
 * or a frame may interrupt the tick. The interrupt that switches the outputs off when the supply
 * voltage falls may interrupt all others. */
enum { PRIORITY_SUPPLY = 0x00, PRIORITY_BUS = 0x40, PRIORITY_TICK = 0x80 };

/* Sets bits of a register, for example the clock of a peripheral, and reads the register back: a
 * peripheral can be used two cycles after its clock is enabled. */
static inline void set_bits(reg_t *reg, uint32_t bits) {
  *reg |= bits;
  (void)*reg;
}

/* Clock frequencies in Hz. CLOCK_APB1_HZ: clock of the peripherals CAN and serial line.
 * CLOCK_HSI_HZ: internal oscillator. If the PLL is off, the core and these peripherals run from the
 * internal oscillator. */
#define CLOCK_APB1_HZ UINT32_C(42000000)
#define CLOCK_HSI_HZ UINT32_C(16000000)

/* clock.c: sets the clock of the core to 168 MHz. The source is the external clock of the board, or
 * the internal oscillator if there is no external clock. Returns false if the PLL did not start.
 * Then the core remains at 16 MHz, the sensors are reported as not valid, and CAN remains off
 * because its bit timing would be wrong. */
bool clock_start(void);
bool clock_is_external(void);

/* tick_timer.c or emulated/io.c: a counter of 32 bits that also runs during sleep and while
 * interrupts are off. The counter has half the rate of the core, or the rate of the core if the PLL
 * is off. It does not count before clock_counter_start(). */
void clock_counter_start(void);
uint32_t clock_count(void);

/* pins.c: digital inputs and outputs, and settings of single pins */
enum { PIN_INPUT = 0, PIN_OUTPUT = 1, PIN_ALTERNATE = 2, PIN_ANALOG = 3 };
enum { PIN_PULL_NONE = 0, PIN_PULL_UP = 1, PIN_PULL_DOWN = 2 };
void pin_mode(gpio_t *port, uint8_t pin, uint32_t mode, uint32_t pull);
enum { PIN_SPEED_LOW = 0, PIN_SPEED_MEDIUM = 1 };
/* sets the edge speed (PIN_SPEED_) of an output pin */
void pin_speed(gpio_t *port, uint8_t pin, uint32_t speed);
void pin_alternate(gpio_t *port, uint8_t pin, uint32_t function, uint32_t pull);
void pins_init(void); /* sets the outputs low, and configures the inputs and the straps */
void pins_read_options(void);
/* sets the outputs amp_enable and brake_release; call pins_write() once in each tick */
void pins_write(bool amp_enable, bool brake_release);
void pins_write_digital(uint8_t levels);
/* returns true if the pin amp_enable has the level that was output */
bool pins_enable_is_right(void);
void index_interrupt(void);
/* returns the digital inputs as AXIS_DIGITAL_INPUTS_ bits; the bit AXIS_DIGITAL_INPUTS_INDEX is 1
 * if an index pulse occurred since the last call */
uint8_t pins_din(void);
/* returns the node id that the straps select; 0: no strap is connected */
uint8_t pins_node_id(void);

/* dac.c: outputs a DAC code of -2048..2047; code 0 is mid-scale. */
void dac_init(void);
void dac_write(int16_t code);
bool dac_is_zero(void); /* returns true if the present output of the DAC is mid-scale */

/* encoder.c: encoder_read() reads the encoder count that was captured at the begin of this tick.
 * Returns false if the count was not captured since the last call. */
void encoder_init(void);
bool encoder_read(int32_t *count);

/* adc.c: the conversions of force and motor current start at the begin of each tick without an
 * instruction. Call adc_begin() first in the tick. adc_read() reads the ADC codes. It returns false
 * if the conversions have not finished within 5 us after adc_begin(). */
void adc_init(void);
void adc_begin(void);
bool adc_read(uint16_t codes[2]); /* reads the two ADC codes, which have 12 bits */

/* Starts one conversion of the internal reference, or of pin PA4 if of_reference is false. Call
 * this function between two ticks, in each tick. */
void adc_start_one(bool of_reference);
/* Reads the result of the conversion that adc_start_one() has started. Returns false if the
 * conversion has not finished. Call this function before adc_read(). */
bool adc_read_one(uint16_t *code);

/* monitor.c: after each tick measures either pin PA4 or the internal reference, alternately. The
 * argument of monitor_start() is the DAC code that is output from now on. monitor_state() returns
 * the detected errors as AXIS_BOARD_STATE_ bits. */
void monitor_init(void);
void monitor_start(int16_t code);
void monitor_look(void);
uint16_t monitor_state(void);

/* second_clock.c: compares the length of the tick with the oscillator of the watchdog. Call
 * second_clock_start() after clock_counter_start() and before clock_start(). */
void second_clock_start(void);
void second_clock_tick(void);
/* returns the deviation of the tick length in 1/1000; positive: ticks are too long */
int16_t second_clock_permille(void);
/* returns the result of the comparison of the two clocks, as AXIS_BOARD_STATE_ bits */
uint16_t second_clock_state(void);

/* supply.c: monitors the supply voltage and checks the option bytes */
void supply_init(void);
void supply_interrupt(void);
void supply_look(void);
bool supply_is_low(void);
/* returns true if the option bytes are those that `forceaxis flash` sets: brown-out reset, write
 * protection, start */
bool option_bytes_are_right(void);

/* memory_check.c: image_is_whole() checks the CRC of the image. ram_is_right() checks each used
 * word of the RAM with patterns. */
bool image_is_whole(void);
bool ram_is_right(void);

/* protect.c: protects regions of the memory, so that a forbidden access causes a fault of the
 * core. */
void protect_start(void);

/* protect.c: protect_region() sets a region of the memory protection. memories.c: protect_flash()
 * sets the regions of the flash that may be programmed, beginning with the region number `first`.
 * They have priority over the region of the whole flash. */
void protect_region(uint32_t number, uint32_t base, uint32_t attributes);
void protect_flash(uint32_t first);

/* can.c: set of supported bit rates for fw_config_t. The bit rate 800 kbit/s (index 1) is not
 * supported, because the clock of the CAN controller is no multiple of this rate. */
#define CAN_RATES (BIT(0) | BIT(2) | BIT(3) | BIT(4) | BIT(6) | BIT(7) | BIT(8))
void can_init(bool clock_is_right);

/* Interrupt handlers that can.c and serial.c define. The interrupt handler of the tick is in
 * tick.h. */
void can_interrupt(void);
void serial_interrupt(void);

/* drive_bus.c connects a CiA 402 drive on the second CAN. drive_bus_start() does nothing if
 * drive_node_id is 0. drive_bus_sample() sets the inputs from the frames that the drive has sent
 * since the last tick. The second ADC code is the torque in per mille of the rated torque; with
 * adc_bits 16, the code 32768 is torque 0. drive_bus_act() sends the command of this tick. One
 * interrupt handler is for a received frame, and the other one for a sent frame. */
void drive_bus_start(const device_params_t *params);
bool drive_bus_is_fitted(void);
void drive_bus_sample(axis_inputs_t *inputs);
void drive_bus_act(const axis_outputs_t *outputs);
void drive_bus_interrupt(void);
void drive_bus_sent_interrupt(void);

/* spi_force.c: a converter of the force on SPI (firmware/port/converter.h). If the parameter
 * force_converter is not adc, spi_force_start() configures the converter within 12 ms. It returns
 * false if the converter does not answer, if it answers with another identity or other settings, or
 * if the board has no connection for a converter. spi_force_sample() gives the ADC code and the age
 * of the last reading. It returns false if a reading since the last call had an error. One
 * interrupt handler is for a ready conversion, and the other one for the end of its transfer. */
bool spi_force_start(const device_params_t *params);
bool spi_force_is_fitted(void);
bool spi_force_sample(axis_inputs_t *inputs);
void spi_force_ready_interrupt(void);
void spi_force_read_interrupt(void);

/* serial.c: the serial line */
void serial_init(uint32_t clock_hz);

/* flash.c: flash_memory() returns the memory of the parameter store, and flash_archive() the memory
 * of the archive of incidents. NULL: the board has no such memory. */
const store_memory_t *flash_memory(void);
const store_memory_t *flash_archive(void);

/* memories.c: returns the slots for images. Returns NULL if the board has no slots, or if the
 * running image has no trailer. */
const fw_slots_t *board_slots(void);

/* Address at which the firmware image begins. The linker script defines this symbol. */
extern const uint32_t vectors_begin[];

/* Restarts the chip after a command. The outputs are off. The next start does not report this
 * reset. */
_Noreturn void board_restart(void);

/* watchdog.c: the watchdog timer */
void watchdog_start(void); /* starts the watchdog with its longest time */
void watchdog_arm(void);   /* sets the watchdog time to 20 ms */

/* clock.c or emulated/io.c: returns the causes of the last reset as AXIS_RESET_CAUSE_ bits. Call
 * this function only once. */
uint8_t reset_cause(void);

/* io.c or emulated/io.c: inputs and outputs of the board */
/* starts the devices that the stored parameters select: the bus of a drive and the converter of the
 * force */
void io_start(void);
/* sets safe outputs, then starts the clock and all peripherals except the serial line */
void io_init(void);
bool io_clock_is_right(void);
void io_make_safe(void);  /* switches the outputs off; may be called in any state of the chip */
uint8_t io_node_id(void); /* returns the node id that the straps select; 0: no node id */
uint32_t io_serial_number(void);

/* fault.c: board_fail() switches the outputs off and resets the chip when the program cannot
 * continue; it also handles the faults of the core. After the reset, board_fault_before() returns
 * the kept data of the fault, or NULL if there was no fault. If board_restart() has caused the
 * reset, it also removes this cause from *reset_cause. Call board_fault_before() only once. */
void board_fail(void);
const fw_core_fault_t *board_fault_before(uint8_t *reset_cause);

#endif
