#include "firmware/port/stm32/board.h"

enum { MID_SCALE = 2048, PIN = 4 };

/* Initialises the DAC with its output buffer, so that the pin may have a load of at least 5 kOhm.
 * The buffer does not reach the lowest and the highest 0.2 V of the range. While amp_enable is low,
 * the analog switch of the board outputs mid-scale instead of the voltage of the pin. The mode of
 * the DAC can be written only while the DAC is off. The pin is set to analog before the DAC drives
 * it, and the DAC is set to mid-scale before it is enabled. No trigger is used, so a DAC code is
 * output one cycle after it was written. */
void dac_init(void) {
  set_bits(&RCC->AHB2ENR, RCC_AHB2ENR_DAC1EN);
  DAC1->CR = 0;
  DAC1->MCR = DAC_MCR_MODE1_BUFFER | DAC_MCR_HFSEL_160;
  DAC1->DHR12R1 = MID_SCALE;
  pin_mode(GPIOA, PIN, PIN_ANALOG, PIN_PULL_NONE);
  DAC1->CR = DAC_CR_EN1;
  DAC1->DHR12R1 = MID_SCALE;
}

void dac_write(int16_t code) { DAC1->DHR12R1 = (uint32_t)(MID_SCALE + code); }

bool dac_is_zero(void) { return (DAC1->DOR1 & DAC_DOR1_DACC1DOR) == MID_SCALE; }
