/* The functions of spi_force.c for a board to which no force converter can be connected over
 * SPI. */

#include "firmware/port/stm32/board.h"

/* Returns false if the parameters select a converter, because the board cannot have a converter. */
bool spi_force_start(const device_params_t *params) {
  return params->force_converter == AXIS_FORCE_CONVERTER_ADC;
}

bool spi_force_is_fitted(void) { return false; }

bool spi_force_sample(axis_inputs_t *inputs) {
  (void)inputs;
  return false;
}
