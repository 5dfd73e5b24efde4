/* Functions of port.h for the inputs and outputs of the board. */

#include "firmware/fx/bytes.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32/board.h"

static bool clock_is_right;
static uint16_t found;   /* errors that were found at power-up, as AXIS_BOARD_STATE_ bits */
static int16_t dac_code; /* DAC code that the board outputs now */
static bool is_captured; /* true: the encoder count of this tick was captured */

void io_init(void) {
  set_bits(CLOCK_OF_PORTS);
  dac_init();
  pins_init();
  watchdog_start();
  supply_init();
  clock_counter_start();
  second_clock_start();
  clock_is_right = clock_start();
  pins_read_options();
  found = (uint16_t)((clock_is_external() ? 0 : AXIS_BOARD_STATE_CLOCK_INTERNAL) |
                     (option_bytes_are_right() ? 0 : AXIS_BOARD_STATE_OPTION_BYTES) |
                     (image_is_whole() ? 0 : AXIS_BOARD_STATE_IMAGE) |
                     (ram_is_right() ? 0 : AXIS_BOARD_STATE_RAM));
  encoder_init();
  adc_init();
  if (clock_is_right) {
    monitor_init();
  }
  can_init(clock_is_right);
}

void io_start(void) {
  const device_params_t *params = &port_firmware()->device;
  drive_bus_start(params);
  if (!spi_force_start(params)) {
    found |= AXIS_BOARD_STATE_CONVERTER;
  }
  /* The result of this conversion is not used, because the first conversion after a pause may be
   * wrong. */
  adc_start_one(false);
}

bool io_clock_is_right(void) { return clock_is_right; }

void io_make_safe(void) {
  dac_code = 0;
  dac_write(0);
  pins_write(false, false);
}

uint8_t io_node_id(void) { return pins_node_id(); }

/* Returns a serial number, which is the CRC-32 of the 96-bit unique ID of the chip. So two chips of
 * one production lot have different serial numbers, also in LSS. Returns 0 if the clock is not
 * correct: an emulator without the clocks does not have the unique ID either, and a read of it
 * would cause a fault. */
uint32_t io_serial_number(void) {
  if (!clock_is_right) {
    return 0;
  }
  const reg_t *id = (const reg_t *)UID_BASE;
  uint32_t crc = UINT32_MAX;
  for (uint8_t i = 0; i < 12; i++) {
    crc = fx_crc32(crc, (uint8_t)(id[i / 4] >> (8 * (i % 4))));
  }
  return ~crc;
}

bool port_sample(axis_inputs_t *inputs) {
  monitor_look();
  adc_begin();
  is_captured = encoder_read(&inputs->encoder_cnt);
  inputs->din = pins_din();
  if (drive_bus_is_fitted()) {
    drive_bus_sample(inputs);
  }
  return true;
}

/* Returns the errors of the board that are detected in this tick, as AXIS_BOARD_STATE_ bits. */
static uint16_t board_state(void) {
  supply_look();
  second_clock_tick();
  port_firmware()->device_signals.flash_corrected = flash_corrected();
  const bool is_enable_wrong = !pins_enable_is_right();
  return (uint16_t)(found | (supply_is_low() ? AXIS_BOARD_STATE_SUPPLY : 0) | monitor_state() |
                    (is_enable_wrong ? AXIS_BOARD_STATE_ENABLE : 0) |
                    (clock_is_right ? second_clock_state() : 0));
}

/* Checks the board and reads the ADC codes. The board is checked first, while the conversions run.
 * If the clock is not correct, the sensors are never valid. */
void port_sense(axis_inputs_t *inputs) {
  fw_board(port_firmware(), board_state(), second_clock_permille());
  uint16_t codes[2] = {0, 0};
  bool valid = adc_read(codes) && clock_is_right && is_captured;
  /* An ADC code has 12 bits. The axis uses the upper adc_bits of the code; if adc_bits is above 12,
   * zeros are appended. */
  const uint8_t bits = port_firmware()->axis.params.adc_bits;
  /* a drive on a bus reports its own motor current */
  const uint8_t channels = drive_bus_is_fitted() ? 1 : 2;
  for (uint8_t i = 0; i < channels; i++) {
    inputs->adc_code[i] = (uint16_t)((uint32_t)codes[i] << 4 >> (16 - bits));
  }
  if (spi_force_is_fitted()) {
    valid = spi_force_sample(inputs) && valid;
  }
  inputs->sensor_valid = valid ? 1 : 0;
}

/* Sets the outputs for an amplifier for +-10 V. The amplifier is switched on only if the DAC is at
 * mid-scale; the DAC was set to mid-scale when the axis was disabled. Before the amplifier is
 * switched off, the DAC is set to mid-scale again. If the axis has a drive on a bus, the DAC stays
 * at mid-scale, and amp_enable can enable the drive. */
void port_act(const axis_outputs_t *outputs) {
  static bool is_on;
  is_on = outputs->amp_enable != 0 && (is_on || dac_is_zero());
  if (is_on) {
    pins_write(true, outputs->brake_release != 0);
    dac_code = drive_bus_is_fitted() ? 0 : outputs->dac_code;
    dac_write(dac_code);
  }
  pins_write_digital(outputs->digital);
  /* The supply voltage is checked again, because it may have fallen while the outputs were
   * written. */
  const bool is_off = !is_on || supply_is_low();
  if (is_off) {
    io_make_safe();
  }
  if (drive_bus_is_fitted()) {
    const axis_outputs_t off = {0};
    drive_bus_act(is_off ? &off : outputs);
  }
  monitor_start(dac_code);
}

void port_idle(void) { __asm volatile("wfi"); }
