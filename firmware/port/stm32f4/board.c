/* Functions that are the same in the released image and the emulated image, except for the
 * peripherals. */

#include "firmware/port/stm32f4/board.h"

#include "firmware/port/identity.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32f4/tick.h"

/* Start-up does not clear this memory, so that an incident is kept over a reset. */
static uint8_t recorder_buffer[FW_RECORDER_BYTES] __attribute__((section(".noinit.recorder")));
static blackbox_t blackbox __attribute__((section(".noinit.blackbox")));
/* Memory for programs of cycles, in the linker script. */
extern uint32_t programs_begin[], programs_end[];
/* Memory for the results of parts, likewise. */
extern uint32_t results_begin[], results_end[];
/* Memory for the curve of a cycle, likewise. */
extern uint32_t curve_begin[], curve_end[];
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
  config.hardware = "stm32f446";
  config.software = identity_software;
  config.serial_number = io_serial_number();
  config.node_id = (io_node_id() == 0) ? FW_NODE_ID_BY_LSS : io_node_id();
  config.bit_rates = CAN_RATES;
  config.dac_bits = 12; /* without a drive at the second CAN */
  config.buses = 1;
  config.program_memory = programs_begin;
  config.program_bytes = (uint32_t)((uintptr_t)programs_end - (uintptr_t)programs_begin);
  config.result_memory = results_begin;
  config.result_bytes = (uint32_t)((uintptr_t)results_end - (uintptr_t)results_begin);
  config.curve_memory = curve_begin;
  config.curve_bytes = (uint32_t)((uintptr_t)curve_end - (uintptr_t)curve_begin);
  config.reset_cause = reset_cause();
  config.core_fault = board_fault_before(config.reset_cause);
  return &config;
}

void port_start(void) {
  io_start();
  watchdog_arm();
  tick_start();
}
