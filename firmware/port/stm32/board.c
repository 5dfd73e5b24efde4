/* Functions of the board that use no peripherals and are the same in the released image and in the
 * emulated image. */

#include "firmware/port/stm32/board.h"

#include "firmware/port/identity.h"
#include "firmware/port/image.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32/tick.h"

/* The start-up does not clear this memory, so an incident in the memory is kept over a reset. */
static uint8_t recorder_buffer[FW_RECORDER_BYTES] __attribute__((section(".noinit.recorder")));
static blackbox_t blackbox __attribute__((section(".noinit.blackbox")));
static fw_config_t config;

void port_init(void) {
  protect_start();
  io_init();
  serial_init(io_clock_is_right() ? CLOCK_APB1_HZ : CLOCK_HSI_HZ);
}

const fw_config_t *port_config(void) {
  config.recorder_buffer = recorder_buffer;
  config.recorder_bytes = sizeof(recorder_buffer);
  config.blackbox = &blackbox;
  config.memory = flash_memory();
  config.archive = flash_archive();
  config.hardware = CHIP_HARDWARE;
  config.software = identity_software;
  config.serial_number = io_serial_number();
  config.node_id = (io_node_id() == 0) ? FW_NODE_ID_BY_LSS : io_node_id();
  config.bit_rates = CAN_RATES;
  /* resolution of the DAC of the chip; the DAC is not used if a drive is on the second CAN */
  config.dac_bits = 12;
  config.buses = 1;
  config.program_memory = programs_begin;
  config.program_bytes = image_bytes(programs_begin, programs_end);
  config.result_memory = results_begin;
  config.result_bytes = image_bytes(results_begin, results_end);
  config.curve_memory = curve_begin;
  config.curve_bytes = image_bytes(curve_begin, curve_end);
  config.reset_cause = reset_cause();
  config.core_fault = board_fault_before(&config.reset_cause);
  config.slots = board_slots();
  return &config;
}

void port_start(void) {
  io_start();
  watchdog_arm();
  tick_start();
}
