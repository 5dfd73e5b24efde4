/* The inputs and outputs of the board. */

#include "firmware/port/port.h"
#include "firmware/port/stm32f4/board.h"

static bool clock_is_right;

void io_init(void) {
  RCC->AHB1ENR |= RCC_AHB1ENR_GPIOAEN | RCC_AHB1ENR_GPIOBEN | RCC_AHB1ENR_GPIOCEN;
  (void)RCC->AHB1ENR;
  dac_init();
  pins_init();
  clock_is_right = clock_start();
  clock_counter_start();
  encoder_init();
  adc_init();
  can_init(clock_is_right);
}

bool io_clock_is_right(void) { return clock_is_right; }

void io_make_safe(void) {
  dac_write(0);
  pins_write(false, false);
}

uint8_t io_node_id(void) { return pins_node_id(); }

/* The chip's own 96 bits, folded. An emulator that lacks the clocks lacks them too, and faults. */
uint32_t io_serial_number(void) {
  if (!clock_is_right) {
    return 0;
  }
  const reg_t *id = (const reg_t *)UID_BASE;
  return id[0] ^ id[1] ^ id[2];
}

bool port_sample(axis_inputs_t *inputs) {
  adc_start();
  inputs->encoder_cnt = encoder_read();
  inputs->din = pins_din();
  return true;
}

void port_sense(axis_inputs_t *inputs) {
  uint16_t codes[2] = {0, 0};
  const bool valid = adc_read(codes) && clock_is_right;
  inputs->sensor_valid = valid ? 1 : 0;
  /* Always 12 bits, of which the axis gets the upper ones; beyond that zeros follow. */
  const uint8_t bits = port_firmware()->axis.params.adc_bits;
  for (uint8_t i = 0; i < 2; i++) {
    inputs->adc_code[i] = (uint16_t)((uint32_t)codes[i] << 4 >> (16 - bits));
  }
}

/* Going on, the amplifier is enabled at mid-scale, where the DAC has stood since it was disabled,
 * and only if it does; going off, the DAC is there before the amplifier is off. */
void port_act(const axis_outputs_t *outputs) {
  static bool is_on;
  is_on = outputs->amp_enable != 0 && (is_on || dac_is_zero());
  if (is_on) {
    pins_write(true, outputs->brake_release != 0);
    dac_write(outputs->dac_code);
  } else {
    io_make_safe();
  }
}

void port_idle(void) { __asm volatile("wfi"); }
